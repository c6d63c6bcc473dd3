"""A listener of few connections, a gate before the application, and heads that must come in time."""

from __future__ import annotations

import asyncio
import logging
import socket
import ssl
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from weakref import WeakKeyDictionary

import h11
from fastapi import FastAPI
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketDisconnect
from uvicorn import Config
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.utils import ClientDisconnected
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.http11 import Request, Response

from tactuator.errors import BadInput
from tactuator.web.pages import HEADERS

CONNECTIONS_MAX, CONNECTIONS_PER_ADDRESS_MAX = 256, 64
"""Open connections in all and from one address: descriptors are left for the store and the rig."""
_BACKLOG = 128


class Listener(socket.socket):
    """A listening socket that ends every connection beyond the limits at once.

    They count from the moment they are taken: before an encrypted one has done its handshake, which costs the server
    more than anything that a connection may ask for, and may never be finished.
    """

    def __init__(self, family: int) -> None:
        super().__init__(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        self._taken: WeakKeyDictionary[socket.socket, str] = WeakKeyDictionary()

    def accept(self) -> tuple[socket.socket, Any]:
        """Take the next connection. Raises ConnectionAbortedError where it is beyond the limits, so that the event loop
        turns to what else there is before the next one.
        """
        taken, address = super().accept()
        theirs = [where for known, where in self._taken.items() if known.fileno() >= 0]
        if len(theirs) >= CONNECTIONS_MAX or theirs.count(address[0]) >= CONNECTIONS_PER_ADDRESS_MAX:
            taken.close()
            raise ConnectionAbortedError
        self._taken[taken] = address[0]
        return taken, address


def listener(host: str, port: int) -> Listener:
    """Return a listening TCP socket; port 0: any that is free. Raises BadInput where it cannot listen there.

    Whoever connects before the server has come up waits. The protocol is named because asyncio sends small messages at
    once (TCP_NODELAY) only on sockets that say they are TCP; without it each message waits 40 ms for the one before.
    """
    if not 0 <= port <= 65535:
        raise BadInput(f"port {port}", "0 to 65535")
    listening = Listener(socket.AF_INET6 if ":" in host else socket.AF_INET)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
    except OSError as error:
        listening.close()
        raise BadInput(f"address {host}, port {port}: {error.strerror or error}", "one that is free") from None
    listening.listen(_BACKLOG)
    return listening


_MISDIRECTED, _FORBIDDEN = 421, 403
_LOCAL_NAME = "localhost"


class Gate:
    """An application behind a check of the request's Host.

    A page of another site may point a name of its own at this machine and then speak for its reader ("DNS rebinding").
    Its requests bear that name, so names other than this machine's are refused; a literal address cannot be pointed
    anywhere else and passes. Refusals bear the headers that every page has, those of websockets too.
    """

    def __init__(self, app: ASGIApp, names: Iterable[str] = ()) -> None:
        self._app = app
        self._names = {_LOCAL_NAME, socket.gethostname().lower(), *(name.lower() for name in names)}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Take a request to the application, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
        elif not self._answers_to(scope):
            await _refuse(scope, send, _MISDIRECTED, "this server does not answer to that name")
        elif scope["type"] == "websocket":
            try:
                await self._app(scope, receive, _Handshake(scope, send))
            except WebSocketDisconnect:  # a page that goes is no error, not even while it is being refused
                raise ClientDisconnected from None
        else:
            await self._app(scope, receive, send)

    def _answers_to(self, scope: Scope) -> bool:
        given = [value.decode("latin-1") for name, value in scope["headers"] if name == b"host"]
        if len(given) != 1:
            return False
        try:
            name = (urlsplit(f"//{given[0]}").hostname or "").rstrip(".")
        except ValueError:
            return False
        return name in self._names or _is_address(name)


class _Handshake:
    """The messages to a websocket: a refusal before it is open becomes a page with the headers."""

    def __init__(self, scope: Scope, send: Send) -> None:
        self._scope, self._send, self._open = scope, send, False

    async def __call__(self, message: Message) -> None:
        self._open = self._open or message["type"] == "websocket.accept"
        if message["type"] == "websocket.close" and not self._open:
            await _refuse(self._scope, self._send, _FORBIDDEN, "there is no such connection")
        else:
            await self._send(message)


async def _refuse(scope: Scope, send: Send, status: int, text: str) -> None:
    kind = "http" if scope["type"] == "http" else "websocket.http"
    headers = [(name.lower().encode(), value.encode()) for name, value in HEADERS.items()]
    headers.append((b"content-type", b"text/plain; charset=utf-8"))
    await send({"type": f"{kind}.response.start", "status": status, "headers": headers})
    await send({"type": f"{kind}.response.body", "body": f"{text}\n".encode()})


def _is_address(name: str) -> bool:
    try:
        ip_address(name)
    except ValueError:
        return False
    return True


HEADER_TIMEOUT_S = 10.0
"""Time in which a request's head has to be there."""
_BEFORE_OTHERS = 32
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
        backlog=_BEFORE_OTHERS,
        log_level="warning",
        **more,
    )
    for name in _LOGGERS:
        logger = logging.getLogger(name)
        for before in [known for known in logger.filters if isinstance(known, LogLimit)]:
            logger.removeFilter(before)
        logger.addFilter(LogLimit(clock))
    return config


_LOOPBACK = ("127.0.0.1", "localhost", "::1")


@dataclass(frozen=True)
class Address:
    """Address of a server, with the names that it answers to.

    names: host names that it answers to beside this machine's own, such as a proxy's. certificate, key: files in PEM
    form, for a connection that is encrypted (TLS); the key may be in the certificate's file. Raises BadInput where they
    do not belong together, cannot be read, or the key has a password.
    """

    host: str = "127.0.0.1"
    port: int = 0
    names: tuple[str, ...] = ()
    certificate: Path | None = None
    key: Path | None = None

    def __post_init__(self) -> None:
        if self.certificate is None:
            if self.key is not None:
                raise BadInput("a TLS key without a certificate", "both, or a certificate with its key")
            return
        for file in (self.certificate, self.key):
            if file is not None and file.is_fifo() and file.parent != Path("/dev/fd"):
                raise BadInput(f"TLS file {file} is a pipe", "a file in PEM form")
        try:
            # without a password of ours OpenSSL would ask at the terminal
            ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(self.certificate, self.key, password="")
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, FileNotFoundError) else "they are no pair without a password"
            files = f"{self.certificate}" if self.key is None else f"{self.certificate} and {self.key}"
            raise BadInput(f"TLS files {files}: {reason}", "a certificate and its key in PEM form") from None

    def listen(self) -> socket.socket:
        """Return the socket that listens there. Raises BadInput where that cannot be."""
        return listener(self.host, self.port)

    def config(self, app: FastAPI, clock: Callable[[], float]) -> Config:
        """Return the configuration of a server of the application there. clock: monotonic, seconds."""
        more: dict[str, Any] = {"host": self.host, "port": self.port}
        if self.certificate is not None:
            more |= {"ssl_certfile": self.certificate, "ssl_keyfile": self.key}
        return server_config(app, clock, (self.host, *self.names), **more)

    def base_url(self, listening: socket.socket) -> str:
        """Return the beginning of every address of the server that listens at the socket."""
        scheme = "http" if self.certificate is None else "https"
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{scheme}://{host}:{listening.getsockname()[1]}"

    @property
    def warning(self) -> str:
        """Return what whoever opens the server to others has to know; empty on the loopback address."""
        if self.host in _LOOPBACK:
            return ""
        open_to = "anyone who can reach this machine can reach these pages"
        return open_to if self.certificate else f"{open_to}; the connection is not encrypted"
