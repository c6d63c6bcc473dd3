"""Requests that nobody makes, as bytes: heads and bodies from a mutator that knows HTTP and not the server's checks."""

from __future__ import annotations

import socket
from collections.abc import Callable
from contextlib import suppress

import numpy as np

from tests.web.access.mutating import defects, hear_all

UPGRADE = "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
NASTY = (
    *("", " ", "\0", "\r", "\n", "\r\n", "%00", "%2e%2e%2f", "..", "/", "//", "?", "#", "%ff", "%", "\xff", "é", ":"),
    *("a" * 9000, "9" * 5000, "-1", "1e9", "0x10", "18446744073709551616", "chunked", "gzip", "identity", "close"),
    *("100-continue", "websocket", "h2c", "localhost", "evil.example", "[::1", "http://x/", "*", "HTTP/0.9", "\t"),
)


def heads(paths: list[str], token: str) -> list[bytes]:
    lines = [f"GET {path} HTTP/1.1\r\nHost: localhost\r\nX-Token: {token}\r\n" for path in paths]
    lines += [line + UPGRADE + "Sec-WebSocket-Version: 13\r\n" for line in lines if "/ws" in line]
    lines += [f"{verb} {paths[0]} HTTP/1.1\r\nHost: localhost\r\n" for verb in ("HEAD", "OPTIONS", "PUT", "DELETE")]
    made = [f"{line}\r\n".encode("latin-1") for line in lines]
    dropping = f"POST /drop HTTP/1.1\r\nHost: localhost\r\nX-Token: {token}\r\nX-Name: a.csv\r\n"
    made.append(f"{dropping}Content-Length: 9\r\n\r\na,b\r\n1,2\r\n".encode())
    made.append(f"{dropping}Transfer-Encoding: chunked\r\n\r\n4\r\na,b\n\r\n3\r\n1,2\r\n0\r\n\r\n".encode())
    return made


def altered(rng: np.random.Generator, request: bytes) -> bytes:
    """A request changed somewhere; now and then it is left as it is, or is nothing but noise."""
    made, kind = bytearray(request), int(rng.integers(8))
    at, count = int(rng.integers(len(made))), int(rng.integers(12))
    nasty = NASTY[int(rng.integers(len(NASTY)))].encode("utf-8" if rng.random() < 0.5 else "latin-1", "replace")
    if kind < 3:
        made[at : at + (0, count, len(made))[kind]] = nasty if rng.random() < 0.7 else b""
    elif kind == 3:
        made[at] ^= 1 << int(rng.integers(8))
    elif kind in (4, 5):
        lines = bytes(made).split(b"\r\n")
        line = int(rng.integers(len(lines)))
        again = lines[int(rng.integers(len(lines)))]
        lines[line : line + 1] = [lines[line], again] if kind == 4 else [lines[line].partition(b":")[0] + b": " + nasty]
        return b"\r\n".join(lines)
    elif kind == 6:
        return bytes(rng.integers(0, 256, int(rng.integers(1, 200)), dtype=np.uint8))
    return bytes(made)


def fuzz(
    port: int, requests: list[bytes], count: int, caplog, monkeypatch, goes_on: Callable[[], None], seed: int = 21
) -> int:
    """Send so many altered requests, each on a connection of its own; how many were answered.

    goes_on: called now and then, that another connection finds the server as it was. Fails where a defect is logged.
    """
    hear_all(monkeypatch)
    rng, answered = np.random.default_rng(seed), 0
    for index in range(count):
        me = (f"127.0.0.{2 + index % 200}", 0)  # another address each time, or the limit for one would refuse it
        with socket.create_connection(("127.0.0.1", port), timeout=10.0, source_address=me) as made:
            made.sendall(altered(rng, requests[int(rng.integers(len(requests)))]))
            made.settimeout(0.05)
            with suppress(TimeoutError, ConnectionResetError):
                answered += made.recv(1 << 16).startswith(b"HTTP/1.1 ")
        if index % 200 == 199:
            goes_on()
    assert not (told := defects(caplog)), told[0]
    return answered
