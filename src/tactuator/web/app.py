"""The server: its pages, the two kinds of connection, and the checks of who may open which."""

from __future__ import annotations

from typing import Annotated

from fastapi import FastAPI, Query, Request, Response, WebSocket
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException as StarletteHTTPException

from tactuator.errors import BadInput
from tactuator.web.lab import Lab
from tactuator.web.operator import OperatorPage, Operators
from tactuator.web.pages import page, plain_text, static_file
from tactuator.web.sockets import has_token, same_origin
from tactuator.web.subject import SubjectTab
from tactuator.web.tabs import Tabs

CLOSE_FORBIDDEN, CLOSE_UNKNOWN = 4003, 4004
"""Close codes of connections that are not allowed, or to no known session."""


def build_app(lab: Lab, operator_token: str) -> FastAPI:
    """Return the web application of one lab."""
    app = FastAPI(title="tactuator", docs_url=None, redoc_url=None, openapi_url=None)
    tabs, operators = Tabs(), Operators()
    _pages(app, lab)

    @app.websocket("/ws/subject/{token}")
    async def subject(socket: WebSocket, token: str) -> None:
        await socket.accept()
        row = lab.by_token(token)
        if row is None or not same_origin(socket):
            await socket.close(CLOSE_UNKNOWN)
            return
        tab = SubjectTab(socket, lab, row)
        await tabs.enter(tab)
        lab.notify()
        try:
            await tab.serve()
        finally:
            tabs.exit(tab)
            lab.notify()

    @app.websocket("/ws/operator")
    async def operator(socket: WebSocket) -> None:
        await socket.accept()
        if not same_origin(socket) or not await has_token(socket, operator_token):
            await socket.close(CLOSE_FORBIDDEN)
            return
        page = OperatorPage(socket, lab, tabs, operators)
        operators.enter(page)
        try:
            await page.serve()
        finally:
            operators.exit(page)
            lab.notify()

    return app


def _pages(app: FastAPI, lab: Lab) -> None:
    @app.get("/")
    async def index() -> Response:
        return plain_text(lab.words("page.nothing_here"))

    @app.get("/s/{token}")
    async def subject_page(token: str, participant: Annotated[str | None, Query(max_length=64)] = None) -> Response:
        row = lab.by_token(token)
        if row is None:
            return plain_text(lab.words("page.no_session"), 404)
        presented = await lab.presented(row)
        words = presented.session.task.words
        if participant is not None:
            try:
                await lab.work(lambda: lab.study.claim(row, participant))
            except BadInput:
                return plain_text(words("page.other_participant"), 403)
            await lab.refresh()
        return page("subject", words, ("words", "noise", "choices", "demonstration", "subject"))

    @app.get("/operator")
    async def operator_page() -> Response:
        return page("operator", lab.words, ("words", "track", "curve", "tables", "enrol", "operator"))

    @app.get("/static/{name}")
    async def static(name: str) -> Response:
        return static_file(name) or plain_text(lab.words("page.no_page"), 404)

    @app.exception_handler(StarletteHTTPException)
    async def told(request: Request, error: StarletteHTTPException) -> Response:
        return plain_text(lab.words("page.no_page"), error.status_code)

    @app.exception_handler(Exception)
    async def failed(request: Request, error: Exception) -> Response:
        return plain_text(lab.words("page.no_page"), 500)

    @app.exception_handler(RequestValidationError)
    async def refused(request: Request, error: RequestValidationError) -> Response:
        return plain_text(lab.words("page.no_page"), 422)
