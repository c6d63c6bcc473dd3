"""The console's server: its page, the files of the page, and the connections that answer it; and how it ends."""

import asyncio
import logging
import os
import signal
import socket
import sys
import threading
from collections.abc import AsyncIterator, Awaitable, Callable
from concurrent.futures import Executor
from contextlib import asynccontextmanager
from importlib.resources import files

import uvicorn
from fastapi import FastAPI, Request, Response, WebSocket

from tactuator.console.experiment_view import StudyAtRig
from tactuator.console.page_connection import ConsoleConnection
from tactuator.console.rig_connection import RigConnection
from tactuator.console.rig_process import RigProcess
from tactuator.console.rig_session import RigSession
from tactuator.console.state import ConsoleState
from tactuator.console.uploads import add_file_routes, bears_token
from tactuator.web.pages import HEADERS, answer_plainly, file_response, plain_text
from tactuator.web.pages import static_file as shared_file
from tactuator.web.server import PageServer
from tactuator.web.sockets import CLOSE_ABSENT, admitted, refuse
from tactuator.web.study_pages import StudyPages, add_study_pages

_HEADERS = HEADERS | {"Content-Security-Policy": f"{HEADERS['Content-Security-Policy']}; media-src blob:"}
"""The page plays an uploaded sound file from its own memory."""
_NOTHING = "There is no such page here."


def build_console(
    state: ConsoleState, token: str, apart: Executor | None = None, rig: RigProcess | None = None
) -> FastAPI:
    """Return the web application of the console, for every holder of the token. apart: where figures are computed
    (None: in a thread). rig: the one whose samples the scope shows, if there is one.
    """
    pages, state.has_rig = StudyPages(), rig is not None
    session = None if rig is None else RigSession(rig, state)
    study = None if session is None else StudyAtRig(pages, session, state)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        if session is not None:
            session.listen()
        yield
        if study is not None:
            await study.end()

    app = FastAPI(title="tactuator console", docs_url=None, redoc_url=None, openapi_url=None, lifespan=lifespan)
    rig_served = None if session is None else lambda socket, at=session: RigConnection(socket, at, apart).serve()
    _add_connection(app, "/ws/rig", token, rig_served)
    add_study_pages(app, pages, token)
    _add_connection(app, "/ws/study", token, None if study is None else study.serve)

    @app.get("/")
    async def page() -> Response:
        return static_file("console.html") or plain_text(_NOTHING, 404)

    @app.get("/static/{name}")
    async def static(name: str) -> Response:
        return static_file(name) or shared_file(name) or plain_text(_NOTHING, 404)

    @app.post("/rest")
    async def rest(request: Request) -> Response:
        """Bring the rig to rest, from whichever view: a connection may be at work on another request of its page."""
        if session is None or not bears_token(request, token):
            return plain_text("That needs a rig, and the token of the page.", 403)
        session.end("rest")
        return plain_text("The rig comes to rest.")

    add_file_routes(app, state.uploads, token)
    _add_connection(app, "/ws", token, lambda socket: ConsoleConnection(socket, state, apart).serve())
    answer_plainly(app, lambda: _NOTHING)
    return app


def _add_connection(app: FastAPI, path: str, token: str, serve: Callable[[WebSocket], Awaitable[None]] | None) -> None:
    """Add an address of pages that have the token. serve: None where the console has no rig."""

    @app.websocket(path)
    async def connection(socket: WebSocket) -> None:
        if not await admitted(socket, token):
            return
        if serve is None:
            await refuse(socket, CLOSE_ABSENT)
        else:
            await serve(socket)


def static_file(name: str) -> Response | None:
    """Return a part of the page by its bare name, or None."""
    return file_response(files("tactuator.console").joinpath("static"), name, _HEADERS)


CONNECTIONS_S = 2.0
"""Time in which the pages have to let go of their connections."""
PATIENCE_S = 3.0
"""Time for what is still computed when all that has to be closed is closed; then the program ends without it."""


class ConsoleServer(PageServer):
    """A server that closes the rig before it waits for anybody's answer.

    close: closes it; may take its time, and may be called again. forget: called at the very end of a program that is
    cut off. What is computed for a page may take half a minute and can neither be interrupted nor be of use to anybody:
    the program does not wait for it.
    """

    def __init__(self, config: uvicorn.Config, close: Callable[[], None], forget: Callable[[], None]) -> None:
        config.timeout_graceful_shutdown = round(CONNECTIONS_S)
        super().__init__(config)
        self._close, self._forget = close, forget

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End the connections and the application, close the rig, and set the time in which the rest has to end."""
        logging.getLogger("uvicorn.error").addFilter(_is_no_cancelling)
        await super().shutdown(sockets)
        closing = threading.Thread(target=self._close)
        closing.start()  # the threads of the loop may all be at work for pages
        while closing.is_alive():
            await asyncio.sleep(0.02)
        cut_off = threading.Timer(PATIENCE_S, self._cut_off)
        cut_off.daemon = True
        cut_off.start()

    def _cut_off(self) -> None:
        self._forget()
        sys.stderr.flush()
        os._exit(128 + (self._captured_signals or [signal.SIGINT])[0])


def _is_no_cancelling(record: logging.LogRecord) -> bool:
    """Return False for what the log says of connections that are ended on purpose."""
    of_cancelling = record.exc_info is not None and record.exc_info[0] is asyncio.CancelledError
    return not of_cancelling and "graceful shutdown exceeded" not in str(record.msg)
