"""Makes hostile files of whole ones: cut, changed, claiming, nested, in wrong encodings, bombs, and no files at all."""

from __future__ import annotations

import gzip
import io
import os
import random
import re
import socket
import zipfile
from collections.abc import Callable
from pathlib import Path

_NUMBERS = (b"nan", b"inf", b"-inf", b"1e999", b"1e300", b"-1", b"0", b"1e-320", b"9" * 400, b'"x"', b"[]", b"null")
_CLAIMS = (b"\xff" * 4, b"\xff\xff\xff\x7f", b"\xff" * 8, b"\x00\x00\x00\x80", b"\xff" * 7 + b"\x7f", b"\x00" * 8)
_ODD = (b"\x00", b"\xff\xfe", b"nan", b"1e999", b'"', b"[" * 3000, b"\n", b",", b"9" * 400, b"\xc3\x28", b"\x1b[2J")

Damage = Callable[[bytes, random.Random], bytes]


def _cut(good: bytes, rng: random.Random) -> bytes:
    return good[: rng.randrange(len(good))]


def _flipped(good: bytes, rng: random.Random) -> bytes:
    content = bytearray(good)
    for _ in range(rng.randint(1, 16)):
        # the head of a file holds what it claims: half of the changes are made there
        at = rng.randrange(min(len(content), 256)) if rng.random() < 0.5 else rng.randrange(len(content))
        content[at] ^= 1 << rng.randrange(8)
    return bytes(content)


def _claiming(good: bytes, rng: random.Random) -> bytes:
    claim = rng.choice(_CLAIMS)
    at = rng.randrange(min(len(good), 2048)) // 2 * 2
    return good[:at] + claim + good[at + len(claim) :]


def _numbered(good: bytes, rng: random.Random) -> bytes:
    found = list(re.finditer(rb"-?\d+(\.\d+)?(e[-+]?\d+)?", good))
    if not found:
        return _claiming(good, rng)
    one = rng.choice(found)
    return good[: one.start()] + rng.choice(_NUMBERS) + good[one.end() :]


def _inserted(good: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(good))
    return good[:at] + rng.choice(_ODD) + good[at:]


def _moved(good: bytes, rng: random.Random) -> bytes:
    a, b, c = sorted(rng.randrange(len(good)) for _ in range(3))
    return good[:a] + good[b:c] + good[a:b] + good[c:]


def _without(good: bytes, rng: random.Random) -> bytes:
    lines = good.split(b"\n")
    del lines[rng.randrange(len(lines))]
    return b"\n".join(lines)


def _encoded(good: bytes, rng: random.Random) -> bytes:
    text = good.decode("latin-1")
    return text.encode(rng.choice(["utf-16", "utf-32", "utf-7", "utf-16-be", "cp500"]))


_DAMAGES: tuple[Damage, ...] = (
    _cut, _flipped, _claiming, _numbered, _inserted, _moved, _without, _encoded, _cut, _flipped, _claiming, _numbered,
)  # fmt: skip


def _zipped() -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a", bytes(200_000_000))
    return content.getvalue()


def bombs() -> tuple[bytes, ...]:
    """Return contents that no writer writes, of any format."""
    return (
        b"", b"\n", bytes(4096), b"{}", b"[]", b"null", b"[" * 200_000, b'{"a":' * 100_000, b"a." * 100_000 + b"b = 1",
        b"a = " + b"[" * 5000, b"a = " + b"9" * 5000, b"1," * 4_000_000, b"1\n" * 4_000_000, b"9" * 20_000_000,
        b'"' + b"a" * 20_000_000, gzip.compress(bytes(200_000_000)), _zipped(), b"RIFF\xff\xff\xff\xffWAVEfmt \xff\xff",
        b"fLaC" + b"\xff" * 500, b"SQLite format 3\x00" + b"\xff" * 4096, b"\x89HDF\r\n\x1a\n" + b"\xff" * 4096,
    )  # fmt: skip


def _device(name: str) -> Callable[[Path], None]:
    return lambda path: path.symlink_to(f"/dev/{name}")


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))


NO_FILES: tuple[Callable[[Path], None], ...] = (
    lambda path: None, Path.mkdir, lambda path: os.mkfifo(path), _device("zero"), _device("null"), _device("full"),
    _device("urandom"), lambda path: path.symlink_to(path), lambda path: path.symlink_to("nowhere"), _socket,
)  # fmt: skip
"""Makers of what is no file where a file is awaited: nothing, folder, pipe, devices, links without end, socket."""


def lay(path: Path, good: bytes, number: int, rng: random.Random, contents: tuple[bytes, ...]) -> str:
    """Lay the hostile file of that number at the path; return what it is."""
    if number < len(NO_FILES):
        NO_FILES[number](path)
        return f"no file {number}"
    number -= len(NO_FILES)
    if number < len(contents):
        path.write_bytes(contents[number])
        return f"content {number}"
    damage = _DAMAGES[number % len(_DAMAGES)]
    path.write_bytes(damage(good, rng))
    return damage.__name__.strip("_")
