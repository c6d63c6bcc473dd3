"""The server: pages, the two kinds of connection, and who may open which."""

from __future__ import annotations

import asyncio
import hmac
from importlib.resources import files
from urllib.parse import urlsplit

from fastapi import FastAPI, Response, WebSocket, WebSocketDisconnect
from fastapi.responses import PlainTextResponse

from tactuator.web.lab import Lab
from tactuator.web.operator import OperatorPage, Operators
from tactuator.web.subject import SubjectTab, Tabs

FORBIDDEN, UNKNOWN = 4003, 4004
"""Close codes: not allowed; no such session."""

_TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; connect-src 'self' ws: wss:; frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}
_PATIENCE_S = 10.0


def build_app(lab: Lab, operator_token: str) -> FastAPI:
    """The application of one lab."""
    app = FastAPI(title="tactuator", docs_url=None, redoc_url=None, openapi_url=None)
    tabs, operators = Tabs(), Operators()
    _pages(app, lab)

    @app.websocket("/ws/subject/{token}")
    async def subject(socket: WebSocket, token: str) -> None:
        await socket.accept()
        row = lab.by_token(token)
        if row is None or not _same_origin(socket):
            await socket.close(UNKNOWN)
            return
        tab = SubjectTab(socket, lab, row)
        await tabs.enter(tab)
        lab.notify()
        try:
            await tab.attend()
        finally:
            tabs.exit(tab)
            lab.notify()

    @app.websocket("/ws/operator")
    async def operator(socket: WebSocket) -> None:
        await socket.accept()
        if not _same_origin(socket) or not await _knows(socket, operator_token):
            await socket.close(FORBIDDEN)
            return
        page = OperatorPage(socket, lab, tabs, operators)
        operators.enter(page)
        try:
            await page.attend()
        finally:
            operators.exit(page)
            lab.notify()

    return app


def _pages(app: FastAPI, lab: Lab) -> None:
    @app.get("/")
    async def index() -> Response:
        return PlainTextResponse("tactuator: open the link that you were given.\n", headers=_HEADERS)

    @app.get("/s/{token}")
    async def subject_page(token: str) -> Response:
        if lab.by_token(token) is None:
            return PlainTextResponse("This link opens no session.\n", status_code=404, headers=_HEADERS)
        return _file("subject.html")

    @app.get("/operator")
    async def operator_page() -> Response:
        return _file("operator.html")

    @app.get("/static/{name}")
    async def static(name: str) -> Response:
        return _file(name)


def _file(name: str) -> Response:
    """A page of the package, by its bare name."""
    resource = files("tactuator.web").joinpath("static", name)
    suffix = name[name.rfind(".") :]
    if "/" in name or suffix not in _TYPES or not resource.is_file():
        return PlainTextResponse("There is no such page.\n", status_code=404, headers=_HEADERS)
    return Response(resource.read_bytes(), media_type=_TYPES[suffix], headers=_HEADERS)


def _same_origin(socket: WebSocket) -> bool:
    """Whether the page that connects came from this server: another site's page may not speak for its reader."""
    origin = socket.headers.get("origin")
    return origin is None or urlsplit(origin).netloc == socket.headers.get("host")


async def _knows(socket: WebSocket, token: str) -> bool:
    """Whether the first message is the operator's token."""
    try:
        said = await asyncio.wait_for(socket.receive_text(), _PATIENCE_S)
    except (TimeoutError, WebSocketDisconnect):
        return False
    return hmac.compare_digest(said.encode(), token.encode())
