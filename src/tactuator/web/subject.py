"""A subject's connection: presents trials, takes answers, and acknowledges each only when it is in the store."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from contextlib import suppress
from functools import partial
from typing import Any

from fastapi import WebSocket, WebSocketDisconnect
from starlette.websockets import WebSocketState

from tactuator.errors import BadInput
from tactuator.experiment import records
from tactuator.experiment.conduct import Conduct
from tactuator.experiment.session import Acknowledged
from tactuator.web.lab import Fault, Lab
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
        while True:
            stage = session.stage
            await self._stage(conduct)
            if stage == "done":
                self._release()
                await self._next(AnswerMessage)
            elif stage == "consent":
                await self._next(Consent)
                await self._saved(session.give_consent)
            elif stage == "break":
                await self._next(Ready)
                await self._saved(session.end_break)
            else:
                await self._next(Ready)
                await self._trials(conduct)

    async def _trials(self, conduct: Conduct) -> None:
        """Trial after trial until the stage changes."""
        session = conduct.session
        while session.stage == "trial":
            while not self.lab.may_play(self.row.id):
                await self._stage(conduct)
                await self.lab.until_changed(_LOOK_AGAIN_S)
            try:
                stands = await self.lab.work(partial(conduct.present, self._watch()))
            except Fault as fault:
                await self._fault(str(fault))
                continue
            self.lab.notify()
            await self._send(
                type="answer-now", run=stands.run, number=stands.trial.number, responses=stands.trial.responses
            )
            await self._next(AnswerMessage)
            await asyncio.sleep(conduct.timing.feedback_s)

    async def _next(self, wanted: type[Consent] | type[Ready] | type[AnswerMessage]) -> None:
        """Wait for a message of that kind; answers that are sent again are acknowledged again at any time."""
        while True:
            message = await self._messages.get()
            if isinstance(message, AnswerMessage):
                conduct = await self.lab.conduct(self.row)
                if await self._answer(conduct, message) and wanted is AnswerMessage and conduct.pending is None:
                    return
            elif isinstance(message, wanted):
                return

    async def _answer(self, conduct: Conduct, message: AnswerMessage) -> bool:
        """Save an answer and acknowledge it, or say why not; whether the page now knows that it is saved."""
        received = self.lab.clock.utc()
        answer = records.Answer(message.response, received, message.shown_ms, message.pressed_ms)
        try:
            acknowledged = await self.lab.work(lambda: self._save(conduct, message, answer))
        except Fault as fault:
            await self._fault(str(fault))
            return False
        except BadInput as error:
            await self._send(type="refused", message=str(error))
            return False
        self.lab.tell(None)
        feedback = acknowledged.correct if conduct.session.protocol.session.feedback else None
        await self._send(
            type="ack",
            run=acknowledged.run,
            number=acknowledged.number,
            correct=feedback,
            progress=conduct.session.progress,
        )
        self.lab.notify()
        return True

    def _save(self, conduct: Conduct, message: AnswerMessage, answer: records.Answer) -> Acknowledged:
        waits = conduct.pending
        if waits is not None and (waits[0].run, waits[0].trial.number) == (message.run, message.number):
            return conduct.answer(answer)
        before = conduct.session.already(message.run, message.number)
        if before is None:
            raise BadInput(f"answer to trial {message.number} of run {message.run}; allowed: to the trial that stands")
        return before

    async def _saved(self, task: Any) -> None:
        try:
            await self.lab.work(task)
        except Fault as fault:
            await self._fault(str(fault))

    def _watch(self) -> Any:
        loop = asyncio.get_running_loop()

        def watch(interval: int, begins: bool) -> None:
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

    async def _fault(self, fault: str) -> None:
        await self._send(type="fault", message="This could not be saved. Please call the experimenter.", detail=fault)
        await asyncio.sleep(0.5)
        self.lab.tell(fault)

    async def _stage(self, conduct: Conduct) -> None:
        session = conduct.session
        await self._send(
            type="stage",
            stage=session.stage,
            waiting=session.stage == "trial" and not self.lab.may_play(self.row.id),
            progress=session.progress,
        )

    def _about(self) -> dict[str, Any]:
        protocol = self.lab.protocol
        return {
            "subject": self.row.subject_code,
            "study": protocol.study.name,
            "consent": protocol.study.consent,
            "instructions": protocol.study.instructions,
            "responses": protocol.forced_choice().responses,
            "break_s": protocol.session.break_s,
            "masking_sound": protocol.circumstances.masking_sound,
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
