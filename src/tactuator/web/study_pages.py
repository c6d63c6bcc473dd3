"""The pages of a study on any server: subjects' and the operator's, for as long as a lab is open there."""

import asyncio
from collections.abc import Coroutine, Mapping
from typing import Annotated, Any

from fastapi import FastAPI, Query, Request, Response, WebSocket

from tactuator.experiment.store.records import Found
from tactuator.web.lab import Lab
from tactuator.web.operator import OperatorPage
from tactuator.web.pages import HEADERS, answer_plainly, page, plain_text, static_file
from tactuator.web.sockets import CLOSE_ABSENT, refuse, same_origin, who_is
from tactuator.web.subject import SubjectTab

_NOTHING = "There is no such page here."


def build_app(lab: Lab, operators: str | Mapping[str, str]) -> FastAPI:
    """Return the web application of one lab. operators: names by token, or the only one's token."""
    app = FastAPI(title="tactuator", docs_url=None, redoc_url=None, openapi_url=None)
    add_study_pages(app, StudyPages(lab), operators)

    @app.get("/")
    async def index() -> Response:
        return plain_text(lab.words("page.nothing_here"))

    @app.get("/static/{name}")
    async def static(name: str) -> Response:
        return static_file(name) or plain_text(lab.words("page.no_page"), 404)

    answer_plainly(app, lambda: lab.words("page.no_page"))
    return app


class StudyPages:
    """The lab whose pages a server shows (None: no study is open), and the connections to it."""

    def __init__(self, lab: Lab | None = None) -> None:
        self.lab = lab
        self._open: set[asyncio.Task[None]] = set()

    async def serve(self, socket: WebSocket, part: Coroutine[Any, Any, None]) -> None:
        """Serve a connection until its page goes, or the study is closed."""
        task = asyncio.create_task(part)
        self._open.add(task)
        try:
            await asyncio.wait([task])
        finally:
            self._open.discard(task)
            task.cancel()
        if task.cancelled():
            await refuse(socket, CLOSE_ABSENT)
        else:
            task.result()

    async def close(self) -> None:
        """End every connection to the lab, which is for the caller to close."""
        self.lab = None
        while self._open:
            tasks = list(self._open)
            for task in tasks:
                task.cancel()
            await asyncio.wait(tasks)
            self._open.difference_update(tasks)


def add_study_pages(app: FastAPI, pages: StudyPages, operators: str | Mapping[str, str]) -> None:
    """Add the pages of a study and their connections to an application, which serves their static files itself."""
    _add_connections(app, pages, {operators: "operator"} if isinstance(operators, str) else operators)

    @app.get("/s/{token}")
    async def subject_page(token: str) -> Response:
        if pages.lab is None:
            return plain_text(_NOTHING, 404)
        row = await _session_of(pages.lab, token)
        if row is None:
            return plain_text(pages.lab.words("page.no_session"), 404)
        words = (await pages.lab.session(row)).task.words
        return page("subject", words, ("texts", "noise", "choices", "demonstration", "subject"))

    @app.post("/s/{token}")
    async def claim(request: Request, token: str, participant: Annotated[str, Query(max_length=64)]) -> Response:
        """Keep what others call the subject. Not by GET, which mail scanners and previews of links use as well."""
        lab = pages.lab
        row = None if lab is None else await _session_of(lab, token)
        if lab is None or row is None or not same_origin(request):
            return plain_text(_NOTHING, 404)
        if lab.notes_left(row.id) < 0:
            return plain_text(lab.words("page.other_participant"), 403)
        theirs = await lab.change(f"subject {row.subject_code}", lambda study: study.claim(row, participant))
        await lab.refresh()
        if not theirs:
            return plain_text(lab.words("page.other_participant"), 403)
        return Response(status_code=204, headers=HEADERS)

    @app.get("/operator")
    async def operator_page() -> Response:
        if pages.lab is None:
            return plain_text(_NOTHING, 404)
        parts = ("texts", "runs", "tables", "enrol", "operator_panel", "operator")
        return page("operator", pages.lab.words, parts)


async def _session_of(lab: Lab, token: str) -> Found | None:
    if lab.by_token(token) is None and not lab.store.is_file:
        await lab.refresh()  # enrolled at another station
    return lab.by_token(token)


def _add_connections(app: FastAPI, pages: StudyPages, operators: Mapping[str, str]) -> None:
    @app.websocket("/ws/subject/{token}")
    async def subject(socket: WebSocket, token: str) -> None:
        await socket.accept()
        lab = pages.lab
        row = None if lab is None else lab.by_token(token)
        if lab is None or row is None or not same_origin(socket):
            await refuse(socket, CLOSE_ABSENT)
            return
        await pages.serve(socket, SubjectTab(socket, lab, row).serve())

    @app.websocket("/ws/operator")
    async def operator(socket: WebSocket) -> None:
        who = await who_is(socket, operators)
        if who is None:
            return
        if pages.lab is None:
            await refuse(socket, CLOSE_ABSENT)
        else:
            await pages.serve(socket, OperatorPage(socket, pages.lab, who).serve())
