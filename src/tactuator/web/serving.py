"""The server's own limits: how long it waits for the head of a request, and how much it may log."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

import h11
from fastapi import FastAPI
from uvicorn import Config
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.http11 import Request, Response

from tactuator.web.gate import Gate
from tactuator.web.pages import HEADERS

HEADER_TIMEOUT_S = 10.0
"""Time in which a request's head has to be there."""
_BACKLOG = 32
"""Connections that are taken before anything else has its turn: a flood of them keeps no answer waiting for long."""
_SWITCHING, _FAILED = 101, 500
_LOGGED_PER_MINUTE = 15
_LOGGERS = ("uvicorn.error", "asyncio", "websockets.server", "tactuator.web.lab")


class LimitedHttp(H11Protocol):
    """One connection, closed where the head of a request does not come."""

    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        """Take the connection, and wait for the head of its first request."""
        super().connection_made(transport)
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        """Remove the connection from those that are open."""
        self._unwatch()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Take bytes; the time runs while the head of a request is not whole."""
        super().data_received(data)
        if self.conn.their_state is not h11.IDLE:
            self._unwatch()
        elif self._deadline is None:
            self._watch()

    def send_400_response(self, msg: str) -> None:
        """Send a refusal of what is no HTTP, with the headers that every page has.

        A request that is being answered ends as if its sender had gone: a second answer cannot follow the first.
        """
        if self.cycle is not None and not self.cycle.response_complete:
            self.cycle.disconnected = True
            self.cycle.message_event.set()
        if self.conn.our_state not in (h11.IDLE, h11.SEND_RESPONSE):
            self.transport.close()
            return
        headers = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
        headers += [(b"content-type", b"text/plain; charset=utf-8"), (b"connection", b"close")]
        body = f"{msg}\n".encode()
        for event in (
            h11.Response(status_code=400, headers=headers, reason=b"Bad Request"),
            h11.Data(data=body),
            h11.EndOfMessage(),
        ):
            self.transport.write(self.conn.send(event) or b"")
        self.transport.close()

    def _watch(self) -> None:
        self._deadline = self.loop.call_later(HEADER_TIMEOUT_S, self.transport.abort)

    def _unwatch(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None


class HeadedWebSocket(WebSocketsSansIOProtocol):
    """A websocket whose refusals by the library itself bear the headers that every page has."""

    def handle_connect(self, event: Request) -> None:
        """Take a request to connect, or refuse one that is amiss."""
        answer = self.conn.accept(event)
        if answer.status_code == _SWITCHING:
            super().handle_connect(event)
            return
        self.handshake_initiated = self.handshake_complete = self.close_sent = True
        self._refuse(answer)
        self.transport.close()

    async def send(self, message: Any) -> None:
        """Send what the application says; a refusal is the end of the handshake, which the library does not note."""
        await super().send(message)
        if message["type"] == "websocket.http.response.body" and self.close_sent:
            self.handshake_complete = True

    def send_500_response(self) -> None:
        """Refuse a request that the application failed over, or that came as the server ended."""
        if not self.handshake_complete and self.initial_response is None:
            self._refuse(self.conn.reject(_FAILED, "Internal Server Error"))

    def _refuse(self, answer: Response) -> None:
        for name, value in HEADERS.items():
            answer.headers[name] = value
        self.conn.send_response(answer)
        self.transport.write(b"".join(self.conn.data_to_send()))


class LogLimit(logging.Filter):
    """Lets so many lines a minute through, and tells with the next how many were left out. clock: seconds.

    Defects are counted by themselves: whoever makes the server warn all the time does not silence them.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        super().__init__()
        self._clock, self._began, self._counts = clock, clock(), Counter[bool]()

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether the record is to be logged."""
        now = self._clock()
        if now - self._began >= 60.0:
            left_out = sum(max(count - _LOGGED_PER_MINUTE, 0) for count in self._counts.values())
            self._began, self._counts = now, Counter()
            if left_out:
                record.msg = f"{record.getMessage()} ({left_out} lines before it were left out)"
                record.args = None
        is_defect = record.levelno >= logging.ERROR
        self._counts[is_defect] += 1
        return self._counts[is_defect] <= _LOGGED_PER_MINUTE


def server_config(app: FastAPI, clock: Callable[[], float], names: Iterable[str] = (), **more: Any) -> Config:
    """Return the configuration of the server with these limits. clock: monotonic, seconds. names: those that the server
    answers to beside this machine's own.
    """
    config = Config(
        Gate(app, names),
        loop="asyncio",  # others take connections past `Listener.accept`
        http=LimitedHttp,
        ws=HeadedWebSocket,
        ws_max_size=65536,
        backlog=_BACKLOG,
        log_level="warning",
        **more,
    )
    for name in _LOGGERS:
        logger = logging.getLogger(name)
        for before in [one for one in logger.filters if isinstance(one, LogLimit)]:
            logger.removeFilter(before)
        logger.addFilter(LogLimit(clock))
    return config
