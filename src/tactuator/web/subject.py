"""A subject's connection: presents trials, takes answers, and acknowledges each only when it is in the store."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Any, TypeVar

from fastapi import WebSocket, WebSocketDisconnect

from tactuator.errors import BadInput
from tactuator.experiment.presenter import Halted, Watch
from tactuator.experiment.session.session import Acknowledged, Session
from tactuator.experiment.session.task import NextTrial
from tactuator.experiment.store import records
from tactuator.experiment.store.records import Found
from tactuator.plain import picked
from tactuator.web.lab import Lab, LabFault, RigAtRest
from tactuator.web.messages import (
    FROM_SUBJECT,
    AnswerMessage,
    Consent,
    Decline,
    Pause,
    Ready,
    SubjectMessage,
    Withdraw,
    message_of,
)
from tactuator.web.sockets import first_to_end, receive_text, send

CLOSE_ELSEWHERE = 4001
"""Close code of a connection whose session was opened in another tab."""

_RECHECK_S = 5.0
_Kind = TypeVar("_Kind")
_MESSAGES_MAX = 32
"""Number of messages that may wait; a page that sends more is read no further until they are handled."""


@dataclass(frozen=True)
class _Incoming:
    """A message and its time of arrival by the server's two clocks."""

    message: SubjectMessage
    received: datetime
    received_s: float


class _Interrupted(Exception):
    """Raised where the subject pauses, stops or leaves, whatever was going on."""

    def __init__(self, message: Pause | Withdraw) -> None:
        super().__init__()
        self.message = message


class SubjectTab:
    """One open page of a subject."""

    def __init__(self, socket: WebSocket, lab: Lab, row: Found) -> None:
        self.socket, self.lab, self.row = socket, lab, row
        self._messages: asyncio.Queue[_Incoming] = asyncio.Queue(_MESSAGES_MAX)
        self._interruptions = 0  # that came and are not handled yet: nothing plays while there is one

    @property
    def id(self) -> int:
        """The session's row in the store."""
        return int(self.row.id)

    async def leave(self, why: str = "elsewhere") -> None:
        """Notify the page why it is over, and close it: another tab took over, or a part of the visit was made void."""
        with suppress(WebSocketDisconnect, RuntimeError):  # it may have gone already
            await self._send(type=why)
            await self.socket.close(CLOSE_ELSEWHERE)

    async def serve(self) -> None:
        """Serve the page until it closes; one that was open for the session is notified and closed."""
        lab, leave = self.lab, self.lab.tabs.get(self.id)
        lab.tabs[self.id] = self.leave
        lab.notify()
        try:
            if leave is not None:
                await leave()
            await lab.catch_up(self.row)
            session = await lab.session(self.row)
            await self._send(type="hello", **self._hello(session))
            await first_to_end(self._read(), self._run_stages(session))
        finally:
            if lab.tabs.get(self.id) == self.leave:
                del lab.tabs[self.id]
            lab.notify()

    @asynccontextmanager
    async def _reporting(self, session: Session | None = None, what: str = "") -> AsyncIterator[None]:
        """Send the page what is refused in the block, and a fault. session: its trial is then repeated.

        what: text of the page on what is allowed; without one the page shows nothing, and only a program reads why.
        """
        try:
            yield
        except BadInput as error:
            said = self.lab.words(f"page.{what}") if what else ""
            await self._send(type="refused", message=str(error), said=said)
            if session is not None and session.pending is not None:
                await self._ask(session.pending[0])
        except LabFault as fault:
            await self._fault(fault)

    async def _read(self) -> None:
        while True:
            async with self._reporting():
                message = message_of(FROM_SUBJECT, await receive_text(self.socket), "message")
                if isinstance(message, Pause | Withdraw):
                    self._interruptions += 1
                clock = self.lab.clock
                await self._messages.put(_Incoming(message, clock.utc(), clock.monotonic_s()))

    async def _run_stages(self, session: Session) -> None:
        """Go through one stage after another until the subject interrupts; then handle the interruption.

        A pause may be interrupted in its turn by a subject who leaves.
        """
        interruption: Pause | Withdraw | None = None
        while True:
            try:
                if interruption is None:
                    await self._run_stage(session)
                else:
                    now, interruption = interruption, None
                    await self._interrupted(session, now)
            except _Interrupted as interrupted:
                interruption = interrupted.message

    async def _run_stage(self, session: Session) -> None:
        announced = stage, _ = session.comes
        await self._stage(session)
        if stage in ("done", "ended"):
            self.lab.release(self.id)
            while True:
                await self._next_message()
        elif stage == "consent":
            said: Consent | Decline = await self._next_of(Consent, Decline)
            if isinstance(said, Consent):
                name = said.name
                async with self._reporting(what="refused_name"):
                    await self.lab.work(lambda: session.give_consent(name))
            else:
                await self._work(session.decline)
        else:
            if not await self._is_ready(session, announced):
                return  # the operator gave up the run that was introduced: the page gets the next
            if stage == "trial":
                await self._run_trials(session)
            else:
                await self._work({"break": session.end_break, "introduction": session.introduce}[stage])

    async def _run_trials(self, session: Session) -> None:
        """Play trial after trial until the stage changes, or something fails: then the subject says when to go on."""
        _, introduced = session.comes
        while session.stage == "trial":
            if session.comes[1] not in ("", introduced):
                return  # another run is announced: the page says when it begins
            if not self.lab.may_play(self.id):
                await self._stage(session)
                await self._until_changed()
                continue
            await self._send(type="playing")
            try:
                pending = await self.lab.present(session, self._watch(session), lambda: self._interruptions > 0)
            except Halted:
                await self._stage(session)
                self._next_interruption()
                continue
            except LabFault as fault:
                await self._fault(fault)
                return
            self.lab.notify()
            await self._ask(pending)
            while session.pending is not None:
                await self._next_message()
            await self._listen(session.task.rules.feedback_s)

    def _next_interruption(self) -> None:
        """Raise the interruption that halted the trial, if this page sent it; other messages came too late and are
        dropped.
        """
        while not self._messages.empty():
            self._interrupt_by(self._messages.get_nowait().message)

    def _interrupt_by(self, message: SubjectMessage) -> None:
        if isinstance(message, Pause | Withdraw):
            self._interruptions -= 1
            raise _Interrupted(message)

    async def _listen(self, duration_s: float) -> None:
        until_s = asyncio.get_running_loop().time() + duration_s
        while True:
            try:
                async with asyncio.timeout_at(until_s):
                    incoming = await self._messages.get()
            except TimeoutError:
                return
            await self._take(incoming)

    async def _is_ready(self, session: Session, announced: tuple[str, str]) -> bool:
        while session.comes == announced:
            message = await self._until_changed()
            if isinstance(message, Ready) and message.stage == announced[0]:
                return session.comes == announced
        return False

    async def _until_changed(self) -> SubjectMessage | None:
        """Wait for the lab to change, and handle and return a message of the page that comes meanwhile."""
        change = asyncio.create_task(self.lab.until_changed(_RECHECK_S))
        incoming = asyncio.create_task(self._messages.get())
        try:
            await asyncio.wait([change, incoming], return_when=asyncio.FIRST_COMPLETED)
        finally:
            change.cancel()
            if not incoming.done():
                incoming.cancel()
        if incoming.done() and not incoming.cancelled():
            return await self._take(incoming.result())
        return None

    async def _next_of(self, *kinds: type[_Kind]) -> _Kind:
        """Return the next message of those kinds; what was said beside it is handled, and else ignored."""
        while not isinstance(message := await self._next_message(), kinds):
            pass
        return message

    async def _next_message(self) -> SubjectMessage:
        return await self._take(await self._messages.get())

    async def _take(self, incoming: _Incoming) -> SubjectMessage:
        if isinstance(incoming.message, AnswerMessage):
            await self._answer(await self.lab.session(self.row), incoming.message, incoming)
        self._interrupt_by(incoming.message)
        return incoming.message

    async def _interrupted(self, session: Session, message: Pause | Withdraw) -> None:
        code = self.row.subject_code
        if session.stage in ("done", "ended"):
            return
        session.pending = None  # a trial that was played and not answered is played again
        if isinstance(message, Withdraw):
            await self._work(lambda: session.withdraw(message.keep))
            self.lab.calls[self.id] = self.lab.words("operator.subject_withdrawn", subject=code)
            self.lab.release(self.id)
            return
        stage = "paused" if message.type == "pause" else "stopped"
        async with self._reporting():
            await self.lab.note(session, message.type, f"by the subject, at {session.stage}")
        self.lab.calls[self.id] = self.lab.words(f"operator.subject_{stage}", subject=code)
        if stage == "stopped":
            self.lab.release(self.id)
        self.lab.notify()
        await self._stage(session, stage)
        while (await self._next_of(Ready)).stage != stage:
            pass  # what was said of another stage came late
        self.lab.calls.pop(self.id, None)
        async with self._reporting():
            await self.lab.note(session, "resume", "by the subject")

    async def _answer(self, session: Session, message: AnswerMessage, incoming: _Incoming) -> None:
        answer = records.Answer(
            message.response,
            incoming.received,
            message.shown_ms,
            message.pressed_ms,
            message.lit_ms,
            incoming.received_s,
        )
        numbers = session.pending is not None and not session.task.question.choices
        async with self._reporting(session, "refused_number" if numbers else ""):
            acknowledged = await self.lab.work(lambda: self._save(session, message, answer))
            self.lab.tell(None)
            self.lab.hold(session)
            await self._send(
                type="ack",
                run=acknowledged.run,
                number=acknowledged.number,
                right=acknowledged.right,
                progress=session.progress,
                left_s=round(session.time_left_s),
            )
            self.lab.notify()

    async def _ask(self, pending: NextTrial) -> None:
        await self._send(type="answer-now", run=pending.run, number=pending.trial.number)

    def _save(self, session: Session, message: AnswerMessage, answer: records.Answer) -> Acknowledged:
        waits = session.pending
        if waits is not None and (waits[0].run, waits[0].trial.number) == (message.run, message.number):
            return session.answer(answer)
        before = session.already(message.run, message.number)
        if before is None:
            raise BadInput(f"answer to trial {message.number} of run {message.run}", "the pending trial")
        return before

    async def _work(self, job: Callable[[], None]) -> None:
        async with self._reporting():
            await self.lab.work(job)

    def _watch(self, session: Session) -> Watch:
        """Return the callback that sends the page intervals, where it shows them, and their envelopes in a
        demonstration.
        """
        loop = asyncio.get_running_loop()
        lit = len(session.task.question.intervals)

        def show(**message: Any) -> None:
            asyncio.run_coroutine_threadsafe(self._send_if_open(**message), loop)

        def watch(interval: int, begins: bool) -> None:
            if interval < lit:
                show(type="interval", interval=interval, on=begins)
            trial = None if session.running is None else session.running.state.trial()
            if self.lab.shown and begins and trial is not None:
                show(type="shape", **asdict(session.task.envelope(trial, interval)))

        return watch

    async def _send_if_open(self, **message: Any) -> None:
        try:
            await self._send(**message)
        except (WebSocketDisconnect, RuntimeError):
            return  # the page went while the trial played; it is presented again

    async def _fault(self, fault: LabFault) -> None:
        what = "page.display_stopped" if isinstance(fault, RigAtRest) else "page.not_saved"
        words = (await self.lab.session(self.row)).task.words
        await self._send(type="fault", message=words(what), detail=str(fault))
        await asyncio.sleep(0.5)
        self.lab.tell(str(fault))

    async def _stage(self, session: Session, stage: str | None = None) -> None:
        await self._send(
            type="stage",
            stage=stage or session.stage,
            ended=session.ended,
            introduction=session.comes[1],
            waiting=stage is None and session.stage == "trial" and not self.lab.may_play(self.id),
            progress=session.progress,
            left_s=round(session.time_left_s),
            break_left_s=session.break_left_s,
        )

    def _hello(self, session: Session) -> dict[str, Any]:
        task = session.task
        study, question = task.protocol.study, task.question
        return {
            **picked(study, "consent", "consent_by", "instructions", study="name"),
            **picked(question, "prompt", "intervals"),
            "choices": [asdict(choice) for choice in question.choices],
            "subject": self.row.subject_code,
            "masking_sound": task.protocol.circumstances.masking_sound,
            "simulated": task.apparatus.simulated,
            "shown": self.lab.shown,
        }

    async def _send(self, **message: Any) -> None:
        await send(self.socket, message)
