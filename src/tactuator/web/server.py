"""The server of the pages: where it listens, the names that it answers to, its limits and its encryption."""

from __future__ import annotations

import logging
import socket
import ssl
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import h11
import uvicorn
from fastapi import FastAPI
from starlette.datastructures import Headers
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from tactuator.errors import BadInput, visible

CONNECTIONS_MAX = 256
"""Open connections beyond which uvicorn answers new requests with 503."""
MESSAGE_MAX_BYTES = 65536
_HEAD_MAX_BYTES, _IDLE_S = 16384, 5
"""Length of a request's head, and time that a connection without a request stays open after one."""
_LINE_MAX_BYTES, _LINES_MAX = 8000, 100
"""Below what `websockets` takes of a head: beyond its own bounds it neither answers nor closes."""
_LOOPBACK = ("127.0.0.1", "localhost", "::1")


class _Http(H11Protocol):
    """HTTP that refuses a connection to a page whose head is too long for it, instead of leaving it open."""

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        lines = [event.target, *(name + value for name, value in event.headers)]
        if len(lines) > _LINES_MAX or max(map(len, lines)) > _LINE_MAX_BYTES:
            self.send_400_response("The head of the request is too long.")
        else:
            super().handle_websocket_upgrade(event)


class TrustedHosts(TrustedHostMiddleware):
    """Refuse requests under a name that is not this machine's.

    Another site may point its own name at this machine and then speak for its reader ("DNS rebinding"). A literal
    address cannot be pointed anywhere else: it passes.
    """

    def __init__(self, app: ASGIApp, names: Iterable[str] = ()) -> None:
        super().__init__(app, ["localhost", socket.gethostname(), *names], www_redirect=False)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Take a request to the application, or refuse it."""
        if scope["type"] == "lifespan" or _is_address(Headers(scope=scope).get("host", "")):
            await self.app(scope, receive, send)
        else:
            await super().__call__(scope, receive, send)


def _is_address(host: str) -> bool:
    try:
        ip_address(urlsplit(f"//{host}").hostname or "")
    except ValueError:
        return False
    return True


@dataclass(frozen=True)
class Address:
    """Address of a server, with the names that it answers to.

    names: host names that it answers to beside this machine's own, such as a proxy's. certificate, key: files in PEM
    form, for a connection that is encrypted (TLS); the key may be in the certificate's file. Raises BadInput where they
    do not belong together, cannot be read, or the key has a password, and for a port or a name that cannot be one.
    """

    host: str = "127.0.0.1"
    port: int = 0
    names: tuple[str, ...] = ()
    certificate: Path | None = None
    key: Path | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.port <= 65535:
            raise BadInput(f"port {self.port}", "0 to 65535")
        if amiss := [name for name in self.names if "*" in name]:
            raise BadInput(f"host name {amiss[0]}", "a name without *")
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
        """Return a socket that listens there; port 0: any that is free. Raises BadInput where that cannot be.

        The protocol is named because asyncio sends small messages at once (TCP_NODELAY) only on sockets that say they
        are TCP; without it each message waits 40 ms for the one before.
        """
        family = socket.AF_INET6 if ":" in self.host else socket.AF_INET
        listening = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((self.host, self.port))
        except OSError as error:
            listening.close()
            where = f"address {self.host}, port {self.port}: {error.strerror or error}"
            raise BadInput(where, "one that is free") from None
        listening.listen()  # a page that connects before the server has come up waits
        return listening

    def config(self, app: FastAPI, **more: Any) -> uvicorn.Config:
        """Return the configuration of a server of the application there. more: of uvicorn's own."""
        return uvicorn.Config(
            TrustedHosts(app, (self.host, *self.names)),
            http=_Http,
            ws_max_size=MESSAGE_MAX_BYTES,
            limit_concurrency=CONNECTIONS_MAX,
            h11_max_incomplete_event_size=_HEAD_MAX_BYTES,
            timeout_keep_alive=_IDLE_S,
            log_config=None,
            log_level="warning",
            ssl_certfile=self.certificate,
            ssl_keyfile=self.key,
            **more,
        )

    def base_url(self, listening: socket.socket) -> str:
        """Return the beginning of every address of the server that listens at the socket."""
        scheme = "http" if self.certificate is None else "https"
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{scheme}://{host}:{listening.getsockname()[1]}"

    @property
    def warning(self) -> str:
        """Return what a person who opens the server to others must know; empty on the loopback address."""
        if self.host in _LOOPBACK:
            return ""
        open_to = "anyone who can reach this machine can reach these pages"
        return open_to if self.certificate else f"{open_to}; the connection is not encrypted"


class _Visible(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return visible(super().format(record))


def _log_visibly() -> None:
    """Let the log show what a request may hold as escapes, and be silent on requests that are none."""
    handler = logging.StreamHandler()
    handler.setFormatter(_Visible("%(levelname)s: %(message)s"))
    handler.addFilter(_tells_of_us)
    logging.basicConfig(handlers=[handler], level=logging.WARNING)


_NO_REQUEST = (
    "Invalid HTTP request received.",
    "ASGI callable returned without completing handshake.",
    "Invalid UTF-8 sequence received from client.",
)


def _tells_of_us(record: logging.LogRecord) -> bool:
    """Return False for what uvicorn logs of each request that is none: strangers may send any number."""
    broken = record.exc_info is not None and record.exc_info[0] is h11.LocalProtocolError
    return record.msg not in _NO_REQUEST and not broken


class PageServer(uvicorn.Server):
    """A server that writes its address once its signals are set: a Ctrl-C before would be a warning of asyncio.

    said: what standard error says then, a line each.
    """

    said: Iterable[str] = ()

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Begin to answer, then write the lines."""
        await super().startup(sockets)
        sys.stderr.write("".join(f"{visible(line)}\n" for line in self.said))
        sys.stderr.flush()


def run_server(
    app: FastAPI,
    address: Address,
    listening: socket.socket,
    lines: Callable[[str], Iterable[str]],
    server: Callable[[uvicorn.Config], PageServer] = PageServer,
) -> None:
    """Serve an application until interrupted. lines: what standard error says first, given the beginning of every
    address.
    """
    _log_visibly()
    running = server(address.config(app))
    running.said = [*lines(address.base_url(listening)), *filter(None, [address.warning])]
    running.run(sockets=[listening])
