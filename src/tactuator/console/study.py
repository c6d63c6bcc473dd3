"""The view Experiment: protocols and stores to begin from, and the study that is open at the console's rig."""

import asyncio
import itertools
import queue
import shlex
import shutil
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from fastapi import WebSocket, WebSocketDisconnect
from numpy.typing import ArrayLike
from pydantic import Field, StringConstraints

from tactuator.api.experiment import export
from tactuator.console import rig_orders as orders
from tactuator.console.requests import (
    LOGGER,
    Answer,
    Name,
    PageRequest,
    Requests,
    ViewRequest,
    command_line,
    serve_requests,
)
from tactuator.console.rig_process import RigProcess
from tactuator.console.rig_session import RigSession
from tactuator.console.state import ConsoleState
from tactuator.console.uploads import UploadedFiles
from tactuator.errors import BadInput, DeviceFault, TimingMissed
from tactuator.experiment.export import FORMS
from tactuator.experiment.protocol.file import JudgingProtocol, read_protocol
from tactuator.experiment.protocol.recognition import RecognitionProtocol
from tactuator.experiment.protocol.study import StudyProtocol
from tactuator.experiment.session.studies import fresh_token, open_study, task_of
from tactuator.experiment.session.task import Apparatus, SystemClock
from tactuator.experiment.store.store import opened_store, sessions_of
from tactuator.io.shipped import EXAMPLES, example_names
from tactuator.model.controller import Controller
from tactuator.rig.rig import Finger, Rig, Trace, join_traces
from tactuator.web.lab import Lab
from tactuator.web.sockets import send
from tactuator.web.study_pages import StudyPages

_SILENT_S = 30.0
"""Time after which a process that tells nothing counts as gone."""
_REST_S = 8.0


class ConsoleRig(Rig):
    """The rig that `process` holds, for one experiment at a time; it stays with the console when this is closed."""

    def __init__(self, process: RigProcess) -> None:
        super().__init__(process.display)
        self._process = process
        self._controller: Controller | None = None
        self._told: queue.SimpleQueue[orders.Presented | None] = queue.SimpleQueue()
        self._numbers = itertools.count(1)
        process.presented = self._told.put

    @property
    def speed(self) -> float | None:
        """Return 1 for a simulated display, which is played in real time; None for one with a time of its own."""
        return 1.0 if self.has_finger_ports else None

    @property
    def has_finger_ports(self) -> bool:
        """Return True where the display is simulated."""
        return self._process.status.touchable

    def finger(self, channel: str) -> Finger:
        """Raise BadInput: the finger ports are those of another process."""
        raise BadInput(f"the finger port of {channel} is the console's", "a touch in the scope")

    def load(self, controller: Controller) -> None:
        """Make the controller the one that runs. Raises BadInput if it is not for this rig."""
        controller.require_runs(self.display)
        self._controller = controller
        if self._process.status.loaded != controller.content_hash:
            self._process.order(orders.LoadOrder(controller))

    def play(self, reference: ArrayLike) -> Trace:
        """Play a reference (n, channels), threshold units."""
        return join_traces(self.stream([reference]), self.rate_hz, self.channels)

    def stream(self, blocks: Iterable[ArrayLike]) -> Iterator[Trace]:
        """Play blocks of reference as one stream; yield the traces as they come. The blocks are handed over at once.

        Raises DeviceFault with its reason where the rig stopped, or has gone; TimingMissed where it may be tried again.
        """
        if self._controller is None:
            raise BadInput("no controller is loaded", "load one before playing a reference")
        if self._process.status.loaded != self._controller.content_hash:
            self._process.order(orders.LoadOrder(self._controller))  # the rig was opened anew
        number = next(self._numbers)
        while not self._told.empty():  # of before
            self._told.get()
        self._began_at, self._rows_played = None, 0
        self._order(orders.PresentOrder(number, tuple(np.asarray(block, dtype=np.float64) for block in blocks)))
        for piece in self._answers(number, _SILENT_S):
            if piece.fault:
                raise (TimingMissed if piece.missed else DeviceFault)(piece.fault)
            if piece.began_at is not None:
                self._began_at = piece.began_at
            if piece.trace is not None:
                count = self._rows_played + len(piece.trace)
                self._rows_played = count if piece.rows_played is None else piece.rows_played
                yield piece.trace

    def drive(self, command_v: ArrayLike) -> Trace:
        """Raise BadInput: an experiment plays through the controller only."""
        raise BadInput("the console's rig is not driven without its controller", "playing a reference")

    def rest(self) -> None:
        """End what plays, and return when the output is at rest, or the rig has gone. Raises DeviceFault where its
        process does not answer.
        """
        number = next(self._numbers)
        self._process.order(orders.AwaitedRestOrder(number))
        try:
            for _ in self._answers(number, _REST_S):
                pass
        except DeviceFault:
            if self._process.status.mode != "gone":  # a process that has ended has brought it to rest
                raise

    def close(self) -> None:
        """Bring the output to rest; the console goes on holding the rig."""
        self.rest()
        self._process.presented = lambda piece: None

    def _order(self, order: orders.Order) -> None:
        if self._process.status.mode == "gone":
            fault = self._process.status.fault
            raise DeviceFault(fault) if fault else DeviceFault("the rig has gone", "open it again")
        self._process.order(order)

    def _answers(self, number: int, patience_s: float) -> Iterator[orders.Presented]:
        """Yield what is told of the order of that number, to its end; what is told of others came late."""
        while True:
            try:
                piece = self._told.get(timeout=patience_s)
            except queue.Empty:
                raise DeviceFault(f"the rig's process has told nothing for {patience_s:g} s") from None
            if piece is None:
                raise DeviceFault("the process that holds the rig has ended", "open the rig again")
            if piece.number == number:
                yield piece
                if piece.over:
                    return


STORE = "lab.db"
_EXAMPLE = "example:"
_SHOWN = "seen or heard"
StoreName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_-][A-Za-z0-9._ -]{0,100}\.db$")]
"""Name of a store in the folder of the console: a plain file name."""


class ExperimentStart(ViewRequest):
    """Request for what a study can begin from."""

    def answer(self, state: ConsoleState) -> Answer:
        """Return the protocols that come with the package, the stores of the console's folder, and export formats."""
        return {
            "protocols": [f"{_EXAMPLE}{name}" for name in _shipped()],
            "stores": sorted(path.name for path in state.folder.glob("*.db")),
            "store": STORE,
            "forms": list(FORMS),
        }


@dataclass(frozen=True)
class ExperimentLook(ViewRequest):
    """Request for what a protocol says, before a study begins from it."""

    protocol: Name

    def answer(self, state: ConsoleState) -> Answer:
        """Return what the study is, and what its results will lack. Raises BadInput, naming the key, for none."""
        protocol, _ = read_protocol(protocol_path(state.uploads, self.protocol), StudyProtocol)
        items = [item.file for item in protocol.item] if isinstance(protocol, RecognitionProtocol) else []
        return {
            "study": protocol.study.name,
            "kind": _kind(protocol),
            "language": protocol.study.language,
            "subjects": [subject.code for subject in protocol.subject],
            "files": [*items, *filter(None, [protocol.study.language_file])],
            "warning": protocol.warning,
        }


def _kind(protocol: StudyProtocol) -> str:
    if isinstance(protocol, JudgingProtocol):
        return protocol.task.kind
    return "recognition" if isinstance(protocol, RecognitionProtocol) else "detection"


@dataclass(frozen=True)
class BeginStudy(PageRequest):
    """Request to begin or resume a study. files: keys of what its protocol names. amend: why the protocol changed."""

    protocol: Name
    store: StoreName
    files: Annotated[tuple[Name, ...], Field(max_length=20)] = ()
    auto_start: bool = False
    amend: Annotated[str, StringConstraints(max_length=400, strip_whitespace=True)] = ""


class EndStudy(PageRequest):
    """Request to end the study: nothing plays any more, its store is closed, and the rig is free."""


@dataclass(frozen=True)
class ExportStudy(PageRequest):
    """Request for the store's trials in an open format, as one file (ZIP), or for its curve across subjects."""

    store: StoreName
    form: Name


REQUESTS = {"experiment.start": ExperimentStart, "experiment.look": ExperimentLook}
"""Requests of the view before a study is open, on the page's own connection."""
_STUDY_REQUESTS: Requests[PageRequest] = {"begin": BeginStudy, "end": EndStudy, "export": ExportStudy}


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
        """Serve a page until it goes: its requests in turn, and every page is told what study is open."""
        self._listening.add(socket)
        try:
            await send(socket, {"study": self.standing()})
            await serve_requests(socket, _STUDY_REQUESTS, self._answer)
        except WebSocketDisconnect:
            return
        finally:
            self._listening.discard(socket)

    async def _answer(self, number: int, request: PageRequest) -> Answer:
        answer: Answer = {}
        try:
            with self._state.uploads.named_plainly():
                match request:
                    case BeginStudy():
                        await self.begin(request)
                    case EndStudy():
                        await self.end()
                    case ExportStudy():
                        answer = await asyncio.to_thread(self.exported, request)
        finally:
            for socket in tuple(self._listening):
                try:
                    await send(socket, {"study": self.standing()})
                except (WebSocketDisconnect, RuntimeError):
                    self._listening.discard(socket)
        return answer

    def standing(self) -> Answer:
        """Return the study that is open, as a page shows it; `open` is None where there is none."""
        running = self._running
        if running is None:
            return {"open": None}
        return {"open": {"study": running.name, "store": running.store, "commands": _commands(running)}}

    async def begin(self, request: BeginStudy) -> None:
        """Begin or resume a study with the controller that is loaded. Raises BadInput as `experiment serve` refuses."""
        async with self._changing:
            if self._running is not None:
                raise BadInput(f"the study {self._running.name!r} is open", "end it first")
            controller = self._session.loaded_controller()
            self._session.controls.reserve(self._stop)
            try:
                self._pages.lab, self._running = await asyncio.to_thread(self._begun, request, controller)
            except BaseException:
                self._session.controls.free()
                raise

    def _begun(self, request: BeginStudy, controller: Controller) -> tuple[Lab, _Running]:
        with ExitStack() as stack:
            store = self._state.folder / request.store
            path = together(self._state.uploads, request.protocol, request.files)
            protocol, text = read_protocol(path, StudyProtocol)
            stack.enter_context(sessions_of(store))
            rig = stack.enter_context(ConsoleRig(self._session.rig))
            rig.rest()  # a page may have left it live
            rig.load(controller)
            place = Apparatus(rig, controller, self._session.rig.spec)
            task = task_of(protocol, path.parent, place)
            database = stack.enter_context(opened_store(store))
            amend = request.amend or None
            study = open_study(database, task, text, SystemClock(), fresh_token, amend, path.parent)
            lab = Lab(study, request.auto_start, _SHOWN if place.simulated else "")
            stack.callback(lab.close)
            command = self._command(request, path.name)
            return lab, _Running(protocol.study.name, request.store, command, stack.pop_all())

    async def end(self) -> None:
        """End the study, if one is open: its pages are told, nothing plays any more, and the rig is free."""
        async with self._changing:
            running, self._running = self._running, None
            if running is None:
                return
            await self._pages.close()
            try:
                await asyncio.to_thread(running.held.close)
            finally:
                self._session.controls.free()

    def exported(self, request: ExportStudy) -> Answer:
        """Return the key of a file with the store's trials in that format."""
        key, folder = self._state.uploads.new_folder()
        result = export(self._state.folder / request.store, folder / request.form, request.form)
        archive = Path(shutil.make_archive(str(folder / request.form), "zip", folder, request.form))
        self._state.uploads.keep(key, archive)
        command = command_line("experiment export", store=request.store, out=request.form, format=request.form)
        return {"key": key, "name": archive.name, "trials": result.trials, "command": command}

    def _stop(self) -> None:
        self._stopping = asyncio.get_running_loop().create_task(self._stopped())

    async def _stopped(self) -> None:
        if self._pages.lab is not None:
            try:
                await self._pages.lab.stop()
            except Exception:
                LOGGER.exception("a stop of the experiment failed")

    def _command(self, request: BeginStudy, protocol: str) -> str:
        rig = self._session.rig
        return command_line(
            "experiment serve",
            protocol,
            store=request.store,
            rig=rig.spec,
            controller="controller.json",
            seed=rig.seed or None,
            auto_start=request.auto_start,
            amend=request.amend or None,
        )


def _commands(running: _Running) -> list[list[str]]:
    of = f"tactuator experiment {{}} --store {shlex.quote(running.store)}"
    return [
        ["begin or resume the study; start, pause and stop are then on the operator's page", running.command],
        ["enrol a subject", of.format("enrol CODE")],
        ["add a visit", of.format("enrol CODE") + " --visit"],
        ["thresholds so far, and the curve across subjects", of.format("thresholds") + " --curve-out curve.csv"],
        ["export", of.format("export") + " --out tidy --format tidy"],
    ]


def protocol_path(uploads: UploadedFiles, key: str) -> Path:
    """Return the protocol file of a key: one that was uploaded, or an example. Raises BadInput for one that is none."""
    name = key.removeprefix(_EXAMPLE)
    return EXAMPLES / name if key.startswith(_EXAMPLE) and name in _shipped() else uploads.path(key)


def _shipped() -> list[str]:
    toml = [name for name in example_names() if name.endswith(".toml")]
    return [name for name in toml if name == "protocol.toml" or name.startswith("protocols/")]


def together(uploads: UploadedFiles, protocol: str, files: tuple[str, ...]) -> Path:
    """Return a protocol in a folder with the files that were uploaded for it; an example stays where its files are."""
    path = protocol_path(uploads, protocol)
    if protocol.startswith(_EXAMPLE):
        return path
    _, folder = uploads.new_folder()
    for file in (path, *(uploads.path(key) for key in files)):
        if (folder / file.name).exists():
            raise BadInput(f"two files named {file.name}", "one of each name")
        shutil.copyfile(file, folder / file.name)
    return folder / path.name
