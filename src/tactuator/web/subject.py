"""A subject's connection: presents trials, takes answers, and acknowledges each only when it is in the store."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from contextlib import suppress
from dataclasses import asdict
from typing import Any

from fastapi import WebSocket, WebSocketDisconnect
from starlette.websockets import WebSocketState

from tactuator.errors import BadInput
from tactuator.experiment.session.presented_session import Conduct
from tactuator.experiment.session.session import Acknowledged, Stage
from tactuator.experiment.store import records
from tactuator.experiment.trial.presenter import Watch
from tactuator.web.lab import Fault, Lab, RigAtRest
from tactuator.web.messages import AnswerMessage, Consent, Ready, subject_message

ELSEWHERE = 4001
"""Close code: the session was opened in another tab."""

_LOOK_AGAIN_S = 5.0


class Tabs:
    """The one tab of every session that counts: the newest."""

    def __init__(self) -> None:
        self._open: dict[int, SubjectTab] = {}

    async def enter(self, tab: SubjectTab) -> None:
        """A tab opens; the one before it is told and closed."""
        before = self._open.get(tab.row.id)
        self._open[tab.row.id] = tab
        if before is not None:
            await before.leave()

    def exit(self, tab: SubjectTab) -> None:
        """A tab closes."""
        if self._open.get(tab.row.id) is tab:
            del self._open[tab.row.id]

    def is_open(self, session: int) -> bool:
        """Whether the subject's page is connected."""
        return session in self._open


class SubjectTab:
    """One open page."""

    def __init__(self, socket: WebSocket, lab: Lab, row: records.Found) -> None:
        self.socket, self.lab, self.row = socket, lab, row
        self._messages: asyncio.Queue[Consent | Ready | AnswerMessage] = asyncio.Queue()

    async def leave(self) -> None:
        """Another tab took over."""
        with suppress(WebSocketDisconnect, RuntimeError):  # it may have gone already
            await self._send(type="elsewhere")
            await self.socket.close(ELSEWHERE)

    async def attend(self) -> None:
        """Serve the page until it closes."""
        conduct = await self.lab.conduct(self.row)
        await self._send(type="hello", **self._about())
        await first_to_end(self._read(), self._flow(conduct))

    async def _read(self) -> None:
        while True:
            text = await self.socket.receive_text()
            try:
                self._messages.put_nowait(subject_message(text))
            except BadInput as error:
                await self._send(type="refused", message=str(error))

    async def _flow(self, conduct: Conduct) -> None:
        """What the subject does, one stage after another."""
        session = conduct.session
        ends = {"break": session.end_break, "introduction": session.introduce}
        while True:
            stage = session.stage
            await self._stage(conduct)
            if stage == "done":
                self._release()
                await self._answered()
            elif stage == "consent":
                await self._agreed()
                await self._saved(session.give_consent)
            else:
                await self._ready(stage)
                if stage == "trial":
                    await self._trials(conduct)
                elif session.stage == stage:  # the operator may have given up the run meanwhile
                    await self._saved(ends[stage])

    async def _trials(self, conduct: Conduct) -> None:
        """Trial after trial until the stage changes, or something fails: then the subject says when to go on."""
        session = conduct.session
        while session.stage == "trial":
            if not self.lab.may_play(self.row.id):
                await self._stage(conduct)
                await self.lab.until_changed(_LOOK_AGAIN_S)
                continue
            await self._send(type="playing")
            try:
                stands = await self.lab.present(conduct, self._watch(conduct))
            except Fault as fault:
                await self._fault(fault)
                return
            self.lab.notify()
            await self._send(type="answer-now", run=stands.run, number=stands.trial.number)
            await self._answered(conduct)
            await asyncio.sleep(session.task.rules.feedback_s)

    async def _agreed(self) -> None:
        while not isinstance(await self._next(), Consent):
            pass

    async def _ready(self, stage: Stage) -> None:
        """Wait until the subject goes on from that stage; what was said of another one came late and counts no more."""
        while True:
            message = await self._next()
            if isinstance(message, Ready) and message.stage == stage:
                return

    async def _answered(self, conduct: Conduct | None = None) -> None:
        """Wait for the answer to what was played (without a conduct: for ever)."""
        while conduct is None or conduct.pending is not None:
            await self._next()

    async def _next(self) -> Consent | Ready | AnswerMessage:
        """The next message; answers, also those that are sent again, are saved and acknowledged at any time."""
        message = await self._messages.get()
        if isinstance(message, AnswerMessage):
            await self._answer(await self.lab.conduct(self.row), message)
        return message

    async def _answer(self, conduct: Conduct, message: AnswerMessage) -> None:
        """Save an answer and acknowledge it, or say why not."""
        received = self.lab.clock.utc()
        answer = records.Answer(message.response, received, message.shown_ms, message.pressed_ms)
        try:
            acknowledged = await self.lab.work(lambda: self._save(conduct, message, answer))
        except Fault as fault:
            await self._fault(fault)
            return
        except BadInput as error:
            await self._send(type="refused", message=str(error))
            return
        self.lab.tell(None)
        await self._send(
            type="ack",
            run=acknowledged.run,
            number=acknowledged.number,
            right=acknowledged.right,
            progress=conduct.session.progress,
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
        except Fault as fault:
            await self._fault(fault)

    def _watch(self, conduct: Conduct) -> Watch:
        """Tells the page of intervals, where it is to show them."""
        loop, shown = asyncio.get_running_loop(), len(conduct.session.task.question.intervals)

        def watch(interval: int, begins: bool) -> None:
            if interval < shown:
                asyncio.run_coroutine_threadsafe(self._quietly(interval, begins), loop)

        return watch

    async def _quietly(self, interval: int, begins: bool) -> None:
        try:
            await self._send(type="interval", interval=interval, on=begins)
        except WebSocketDisconnect:
            return  # the page went while the trial played; it is presented again

    def _release(self) -> None:
        if self.lab.active == self.row.id:
            self.lab.active = None
            self.lab.notify()

    async def _fault(self, fault: Fault) -> None:
        what = "The display has stopped." if isinstance(fault, RigAtRest) else "This could not be saved."
        await self._send(type="fault", message=f"{what} Please call the experimenter.", detail=str(fault))
        await asyncio.sleep(0.5)
        self.lab.tell(str(fault))

    async def _stage(self, conduct: Conduct) -> None:
        session = conduct.session
        upcoming = session.upcoming
        await self._send(
            type="stage",
            stage=session.stage,
            introduction="" if upcoming is None else upcoming.introduction,
            waiting=session.stage == "trial" and not self.lab.may_play(self.row.id),
            progress=session.progress,
        )

    def _about(self) -> dict[str, Any]:
        task = self.lab.task
        study, question = task.protocol.study, task.question
        return {
            "subject": self.row.subject_code,
            "study": study.name,
            "consent": study.consent,
            "instructions": study.instructions,
            "prompt": question.prompt,
            "choices": [asdict(choice) for choice in question.choices],
            "intervals": question.intervals,
            "break_s": task.rules.break_s,
            "masking_sound": task.protocol.circumstances.masking_sound,
        }

    async def _send(self, **message: Any) -> None:
        await send(self.socket, message)


async def send(socket: WebSocket, message: dict[str, Any]) -> None:
    """Send, or raise WebSocketDisconnect where the page has gone."""
    if socket.application_state is WebSocketState.DISCONNECTED:
        raise WebSocketDisconnect
    await socket.send_json(message)


async def first_to_end(*parts: Coroutine[Any, Any, None]) -> None:
    """Run the parts of a connection until one ends, and end the others; a page that goes is no error."""
    tasks = [asyncio.create_task(part) for part in parts]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        ends = await asyncio.gather(*tasks, return_exceptions=True)
    for end in ends:
        if isinstance(end, Exception) and not isinstance(end, WebSocketDisconnect):
            raise end
