"""The study that is open at the console's rig: begun from a protocol and a store, and ended."""

from __future__ import annotations

import asyncio
import logging
import shlex
import shutil
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from tactuator.console.asked import Answer
from tactuator.console.scope.controls import Controls
from tactuator.console.scope.desk import Desk
from tactuator.console.scope.host import RigHost
from tactuator.console.study.messages import BeginStudy, ExportStudy
from tactuator.console.study.rig import ConsoleRig
from tactuator.console.views.experiment import together
from tactuator.console.workshop import Workshop
from tactuator.errors import BadInput
from tactuator.experiment.export.export import export
from tactuator.experiment.protocol.file import read_any_protocol
from tactuator.experiment.session.studies import fresh_token, open_study, task_of
from tactuator.experiment.session.task import Apparatus, SystemClock
from tactuator.experiment.store.store import Store, opened_store, sessions_of
from tactuator.model.controller import Controller
from tactuator.web.lab import Lab
from tactuator.web.study_pages import StudyPages

_SHOWN = "seen or heard"
_LOGGER = logging.getLogger("tactuator.web.lab")


@dataclass(frozen=True)
class _Running:
    """The study that is open, and what has to be closed after it."""

    name: str
    store: str
    command: str
    held: ExitStack


class StudyRoom:
    """At most one study at the rig that `host` holds. While one is open, no page of the scope has the controls."""

    def __init__(self, pages: StudyPages, host: RigHost, controls: Controls, desk: Desk, workshop: Workshop) -> None:
        self._pages, self._host, self._controls = pages, host, controls
        self._desk, self._workshop = desk, workshop
        self._running: _Running | None = None
        self._changing = asyncio.Lock()
        self._stopping: asyncio.Task[None] | None = None

    def standing(self) -> Answer:
        """Return the study that is open, as a page shows it; `open` is None where there is none."""
        one = self._running
        if one is None:
            return {"open": None}
        return {"open": {"study": one.name, "store": one.store, "commands": _commands(one)}}

    async def begin(self, request: BeginStudy) -> None:
        """Begin or resume a study with the controller that is loaded. Raises BadInput as `experiment serve` refuses."""
        async with self._changing:
            if self._running is not None:
                raise BadInput(f"the study {self._running.name!r} is open", "end it first")
            controller = self._desk.loaded_controller()
            self._controls.reserve(self._stop)
            try:
                self._pages.lab, self._running = await asyncio.to_thread(self._begun, request, controller)
            except BaseException:
                self._controls.free()
                raise

    def _begun(self, request: BeginStudy, controller: Controller) -> tuple[Lab, _Running]:
        with ExitStack() as stack:
            store = self._workshop.folder / request.store
            path = together(self._workshop.drawer, request.protocol, request.files)
            protocol, text = read_any_protocol(path)
            stack.enter_context(sessions_of(store))
            rig = stack.enter_context(ConsoleRig(self._host))
            rig.rest()  # a page may have left it live
            rig.load(controller)
            place = Apparatus(rig, controller, self._host.spec)
            task = task_of(protocol, path.parent, place)
            database = stack.enter_context(opened_store(store))
            amend = request.amend or None
            study = open_study(database, task, text, SystemClock(), fresh_token, amend, path.parent)
            lab = Lab(study, request.auto_start, _SHOWN if place.simulated else "")
            command = self._command(request, path.name)
            return lab, _Running(protocol.study.name, request.store, command, stack.pop_all())

    async def end(self) -> None:
        """End the study, if one is open: its pages are told, nothing plays any more, and the rig is free."""
        async with self._changing:
            running, self._running = self._running, None
            if running is None:
                return
            lab = await self._pages.close()
            try:
                await asyncio.to_thread(_closed, lab, running)
            finally:
                self._controls.free()

    async def exported(self, request: ExportStudy) -> Answer:
        """Return the key of a file with the store's trials in that format."""
        return await asyncio.to_thread(self._exported, request)

    def _exported(self, request: ExportStudy) -> Answer:
        key, place = self._workshop.drawer.place()
        store = Store(self._workshop.folder / request.store, must_exist=True)
        try:
            trials = export(store, place / request.form, request.form)
        finally:
            store.close()
        made = Path(shutil.make_archive(str(place / request.form), "zip", place, request.form))
        self._workshop.drawer.keep(key, made)
        words = ["tactuator", "experiment", "export", "--store", request.store, "--out", request.form]
        return {
            "key": key,
            "name": made.name,
            "trials": trials,
            "command": shlex.join([*words, "--format", request.form]),
        }

    def _stop(self) -> None:
        """Stop at once what the experiment plays, as its operator's Stop does."""
        self._stopping = asyncio.get_running_loop().create_task(self._stopped())

    async def _stopped(self) -> None:
        lab = self._pages.lab
        if lab is not None:
            try:
                await lab.stop()
            except Exception:
                _LOGGER.exception("a stop of the experiment failed")

    def _command(self, request: BeginStudy, protocol: str) -> str:
        words = ["tactuator", "experiment", "serve", protocol, "--store", request.store, "--rig", self._host.spec]
        words += ["--controller", "controller.json"]
        words += ["--seed", str(self._host.seed)] if self._host.seed else []
        words += ["--auto-start"] if request.auto_start else []
        words += ["--amend", request.amend] if request.amend else []
        return shlex.join(words)


def _closed(lab: Lab | None, running: _Running) -> None:
    with running.held:
        if lab is not None:
            lab.close()


def _commands(one: _Running) -> list[list[str]]:
    """Return what can be done in the view, and the command that does the same."""
    of = f"tactuator experiment {{}} --store {shlex.quote(one.store)}"
    return [
        ["begin or resume the study; start, pause and stop are then on the operator's page", one.command],
        ["enrol a subject", of.format("enrol CODE")],
        ["add a visit", of.format("enrol CODE") + " --visit"],
        ["thresholds so far, and the curve across subjects", of.format("thresholds") + " --curve-out curve.csv"],
        ["export", of.format("export") + " --out tidy --format tidy"],
    ]
