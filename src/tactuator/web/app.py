"""The server: pages, the two kinds of connection, and who may open which."""

from __future__ import annotations

import asyncio
import hmac
from urllib.parse import urlsplit

from fastapi import FastAPI, Response, WebSocket, WebSocketDisconnect

from tactuator.web.lab import Lab
from tactuator.web.operator import OperatorPage, Operators
from tactuator.web.pages import page, plain_text, static_file
from tactuator.web.subject import SubjectTab, Tabs

FORBIDDEN, UNKNOWN = 4003, 4004
"""Close codes: not allowed; no such session."""

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
        return plain_text("tactuator: open the link that you were given.\n")

    @app.get("/s/{token}")
    async def subject_page(token: str) -> Response:
        if lab.by_token(token) is None:
            return plain_text("This link opens no session.\n", 404)
        return page("subject", "Experiment", ("noise", "choices", "subject"))

    @app.get("/operator")
    async def operator_page() -> Response:
        return page("operator", "Operator", ("track", "tables", "operator"))

    @app.get("/static/{name}")
    async def static(name: str) -> Response:
        return static_file(name)


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
