"""The console's server: its page, the files of the page, and the connection that answers it."""

from __future__ import annotations

from collections.abc import AsyncIterator
from concurrent.futures import Executor
from contextlib import asynccontextmanager
from importlib.resources import files

from fastapi import FastAPI, Request, Response, WebSocket
from starlette.exceptions import HTTPException as StarletteHTTPException

from tactuator.console.connection import ConsoleConnection
from tactuator.console.file_routes import add_file_routes
from tactuator.console.scope.controls import Controls
from tactuator.console.scope.desk import Desk
from tactuator.console.scope.host import RigHost
from tactuator.console.scope.routes import add_rig
from tactuator.console.study.room import StudyRoom
from tactuator.console.study.routes import add_study
from tactuator.console.workshop import Workshop
from tactuator.web.pages import HEADERS, holds_file, plain_text
from tactuator.web.pages import static_file as shared_file
from tactuator.web.sockets import CLOSE_FORBIDDEN, has_token, same_origin
from tactuator.web.study_pages import StudyPages, add_study_pages

_TYPES = {
    ".css": "text/css",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
    ".html": "text/html",
    ".md": "text/plain",
}
_HEADERS = HEADERS | {"Content-Security-Policy": f"{HEADERS['Content-Security-Policy']}; media-src blob:"}
"""The page plays a sound file that was dropped on it, out of its own memory."""
_NOTHING = "There is no such page here."


def build_console(workshop: Workshop, token: str, apart: Executor | None = None, rig: RigHost | None = None) -> FastAPI:
    """Return the web application of the console; whoever has the token may use it. apart: where figures are computed
    (None: in a thread). rig: the one whose samples the scope shows, if there is one.
    """
    pages, controls = StudyPages(), Controls()
    desk = None if rig is None else Desk(rig, workshop)
    room = None if rig is None or desk is None else StudyRoom(pages, rig, controls, desk, workshop)

    @asynccontextmanager
    async def ended(app: FastAPI) -> AsyncIterator[None]:
        yield
        if room is not None:
            await room.end()

    app = FastAPI(title="tactuator console", docs_url=None, redoc_url=None, openapi_url=None, lifespan=ended)
    add_rig(app, token, rig, desk, controls, apart)
    add_study_pages(app, pages, token)
    add_study(app, token, room, workshop)

    @app.get("/")
    async def page() -> Response:
        return static_file("console.html") or plain_text(_NOTHING, 404)

    @app.get("/static/{name}")
    async def static(name: str) -> Response:
        return static_file(name) or shared_file(name) or plain_text(_NOTHING, 404)

    add_file_routes(app, workshop.drawer, token)

    @app.websocket("/ws")
    async def connection(socket: WebSocket) -> None:
        await socket.accept()
        if not same_origin(socket) or not await has_token(socket, token):
            await socket.close(CLOSE_FORBIDDEN)
            return
        await ConsoleConnection(socket, workshop, apart).serve()

    @app.exception_handler(StarletteHTTPException)
    async def told(request: Request, error: StarletteHTTPException) -> Response:
        return plain_text(_NOTHING, error.status_code)

    @app.exception_handler(Exception)
    async def failed(request: Request, error: Exception) -> Response:
        return plain_text(_NOTHING, 500)

    return app


def static_file(name: str) -> Response | None:
    """Return a part of the page by its bare name, or None where there is none."""
    suffix = name[name.rfind(".") :]
    folder = files("tactuator.console").joinpath("static")
    if suffix not in _TYPES or not holds_file(folder, name):
        return None
    return Response(folder.joinpath(name).read_bytes(), media_type=_TYPES[suffix], headers=_HEADERS)
