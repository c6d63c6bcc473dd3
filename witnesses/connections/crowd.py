"""Connections that want nothing: held from several processes and many addresses, and opened again where they end."""

from __future__ import annotations

import asyncio
import multiprocessing
import ssl
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from multiprocessing.sharedctypes import Synchronized
from typing import Any

KINDS = ("half-open", "slow head", "silent websocket")
_HANDSHAKE = (
    b"GET /ws/operator HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
)
_HEAD = b"GET / HTTP/1.1\r\nHost: localhost\r\nX-Padding: " + b"a" * 1000


@dataclass(frozen=True)
class Crowd:
    """So many connections to 127.0.0.1. addresses: how many they come from. again_s: rest before one that was ended
    is opened again. encrypted: slow heads and websockets speak TLS; a half-open one never says a byte of it.
    """

    port: int
    count: int
    addresses: int
    processes: int
    again_s: float
    encrypted: bool

    @contextmanager
    def held(self) -> Iterator[Tally]:
        """Hold the connections as long as the block lasts; how many are open, and how often one was taken or ended."""
        tally, stop = Tally(), multiprocessing.Event()
        workers = [
            multiprocessing.Process(target=_work, args=(self, place, tally.open, tally.tried, stop), daemon=True)
            for place in range(self.processes)
        ]
        for worker in workers:
            worker.start()
        try:
            yield tally
        finally:
            stop.set()
            for worker in workers:
                worker.join(20.0)
                if worker.is_alive():
                    worker.kill()


class Tally:
    """What the crowd's processes count together."""

    def __init__(self) -> None:
        self.open: Synchronized[int] = multiprocessing.Value("i", 0)
        self.tried: Synchronized[int] = multiprocessing.Value("i", 0)

    def read(self) -> Counter[str]:
        return Counter(open=self.open.value, tried=self.tried.value)


def _work(crowd: Crowd, place: int, held: Any, tried: Any, stop: Any) -> None:
    asyncio.run(_hold(crowd, place, held, tried, stop))


async def _hold(crowd: Crowd, place: int, held: Any, tried: Any, stop: Any) -> None:
    mine = range(place, crowd.count, crowd.processes)
    tasks = [asyncio.create_task(_one(crowd, number, held, tried)) for number in mine]
    while not stop.is_set():
        await asyncio.sleep(0.2)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def _one(crowd: Crowd, number: int, held: Any, tried: Any) -> None:
    """One of the crowd: opened, held until the server ends it, and opened again after a rest."""
    kind = KINDS[number % len(KINDS)]
    me = f"127.0.{1 + number % crowd.addresses // 200}.{2 + number % crowd.addresses % 200}"
    while True:
        with suppress(OSError, TimeoutError):
            try:
                reader, writer = await asyncio.wait_for(
                    asyncio.open_connection(
                        "127.0.0.1", crowd.port, local_addr=(me, 0),
                        ssl=_unchecked() if crowd.encrypted and kind != "half-open" else None,
                    ),
                    30.0,
                )  # fmt: skip
            except (ConnectionError, ssl.SSLError):
                _count(tried, 1)
                raise
            _count(held, 1)
            _count(tried, 1)
            try:
                await _stay(kind, reader, writer)
            finally:
                _count(held, -1)
                writer.transport.abort()
        await asyncio.sleep(crowd.again_s)


async def _stay(kind: str, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Say what one of that kind says, and read until the server ends it."""
    if kind == "silent websocket":
        writer.write(_HANDSHAKE)
    elif kind == "slow head":
        for byte in _HEAD:
            writer.write(bytes([byte]))
            with suppress(TimeoutError):
                if not await asyncio.wait_for(reader.read(4096), 1.0):
                    return
    while await reader.read(4096):
        pass


@cache
def _unchecked() -> ssl.SSLContext:
    made = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    made.check_hostname, made.verify_mode = False, ssl.CERT_NONE
    return made


def _count(value: Any, by: int) -> None:
    with value.get_lock():
        value.value += by
