"""The console's server: its page, the files of the page, and the connections that answer it."""

from __future__ import annotations

from collections.abc import AsyncIterator
from concurrent.futures import Executor
from contextlib import asynccontextmanager
from importlib.resources import files

from fastapi import FastAPI, Response, WebSocket

from tactuator.console.connection import ConsoleConnection
from tactuator.console.rig_connection import add_rig
from tactuator.console.rig_process import RigProcess
from tactuator.console.rig_session import RigSession
from tactuator.console.state import ConsoleState
from tactuator.console.study import StudyAtRig, add_study
from tactuator.console.uploads import add_file_routes
from tactuator.web.pages import HEADERS, answer_plainly, file_response, plain_text
from tactuator.web.pages import static_file as shared_file
from tactuator.web.sockets import admitted
from tactuator.web.study_pages import StudyPages, add_study_pages

_HEADERS = HEADERS | {"Content-Security-Policy": f"{HEADERS['Content-Security-Policy']}; media-src blob:"}
"""The page plays a sound file that was uploaded, out of its own memory."""
_NOTHING = "There is no such page here."


def build_console(
    state: ConsoleState, token: str, apart: Executor | None = None, rig: RigProcess | None = None
) -> FastAPI:
    """Return the web application of the console; whoever has the token may use it. apart: where figures are computed
    (None: in a thread). rig: the one whose samples the scope shows, if there is one.
    """
    pages, state.has_rig = StudyPages(), rig is not None
    session = None if rig is None else RigSession(rig, state)
    study = None if session is None else StudyAtRig(pages, session, state)

    @asynccontextmanager
    async def ended(app: FastAPI) -> AsyncIterator[None]:
        yield
        if study is not None:
            await study.end()

    app = FastAPI(title="tactuator console", docs_url=None, redoc_url=None, openapi_url=None, lifespan=ended)
    add_rig(app, token, session, apart)
    add_study_pages(app, pages, token)
    add_study(app, token, study)

    @app.get("/")
    async def page() -> Response:
        return static_file("console.html") or plain_text(_NOTHING, 404)

    @app.get("/static/{name}")
    async def static(name: str) -> Response:
        return static_file(name) or shared_file(name) or plain_text(_NOTHING, 404)

    add_file_routes(app, state.uploads, token)

    @app.websocket("/ws")
    async def connection(socket: WebSocket) -> None:
        if await admitted(socket, token):
            await ConsoleConnection(socket, state, apart).serve()

    answer_plainly(app, lambda: _NOTHING)
    return app


def static_file(name: str) -> Response | None:
    """Return a part of the page by its bare name, or None where there is none."""
    return file_response(files("tactuator.console").joinpath("static"), name, _HEADERS)
