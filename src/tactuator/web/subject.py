"""A subject's connection: presents trials, takes answers, and acknowledges each only when it is in the store."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Any

from fastapi import WebSocket, WebSocketDisconnect

from tactuator.errors import BadInput
from tactuator.experiment.session.presented_session import Conduct
from tactuator.experiment.session.standing import Acknowledged
from tactuator.experiment.store import records
from tactuator.experiment.store.cells import Found
from tactuator.experiment.trial.presenter import Halted, Watch
from tactuator.web.lab import Fault, Lab, RigAtRest
from tactuator.web.messages import (
    AnswerMessage,
    Consent,
    Decline,
    Pause,
    Ready,
    SubjectMessage,
    Withdraw,
    subject_message,
)
from tactuator.web.sockets import first_to_end, receive_text, send

ELSEWHERE = 4001
"""Close code: the session was opened in another tab."""

_LOOK_AGAIN_S = 5.0
_WAITING = 32
"""Messages that wait to be looked at; a page that says more than that is read no further until they are."""


@dataclass(frozen=True)
class _Said:
    """A message and when it arrived, by the server's two clocks."""

    message: SubjectMessage
    received: datetime
    received_s: float


class _Interrupted(Exception):
    """The subject pauses, stops or leaves, whatever was going on."""

    def __init__(self, message: Pause | Withdraw) -> None:
        super().__init__()
        self.message = message


class SubjectTab:
    """One open page."""

    def __init__(self, socket: WebSocket, lab: Lab, row: Found) -> None:
        self.socket, self.lab, self.row = socket, lab, row
        self._messages: asyncio.Queue[_Said] = asyncio.Queue(_WAITING)

    @property
    def session(self) -> int:
        """Its row in the store."""
        return int(self.row.id)

    async def leave(self) -> None:
        """Another tab took over."""
        with suppress(WebSocketDisconnect, RuntimeError):  # it may have gone already
            await self._send(type="elsewhere")
            await self.socket.close(ELSEWHERE)

    async def attend(self) -> None:
        """Serve the page until it closes."""
        conduct = await self.lab.conduct(self.row)
        await self._send(type="hello", **self._about(conduct))
        await first_to_end(self._read(), self._flow(conduct))

    async def _read(self) -> None:
        while True:
            try:
                message = subject_message(await receive_text(self.socket))
            except BadInput as error:
                await self._send(type="refused", message=str(error))
                continue
            if isinstance(message, Pause | Withdraw):
                self.lab.halt(self.session)
            clock = self.lab.clock
            await self._messages.put(_Said(message, clock.utc(), clock.monotonic_s()))

    async def _flow(self, conduct: Conduct) -> None:
        """What the subject does, one stage after another, until it is interrupted; then that.

        A pause may be interrupted in its turn: the subject leaves.
        """
        interruption: Pause | Withdraw | None = None
        while True:
            try:
                if interruption is None:
                    await self._step(conduct)
                else:
                    now, interruption = interruption, None
                    await self._interrupted(conduct, now)
            except _Interrupted as interrupted:
                interruption = interrupted.message

    async def _step(self, conduct: Conduct) -> None:
        session = conduct.session
        stage = session.stage
        await self._stage(conduct)
        if stage in ("done", "ended"):
            self.lab.release(self.session)
            await self._answered()
        elif stage == "consent":
            await self._agreed(conduct)
        else:
            await self._ready(stage)
            if stage == "trial":
                await self._trials(conduct)
            elif session.stage == stage:  # the operator may have given up the run meanwhile
                await self._saved({"break": session.end_break, "introduction": session.introduce}[stage])

    async def _trials(self, conduct: Conduct) -> None:
        """Trial after trial until the stage changes, or something fails: then the subject says when to go on."""
        session = conduct.session
        while session.stage == "trial":
            if not self.lab.may_play(self.session):
                await self._stage(conduct)
                await self._until_changed()
                continue
            await self._send(type="playing")
            try:
                stands = await self.lab.present(conduct, self._watch(conduct))
            except Halted:
                await self._stage(conduct)
                self._next_interruption()
                continue
            except Fault as fault:
                await self._fault(conduct, fault)
                return
            self.lab.notify()
            await self._send(type="answer-now", run=stands.run, number=stands.trial.number)
            await self._answered(conduct)
            await asyncio.sleep(session.task.rules.feedback_s)

    def _next_interruption(self) -> None:
        """Raise what halted the trial, where it was this page that did; what was said before it came too late."""
        while not self._messages.empty():
            message = self._messages.get_nowait().message
            if isinstance(message, Pause | Withdraw):
                raise _Interrupted(message)

    async def _until_changed(self) -> None:
        """Wait for the lab to change, attending to what the page says meanwhile."""
        change = asyncio.create_task(self.lab.until_changed(_LOOK_AGAIN_S))
        said = asyncio.create_task(self._messages.get())
        try:
            await asyncio.wait([change, said], return_when=asyncio.FIRST_COMPLETED)
        finally:
            change.cancel()
            if not said.done():
                said.cancel()
        if said.done() and not said.cancelled():
            await self._take(said.result())

    async def _agreed(self, conduct: Conduct) -> None:
        while True:
            message = await self._next()
            if isinstance(message, Consent):
                await self._saved(conduct.session.give_consent)
                return
            if isinstance(message, Decline):
                await self._saved(conduct.session.decline)
                return

    async def _ready(self, stage: str) -> None:
        """Wait until the subject goes on from that stage; what was said of another one came late and counts no more."""
        while True:
            message = await self._next()
            if isinstance(message, Ready) and message.stage == stage:
                return

    async def _answered(self, conduct: Conduct | None = None) -> None:
        """Wait for the answer to what was played (without a conduct: for ever)."""
        while conduct is None or conduct.pending is not None:
            await self._next()

    async def _next(self) -> SubjectMessage:
        """The next message; answers, also those that are sent again, are saved and acknowledged at any time."""
        return await self._take(await self._messages.get())

    async def _take(self, said: _Said) -> SubjectMessage:
        if isinstance(said.message, AnswerMessage):
            await self._answer(await self.lab.conduct(self.row), said.message, said)
        if isinstance(said.message, Pause | Withdraw):
            raise _Interrupted(said.message)
        return said.message

    async def _interrupted(self, conduct: Conduct, message: Pause | Withdraw) -> None:
        """The subject pauses until it goes on, stops for today, or leaves for good."""
        session, code = conduct.session, self.row.subject_code
        if session.stage in ("done", "ended"):
            return
        conduct.pending = None  # played and not answered: it is played again
        if isinstance(message, Withdraw):
            await self._saved(lambda: conduct.withdraw(message.keep))
            self.lab.calls[self.session] = self.lab.words("operator.subject_withdrawn", subject=code)
            self.lab.release(self.session)
            return
        stage = "paused" if message.type == "pause" else "stopped"
        await self._saved(lambda: session.note(message.type, f"by the subject, at {session.stage}"))
        self.lab.calls[self.session] = self.lab.words(f"operator.subject_{stage}", subject=code)
        if stage == "stopped":
            self.lab.release(self.session)
        self.lab.notify()
        await self._stage(conduct, stage)
        await self._ready(stage)
        self.lab.calls.pop(self.session, None)
        await self._saved(lambda: session.note("resume", "by the subject"))

    async def _answer(self, conduct: Conduct, message: AnswerMessage, said: _Said) -> None:
        """Save an answer and acknowledge it, or say why not."""
        answer = records.Answer(
            message.response, said.received, message.shown_ms, message.pressed_ms, message.lit_ms, said.received_s
        )
        try:
            acknowledged = await self.lab.work(lambda: self._save(conduct, message, answer))
        except Fault as fault:
            await self._fault(conduct, fault)
            return
        except BadInput as error:
            await self._send(type="refused", message=str(error))
            if conduct.pending is not None:
                stands = conduct.pending[0]
                await self._send(type="answer-now", run=stands.run, number=stands.trial.number)
            return
        self.lab.tell(None)
        self.lab.hold(conduct)
        await self._send(
            type="ack",
            run=acknowledged.run,
            number=acknowledged.number,
            right=acknowledged.right,
            progress=conduct.session.progress,
            left_s=round(conduct.session.time_left_s),
        )
        self.lab.notify()

    def _save(self, conduct: Conduct, message: AnswerMessage, answer: records.Answer) -> Acknowledged:
        waits = conduct.pending
        if waits is not None and (waits[0].run, waits[0].trial.number) == (message.run, message.number):
            return conduct.answer(answer)
        before = conduct.session.already(message.run, message.number)
        if before is None:
            raise BadInput(f"answer to trial {message.number} of run {message.run}; allowed: to the trial that stands")
        return before

    async def _saved(self, job: Callable[[], None]) -> None:
        try:
            await self.lab.work(job)
        except BadInput as error:
            await self._send(type="refused", message=str(error))
        except Fault as fault:
            await self._fault(await self.lab.conduct(self.row), fault)

    def _watch(self, conduct: Conduct) -> Watch:
        """Tells the page of intervals, where it is to show them, and what they play in a demonstration."""
        loop, session = asyncio.get_running_loop(), conduct.session
        lit = len(session.task.question.intervals)

        def watch(interval: int, begins: bool) -> None:
            if interval < lit:
                asyncio.run_coroutine_threadsafe(self._quietly(type="interval", interval=interval, on=begins), loop)
            course = session.course
            trial = None if course is None else course.trial()
            if self.lab.shown and begins and course is not None and trial is not None:
                shape = asdict(course.shape(trial, interval))
                asyncio.run_coroutine_threadsafe(self._quietly(type="shape", **shape), loop)

        return watch

    async def _quietly(self, **message: Any) -> None:
        try:
            await self._send(**message)
        except (WebSocketDisconnect, RuntimeError):
            return  # the page went while the trial played; it is presented again

    async def _fault(self, conduct: Conduct, fault: Fault) -> None:
        what = "page.display_stopped" if isinstance(fault, RigAtRest) else "page.not_saved"
        await self._send(type="fault", message=conduct.session.task.words(what), detail=str(fault))
        await asyncio.sleep(0.5)
        self.lab.tell(str(fault))

    async def _stage(self, conduct: Conduct, stage: str | None = None) -> None:
        session = conduct.session
        upcoming = session.upcoming
        await self._send(
            type="stage",
            stage=stage or session.stage,
            ended=session.ended,
            introduction="" if upcoming is None else upcoming.introduction,
            waiting=stage is None and session.stage == "trial" and not self.lab.may_play(self.session),
            progress=session.progress,
            left_s=round(session.time_left_s),
            break_left_s=session.break_left_s,
        )

    def _about(self, conduct: Conduct) -> dict[str, Any]:
        task = conduct.session.task
        study, question = task.protocol.study, task.question
        return {
            "subject": self.row.subject_code,
            "study": study.name,
            "consent": study.consent,
            "instructions": study.instructions,
            "prompt": question.prompt,
            "choices": [asdict(choice) for choice in question.choices],
            "intervals": question.intervals,
            "masking_sound": task.protocol.circumstances.masking_sound,
            "simulated": task.station.simulated,
            "shown": self.lab.shown,
        }

    async def _send(self, **message: Any) -> None:
        await send(self.socket, message)
