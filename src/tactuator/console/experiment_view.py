"""The view Experiment: protocols and stores to begin from, and the study that is open at the console's rig."""

import asyncio
import shlex
import shutil
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from fastapi import WebSocket, WebSocketDisconnect
from pydantic import Field, StringConstraints

from tactuator.api.experiment import export
from tactuator.console.console_rig import ConsoleRig
from tactuator.console.fields import Name
from tactuator.console.requests import LOGGER, Answer, Functions, View, bound, command_line, serve_requests
from tactuator.console.rig_session import RigSession
from tactuator.console.state import ConsoleState
from tactuator.console.uploads import EXAMPLE, UploadedFiles
from tactuator.errors import BadInput
from tactuator.experiment.export import FORMS
from tactuator.experiment.protocol.file import read_protocol
from tactuator.experiment.protocol.study import StudyProtocol
from tactuator.experiment.session.studies import fresh_token, open_study, task_of
from tactuator.experiment.session.task import Apparatus, SystemClock
from tactuator.experiment.store.store import opened_store, sessions_of
from tactuator.io.shipped import example_names
from tactuator.io.text import require_inside
from tactuator.model.controller import Controller
from tactuator.web.lab import Lab
from tactuator.web.sockets import send
from tactuator.web.study_pages import StudyPages

STORE = "lab.db"
_SHOWN = "seen or heard"
StoreName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_-][A-Za-z0-9._ -]{0,100}\.db$")]
"""Name of a store in the folder of the console: a plain file name."""


def offered(state: ConsoleState) -> Answer:
    """Return what a study can begin from: the protocols that come with the package, the stores of the console's folder,
    and export formats.
    """
    return {
        "protocols": [f"{EXAMPLE}{name}" for name in _shipped()],
        "stores": sorted(path.name for path in state.folder.glob("*.db")),
        "store": STORE,
        "forms": list(FORMS),
    }


def look(state: ConsoleState, protocol: Name) -> Answer:
    """Return what the study of a protocol is, and what its results will lack. Raises BadInput, naming the key, for a
    file that is no protocol.
    """
    read, _ = read_protocol(state.uploads.path(protocol), StudyProtocol)
    return {
        "study": read.study.name,
        "kind": read.asks,
        "language": read.study.language,
        "subjects": [subject.code for subject in read.subject],
        "files": list(read.files),
        "warning": read.warning,
    }


VIEW = View("experiment", "Experiment", {"start": offered, "look": look}, of_rig=True)


@dataclass(frozen=True)
class _Running:
    """The study that is open, and what has to be closed after it."""

    name: str
    store: str
    command: str
    held: ExitStack


class StudyAtRig:
    """At most one study at the console's rig. While one is open, no page of the scope has the controls."""

    def __init__(self, pages: StudyPages, session: RigSession, state: ConsoleState) -> None:
        self._pages, self._session, self._state = pages, session, state
        self._running: _Running | None = None
        self._changing = asyncio.Lock()
        self._stopping: asyncio.Task[None] | None = None
        self._listening: set[WebSocket] = set()

    async def serve(self, socket: WebSocket) -> None:
        """Serve a page until it goes: its requests in turn, and which study is open."""
        self._listening.add(socket)
        try:
            await send(socket, {"study": self.standing()})
            await serve_requests(socket, bound(_STUDY_REQUESTS, self), self._state.uploads)
        except WebSocketDisconnect:
            return
        finally:
            self._listening.discard(socket)

    async def _tell(self) -> None:
        """Send every page the study that is open."""
        for socket in tuple(self._listening):
            try:
                await send(socket, {"study": self.standing()})
            except (WebSocketDisconnect, RuntimeError):
                self._listening.discard(socket)

    def standing(self) -> Answer:
        """Return the study that is open, as a page shows it; `open` is None without one."""
        running = self._running
        if running is None:
            return {"open": None}
        return {"open": {"study": running.name, "store": running.store, "commands": _commands(running)}}

    async def begin(
        self,
        protocol: Name,
        store: StoreName,
        files: Annotated[tuple[Name, ...], Field(max_length=20)] = (),
        auto_start: bool = False,
        amend: Annotated[str, StringConstraints(max_length=400, strip_whitespace=True)] = "",
    ) -> Answer:
        """Begin or resume a study with the controller that is loaded. Raises BadInput as `experiment serve` refuses.

        files: keys of what its protocol names. amend: why the protocol changed.
        """
        try:
            async with self._changing:
                if self._running is not None:
                    raise BadInput(f"the study {self._running.name!r} is open: end it first")
                controller = self._session.loaded_controller()
                self._session.controls.reserve(self._stop)
                try:
                    path = await asyncio.to_thread(together, self._state.uploads, protocol, files)
                    begun = await asyncio.to_thread(self._begun, controller, path, store, auto_start, amend or None)
                    self._pages.lab, self._running = begun
                except BaseException:
                    self._session.controls.free()
                    raise
        finally:
            await self._tell()
        return {}

    def _begun(
        self, controller: Controller, path: Path, store: str, auto_start: bool, amend: str | None
    ) -> tuple[Lab, _Running]:
        with ExitStack() as stack:
            protocol, text = read_protocol(path, StudyProtocol)
            require_inside({"files": list(protocol.files)}, path.parent)
            stack.enter_context(sessions_of(self._state.folder / store))
            process = self._session.rig
            rig = stack.enter_context(ConsoleRig(process))
            rig.rest()  # a page may have left it live
            rig.load(controller)
            place = Apparatus(rig, controller, process.spec)
            task = task_of(protocol, path.parent, place)
            database = stack.enter_context(opened_store(self._state.folder / store))
            study = open_study(database, task, text, SystemClock(), fresh_token, amend, path.parent)
            lab = Lab(study, auto_start, _SHOWN if place.simulated else "")
            stack.callback(lab.close)
            command = command_line(
                "experiment serve",
                path.name,
                store=store,
                rig=process.spec,
                controller="controller.json",
                seed=process.seed or None,
                auto_start=auto_start,
                amend=amend,
            )
            return lab, _Running(protocol.study.name, store, command, stack.pop_all())

    async def end(self) -> Answer:
        """End the study, if one is open: its pages are closed, nothing plays any more, and the rig is free."""
        async with self._changing:
            running, self._running = self._running, None
            if running is not None:
                await self._pages.close()
                try:
                    await asyncio.to_thread(running.held.close)
                finally:
                    self._session.controls.free()
        await self._tell()
        return {}

    def export(self, store: StoreName, form: Name) -> Answer:
        """Return the key of a file with the store's trials in an open format (ZIP)."""
        key, folder = self._state.uploads.new_folder()
        result = export(self._state.folder / store, folder / form, form)
        archive = Path(shutil.make_archive(str(folder / form), "zip", folder, form))
        self._state.uploads.keep(key, archive)
        command = command_line("experiment export", store=store, out=form, format=form)
        return {"key": key, "name": archive.name, "trials": result.trials, "command": command}

    def _stop(self) -> None:
        self._stopping = asyncio.get_running_loop().create_task(self._stopped())

    async def _stopped(self) -> None:
        if self._pages.lab is not None:
            try:
                await self._pages.lab.stop()
            except Exception:
                LOGGER.exception("a stop of the experiment failed")


_STUDY_REQUESTS: Functions = {"begin": StudyAtRig.begin, "end": StudyAtRig.end, "export": StudyAtRig.export}
"""Methods that a page may call once it is connected to the study."""


def _commands(running: _Running) -> list[list[str]]:
    of = f"tactuator experiment {{}} --store {shlex.quote(running.store)}"
    return [
        ["begin or resume the study; start, pause and stop are then on the operator's page", running.command],
        ["enrol a subject", of.format("enrol CODE")],
        ["add a visit", of.format("enrol CODE") + " --visit"],
        ["thresholds so far, and the curve across subjects", of.format("thresholds") + " --curve-out curve.csv"],
        ["export", of.format("export") + " --out tidy --format tidy"],
    ]


def _shipped() -> list[str]:
    toml = [name for name in example_names() if name.endswith(".toml")]
    return [name for name in toml if name == "protocol.toml" or name.startswith("protocols/")]


def together(uploads: UploadedFiles, protocol: str, files: tuple[str, ...]) -> Path:
    """Return a protocol in a folder with the files that were uploaded for it; an example stays where its files are."""
    path = uploads.path(protocol)
    if protocol.startswith(EXAMPLE):
        return path
    _, folder = uploads.new_folder()
    for file in (path, *(uploads.path(key) for key in files)):
        if (folder / file.name).exists():
            raise BadInput(f"two files named {file.name}", "one of each name")
        shutil.copyfile(file, folder / file.name)
    return folder / path.name
