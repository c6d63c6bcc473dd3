"""An operator's connection: what goes on, and the few things that one may ask for."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from fastapi import WebSocket

from tactuator.errors import BadInput
from tactuator.experiment.session.session import RunTally, Session
from tactuator.experiment.store import records
from tactuator.web.lab import Fault, Lab
from tactuator.web.messages import Command, operator_command
from tactuator.web.subject import Tabs, first_to_end, send

_REFRESH_S = 1.0


class Operators:
    """The operators' pages; one has control, the others look on until one takes it."""

    def __init__(self) -> None:
        self._control: OperatorPage | None = None

    def enter(self, page: OperatorPage) -> None:
        """A page opens; it has control if nobody has."""
        if self._control is None:
            self._control = page

    def exit(self, page: OperatorPage) -> None:
        """A page closes."""
        if self._control is page:
            self._control = None

    def take(self, page: OperatorPage) -> None:
        """A page takes control from whoever has it."""
        self._control = page

    def has_control(self, page: OperatorPage) -> bool:
        """Whether commands of that page count."""
        return self._control is page


class OperatorPage:
    """One open page."""

    def __init__(self, socket: WebSocket, lab: Lab, tabs: Tabs, operators: Operators) -> None:
        self.socket, self.lab, self.tabs, self.operators = socket, lab, tabs, operators

    async def attend(self) -> None:
        """Serve the page until it closes."""
        for row in self.lab.sessions:
            await self.lab.conduct(row)
        await first_to_end(self._show(), self._obey())

    async def _show(self) -> None:
        while True:
            await send(self.socket, self.snapshot())
            await self.lab.until_changed(_REFRESH_S)
            try:
                await self.lab.work(self.lab.watch_clock)
            except Fault:
                continue  # the lab has kept it, the next snapshot tells it

    async def _obey(self) -> None:
        while True:
            text = await self.socket.receive_text()
            try:
                await self._command(operator_command(text))
            except (BadInput, Fault) as error:
                await send(self.socket, {"type": "refused", "message": str(error)})

    async def _command(self, command: Command) -> None:
        if command.type == "take-control":
            self.operators.take(self)
            self.lab.notify()
            return
        if command.type == "results":
            await self._results(_session(command))
            return
        if not self.operators.has_control(self):
            raise BadInput("another operator has control; allowed: looking on, or taking control first")
        if command.type == "start":
            self.lab.start(_session(command))
        elif command.type in ("pause", "resume"):
            self.lab.pause(command.type == "pause")
        elif command.type == "stop":
            await self.lab.stop()
        elif command.type == "clear-fault":
            self.lab.tell(None)
        else:
            await self._give_up_run()

    async def _give_up_run(self) -> None:
        conduct = None if self.lab.active is None else self.lab.opened(self.lab.active)
        if conduct is None:
            raise BadInput("no session is at the rig; allowed: giving up a run of one that is")
        if not self.lab.paused:
            raise BadInput("the session is not paused; allowed: giving up a run after pausing")
        await self.lab.work(conduct.give_up_run)
        self.lab.notify()

    async def _results(self, session: int) -> None:
        tables = await self.lab.results(session)
        subject = next(row.subject_code for row in self.lab.sessions if row.id == session)
        await send(self.socket, {"type": "results", "subject": subject, "tables": [asdict(one) for one in tables]})

    def snapshot(self) -> dict[str, Any]:
        """Everything that the page shows."""
        lab = self.lab
        station = lab.task.station
        active = None if lab.active is None else lab.opened(lab.active)
        course = None if active is None else active.session.course
        return {
            "type": "snapshot",
            "study": lab.task.protocol.study.name,
            "control": self.operators.has_control(self),
            "paused": lab.paused,
            "fault": lab.fault,
            "active": lab.active,
            "rig": {
                "name": station.name,
                "display": station.controller.display.name,
                "rate_hz": station.rig.rate_hz,
                "channels": list(station.rig.channels),
            },
            "sessions": [self._session(row) for row in lab.sessions],
            "runs": [] if active is None else [_run(one) for one in active.session.tally],
            "picture": None if course is None else course.picture(),
        }

    def _session(self, row: records.Found) -> dict[str, Any]:
        conduct = self.lab.opened(row.id)
        return {
            "id": row.id,
            "subject": row.subject_code,
            "group": row.subject_group,
            "link": f"/s/{row.link_token}",
            "here": self.tabs.is_open(row.id),
            **(_NOT_OPENED if conduct is None else _standing(conduct.session)),
        }


_NOT_OPENED = {"stage": None, "progress": 0.0, "trials": 0, "share_correct": None}


def _standing(session: Session) -> dict[str, Any]:
    """share_correct: of what is answered, practice left out; None while there is nothing."""
    counted = [one for one in session.tally if not one.planned.practice]
    answered, right = sum(one.answered for one in counted), sum(one.correct for one in counted)
    return {
        "stage": session.stage,
        "progress": session.progress,
        "trials": session.trials,
        "share_correct": right / answered if answered else None,
    }


def _run(one: RunTally) -> dict[str, Any]:
    return {
        "title": one.planned.title,
        "state": one.state,
        "answered": one.answered,
        "of": one.planned.trials,
        "share_correct": one.correct / one.answered if one.answered else None,
    }


def _session(command: Command) -> int:
    if command.session is None:
        raise BadInput(f"{command.type} without a session; allowed: with one")
    return command.session
