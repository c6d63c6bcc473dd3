"""The server's gate: the names that it answers to, and refusals of connections that are not open yet."""

from __future__ import annotations

import socket
from collections.abc import Iterable
from ipaddress import ip_address
from urllib.parse import urlsplit

from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketDisconnect
from uvicorn.protocols.utils import ClientDisconnected

from tactuator.web.pages import HEADERS

_MISDIRECTED, _FORBIDDEN = 421, 403
_LOOPBACK = "localhost"


class Gate:
    """An application behind a check of the request's Host.

    A page of another site may point a name of its own at this machine and then speak for its reader ("DNS rebinding").
    Its requests bear that name, so names other than this machine's are refused; a literal address cannot be pointed
    anywhere else and passes. Refusals bear the headers that every page has, those of websockets too.
    """

    def __init__(self, app: ASGIApp, names: Iterable[str] = ()) -> None:
        self._app = app
        self._names = {_LOOPBACK, socket.gethostname().lower(), *(name.lower() for name in names)}

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
