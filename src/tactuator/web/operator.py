"""An operator's connection: snapshots of what goes on, and the commands that an operator may give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from typing import Any

from fastapi import WebSocket

from tactuator.errors import BadInput, visible, within
from tactuator.experiment.protocol.codes import doubts
from tactuator.experiment.protocol.study import Demographic, SubjectPart
from tactuator.experiment.session.session import Running, RunTally, Session
from tactuator.experiment.session.studies import Correction, StudyRecords
from tactuator.experiment.store.records import Found
from tactuator.experiment.store.voids import Part, set_void
from tactuator.plain import picked
from tactuator.web.lab import Lab, LabFault
from tactuator.web.messages import (
    FROM_OPERATOR,
    Command,
    Correct,
    Day,
    Enrol,
    NewVisit,
    OperatorMessage,
    SetVoid,
    message_of,
)
from tactuator.web.sockets import first_to_end, receive_text, send

_REFRESH_S = 1.0
_FIELDS: Mapping[str, tuple[str, str, Mapping[str, object]]] = {
    "code": ("operator.code", "operator.allowed_code", {}),
    "group": ("operator.group", "operator.allowed_group", {}),
    "participant_id": ("operator.participant_id", "operator.allowed_participant_id", {}),
    "reason": ("operator.reason", "operator.allowed_text", {"most": 200}),
    "skin_temperature_c": ("operator.skin_temperature", "operator.allowed_number", {"low": 0, "high": 50}),
    "preload_n": ("operator.contact_force", "operator.allowed_number", {"low": 0, "high": 1000}),
    "trial": ("operator.trial", "operator.allowed_number", {"low": 0, "high": 2**31 - 1}),
}
"""Text of each field of a form by its name in a message, and of what is allowed there with its values."""
_FACT = "demographics."

_SAID = "page"
"""Outermost place of a refusal of a field whose words are the page's own."""


class OperatorPage:
    """One open page of the operator of that name; one has control, the others look on until one takes it."""

    def __init__(self, socket: WebSocket, lab: Lab, who: str) -> None:
        self.socket, self.lab, self.who = socket, lab, who

    async def serve(self) -> None:
        """Serve the page until it closes; it has control if no other has."""
        self.lab.control = self.lab.control or self
        try:
            await self._serve()
        finally:
            if self.lab.control is self:
                self.lab.control = None
            self.lab.notify()

    async def _serve(self) -> None:
        for row in self.lab.sessions:
            with suppress(BadInput):  # of a version that cannot be played here; the subject's page says so
                await self.lab.session(row)
        await first_to_end(self._send_snapshots(), self._handle_commands())

    async def _send_snapshots(self) -> None:
        while True:
            await send(self.socket, self.snapshot())
            await self.lab.until_changed(_REFRESH_S)
            try:
                await self.lab.work(self.lab.watch_clock)
                if not self.lab.store.is_file:
                    await self.lab.refresh()  # other stations enrol as well
            except LabFault:
                continue  # the lab keeps the fault, and the next snapshot shows it

    async def _handle_commands(self) -> None:
        while True:
            try:
                text = await receive_text(self.socket)
                await self._handle(message_of(FROM_OPERATOR, text, "command"))
            except (BadInput, LabFault) as error:
                where = error.where if isinstance(error, BadInput) else ()
                place = where[-1] if where else ""
                reason = error.args[0] if _SAID in where else self._reason(place) or error
                said = {"message": self.lab.words("operator.refused", reason=reason), "field": place.rpartition(".")[2]}
                await send(self.socket, {"type": "refused", **said})

    def _reason(self, place: str) -> str:
        """Return what is allowed in the field of that place of a message, in the page's language; "" for no field."""
        words, field = self.lab.words, place.rpartition(".")[2]
        item = next((each for each in self.lab.study.task.protocol.demographic if each.name == field), None)
        if _FACT in place and item is not None:
            label, (key, values) = item.label, _allowed_fact(item)
        elif _FACT not in place and field in _FIELDS:
            text, key, values = _FIELDS[field]
            label = words(text)
        else:
            return ""
        return words("operator.refused_field", field=label, allowed=words(key, **values))

    async def _handle(self, message: OperatorMessage) -> None:
        if isinstance(message, Command):
            await self._command(message)
            return
        self._require_control()
        done = {"type": "done", "message": ""}
        if isinstance(message, Enrol | Correct):
            self._free(message)
            self._allowed(message)
        if isinstance(message, Enrol):
            part = SubjectPart(**picked(message, "code", "group", "participant_id", "demographics"))
            codes = [row.subject_code for row in self.lab.sessions]
            await self.lab.change(self.who, lambda study: study.enrol(part))
            if found := self._doubts(message, codes, message.code):
                done["message"] = self.lab.words("operator.enrolled", code=message.code, doubts=found)
        elif isinstance(message, NewVisit):
            await self.lab.change(self.who, lambda study: study.add_visit(message.subject))
        elif isinstance(message, Correct):
            given = Correction(message.group, message.participant_id, message.demographics)
            if given == Correction():
                raise BadInput(self.lab.words("operator.refused_same"))
            await self.lab.change(self.who, lambda study: study.correct(message.subject, given, message.reason))
            done["message"] = self._doubts(message, [])
        elif isinstance(message, SetVoid):
            await self._void(message)
        else:
            await self._day(message)
        await self.lab.refresh()
        await send(self.socket, done)

    def _doubts(self, message: Enrol | Correct, codes: Sequence[str], *names: str) -> str:
        """Return what other programs make of these names beside the codes, and of what else the message has."""
        words, given = self.lab.words, (*names, message.group, message.participant_id)
        of_names = (doubt for name in given if name for doubt in doubts(name, codes, words))
        return "; ".join((*of_names, *self.lab.study.task.protocol.doubtful_facts(message.demographics, words)))

    def _allowed(self, message: Enrol | Correct) -> None:
        """Refuse a fact that is not allowed, or is required of a new subject and not given, with its place."""
        protocol = self.lab.study.task.protocol
        new = {item.name: "" for item in protocol.demographic if item.required and isinstance(message, Enrol)}
        for name, value in (new | message.demographics).items():
            with within("command", f"{_FACT}{name}"):
                try:
                    protocol.fact(name, value)
                except BadInput as error:
                    error.where = ()
                    raise

    async def _void(self, message: SetVoid) -> None:
        row = next((each for each in self.lab.sessions if each.id == message.session), None)
        if row is None:
            raise BadInput(f"session {message.session} is not of this study", "one that is")
        if self.lab.active == row.id:
            raise BadInput(self.lab.words("operator.refused_at_rig", subject=row.subject_code))
        part, about = Part(row.visit, message.run, message.trial), (message.void, message.reason)

        def change(study: StudyRecords) -> None:
            set_void(study.connection, study.id, row.subject_code, part, *about, study.now, study.who)

        try:
            await self.lab.change(self.who, change)
        except BadInput:
            raise BadInput(self.lab.words("operator.refused_void")) from None
        await self.lab.reopen(row)

    def _free(self, message: Enrol | Correct) -> None:
        """Refuse, in the page's language, a code or an id that is already taken."""
        new, words = isinstance(message, Enrol), self.lab.words
        code = message.code if isinstance(message, Enrol) else message.subject
        others = [row for row in self.lab.sessions if new or row.subject_code != code]
        if new and any(row.subject_code == code for row in others):
            raise BadInput(words("operator.refused_taken", code=code), where=(_SAID, "code"))
        if message.participant_id is not None and message.participant_id in {row.participant_id for row in others}:
            said = words("operator.refused_id_taken", code=message.participant_id)
            raise BadInput(said, where=(_SAID, "participant_id"))

    async def _day(self, day: Day) -> None:
        if all(row.id != day.session for row in self.lab.sessions):
            raise BadInput(f"session {day.session} is not of this study", "one that is")
        values = (day.skin_temperature_c, day.preload_n)
        await self.lab.change(self.who, lambda study: study.set_day(day.session, *values))

    def _require_control(self) -> None:
        if self.lab.control is not self:
            raise BadInput(self.lab.words("operator.refused_control"))

    async def _command(self, command: Command) -> None:
        if command.type == "take-control":
            self.lab.control = self
            self.lab.notify()
            return
        if command.type == "results":
            await self._results(_session(command))
            return
        self._require_control()
        there = self.lab.active
        if command.type == "start":
            there = _session(command)
            self.lab.start(there)
        elif command.type in ("pause", "resume"):
            self.lab.pause(command.type == "pause")
        elif command.type == "stop":
            await self.lab.stop()
        elif command.type == "clear-fault":
            self.lab.tell(None)
        else:
            await self._give_up_run()
        session = None if there is None else self.lab.opened(there)
        if session is not None and command.type != "clear-fault":
            await self.lab.note(session, command.type, "by the operator", self.who)

    async def _give_up_run(self) -> None:
        session = None if self.lab.active is None else self.lab.opened(self.lab.active)
        if session is None:
            raise BadInput(self.lab.words("operator.refused_no_session"))
        if not self.lab.paused:
            raise BadInput(self.lab.words("operator.refused_not_paused"))
        await self.lab.work(session.stop_run)
        self.lab.calls.pop(session.id, None)
        self.lab.notify()

    async def _results(self, session: int) -> None:
        subject = next((row.subject_code for row in self.lab.sessions if row.id == session), None)
        try:
            tables = await self.lab.results(session)
        except BadInput as error:
            raise BadInput(self.lab.words("operator.refused_no_result") if subject else str(error)) from None
        await send(self.socket, {"type": "results", "subject": subject, "tables": [asdict(table) for table in tables]})

    def snapshot(self) -> dict[str, Any]:
        """Return everything that the page shows."""
        lab = self.lab
        active = None if lab.active is None else lab.opened(lab.active)
        running = None if active is None else active.running
        return {
            **picked(lab, "paused", "fault", "active"),
            **picked(lab.study.task.protocol, study="study.name"),
            "type": "snapshot",
            "control": lab.control is self,
            "calls": list(lab.calls.values()),
            "demographics": [asdict(item) for item in lab.study.task.protocol.demographic],
            "rig": picked(lab.apparatus, "name", "simulated", **_RIG),
            "sessions": [self._session(row) for row in lab.sessions],
            "runs": [] if active is None else [_run(run) for run in active.tally],
            "picture": None if running is None else self._picture(running),
        }

    def _picture(self, running: Running) -> dict[str, Any]:
        planned, trials = running.planned, running.state.trials
        key = "run.so_far" if planned.trials is None else "run.so_far_of"
        title = self.lab.words(key, title=planned.title, trials=trials, count=planned.trials)
        return {"title": title, **running.state.picture()}

    def _session(self, row: Found) -> dict[str, Any]:
        session = self.lab.opened(row.id)
        return {
            **picked(row, *_OF_ROW, subject="subject_code"),
            "group": visible(row.subject_group),
            "demographics": {name: visible(text) for name, text in self.lab.facts.get(row.subject_id, {}).items()},
            "link": f"/s/{row.link_token}",
            "here": row.id in self.lab.tabs,
            "parts": self._parts(row, session),
            **(_NOT_OPENED if session is None else _state(session)),
        }

    def _parts(self, row: Found, session: Session | None) -> list[dict[str, Any]]:
        """Return what of a visit can be void: all of it, each of its runs, and each trial that is; with the reason."""
        words, mine = self.lab.words, {key[1:]: why for key, why in self.lab.voids.items() if key[0] == row.id}
        tally = () if session is None else session.tally
        titles = {run.row: run.planned.title for run in tally if run.row is not None}
        numbers = [(None, None), *((run, None) for run in titles), *(key for key in mine if key[1] is not None)]
        parts = []
        for run, trial in numbers:
            title = words("operator.whole_visit") if run is None else f"{run}: {titles.get(run, '')}"
            title += "" if trial is None else f", {words('operator.trial')} {trial}"
            parts.append({"run": run, "trial": trial, "title": title, "void": mine.get((run, trial))})
        return parts


def _allowed_fact(item: Demographic) -> tuple[str, Mapping[str, object]]:
    """Return the text of what is allowed in an item, with its values."""
    if item.kind == "choice":
        return "operator.allowed_choice", {"choices": ", ".join(item.choices)}
    if item.kind == "text":
        return "operator.allowed_text", {"most": 200}
    low, high = (
        ("-\u221e" if item.low is None else f"{item.low:g}"),
        ("\u221e" if item.high is None else f"{item.high:g}"),
    )
    return "operator.allowed_number", {"low": low, "high": high}


_RIG = {"display": "controller.display.name", "rate_hz": "rig.rate_hz", "channels": "rig.channels"}
_OF_ROW = ("id", "visit", "participant_id", "skin_temperature_c", "preload_n")
_NOT_OPENED = {"stage": None, "progress": 0.0, "left_s": None, "trials": 0, "share_correct": None}


def _state(session: Session) -> dict[str, Any]:
    """Return the state of a session as the page shows it.

    share_correct: of what is answered, practice left out; None while there is nothing.
    """
    counted = [run for run in session.tally if not run.planned.practice]
    answered, right = sum(run.answered for run in counted), sum(run.correct for run in counted)
    share = right / answered if answered else None
    state = picked(session, "stage", "progress", "trials")
    return state | {"left_s": round(session.time_left_s), "share_correct": share}


def _run(run: RunTally) -> dict[str, Any]:
    share = run.correct / run.answered if run.answered else None
    return picked(run, "state", "answered", title="planned.title", of="planned.trials") | {"share_correct": share}


def _session(command: Command) -> int:
    if command.session is None:
        raise BadInput(f"{command.type} without a session", "with one")
    return command.session
