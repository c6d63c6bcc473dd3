"""State of the server: a study, an apparatus, the session at the rig, and what the operator has asked for."""

from __future__ import annotations

import asyncio
import hmac
import logging
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import TypeVar

from tactuator.entry_points import fault_of
from tactuator.errors import BadInput, StoreFault, TactuatorError
from tactuator.experiment.presenter import Halted, Watch
from tactuator.experiment.session.session import Session
from tactuator.experiment.session.studies import Study, StudyRecords
from tactuator.experiment.session.task import JumpWatch, NextTrial
from tactuator.experiment.store import records
from tactuator.experiment.store.records import Found
from tactuator.experiment.words import Words
from tactuator.result import ResultTable

_T = TypeVar("_T")
NOTES_MAX = 500
"""Number of starts, pauses, resumptions and claims that are stored of a session while the server runs."""
_LOG = logging.getLogger(__name__)


class LabFault(Exception):
    """A failure of rig or store; the message is one line for the operator."""


class RigAtRest(LabFault):
    """A failure that was not the store's: the rig is at rest, and plays nothing until the operator resumes."""


class Lab:
    """One rig and one study. Everything that uses the rig or the store goes through `work`, one thing at a time.

    active: session at the rig. auto_start: True where a subject who comes to a free rig may begin without the operator.
    shown: what subjects see and hear of the stimuli in a demonstration, as stored ("" where they only feel them).
    calls: what the operator should look after, by session. facts: demographic items, by the subject's row. voids:
    reasons, as `void_parts` has them.
    tabs: how the open page of each session is closed, with the reason; control: the operator's page that has it.
    """

    def __init__(self, study: Study, auto_start: bool = False, shown: str = "") -> None:
        self.study, self.store, self.clock = study, study.store, study.clock
        self.apparatus = study.task.apparatus
        self.auto_start, self.shown = auto_start, shown
        self.active: int | None = None
        self.paused = False
        self.fault: str | None = None
        self.calls: dict[int, str] = {}
        self.tabs: dict[int, Callable[..., Awaitable[None]]] = {}
        self.control: object | None = None
        self.jumps = JumpWatch(self.clock)
        self.changed = asyncio.Event()
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="rig")
        self._sessions: dict[int, Session] = {}
        self._notes: dict[int, int] = {}
        self._opening = asyncio.Lock()
        self._rows, self.facts, self.voids = study.sessions(), study.facts(), study.voids()

    @property
    def sessions(self) -> list[Found]:
        """Return the study's sessions, by subject and visit."""
        return self._rows

    @property
    def words(self) -> Words:
        """Return the words in the language of the newest protocol."""
        return self.study.task.words

    def by_token(self, token: str) -> Found | None:
        """Return the session that a subject's link opens, or None."""
        session = None
        for row in self._rows:  # all of them, so that the duration gives no hint of the tokens
            if hmac.compare_digest(row.link_token.encode(), token.encode()):
                session = row
        return session

    async def refresh(self) -> None:
        """Read the study's sessions and subjects anew, after an operator, here or at another station, changed them."""
        before = self._rows, self.facts, self.voids
        self._rows, self.facts = await self.work(self.study.sessions), await self.work(self.study.facts)
        self.voids = await self.work(self.study.voids)
        if (self._rows, self.facts, self.voids) != before:
            self.notify()

    async def work(self, job: Callable[[], _T]) -> _T:
        """Run a job on the thread that uses rig and store; meant for jobs whose failures are the store's.

        Raises BadInput as the job does. Any other failure is raised as a LabFault and kept for the operator to see; the
        rig goes on.
        """
        try:
            return await asyncio.get_running_loop().run_in_executor(self._worker, job)
        except BadInput:
            raise
        except StoreFault as error:
            self.tell(str(error))
            raise LabFault(str(error)) from None
        except Exception as error:
            _LOG.error("a defect", exc_info=error)
            fault = LabFault(fault_of(error))
            self.tell(str(fault))
            raise fault from None

    async def change(self, who: str, job: Callable[[StudyRecords], _T]) -> _T:
        """Change the study's records in one transaction. who: whose change it is. Raises as `work` does."""

        def changed() -> _T:
            with self.study.editing(who) as study:
                return job(study)

        return await self.work(changed)

    async def present(
        self, session: Session, watch: Watch, interrupted: Callable[[], bool] = lambda: False
    ) -> NextTrial:
        """Play the pending trial. Raises Halted if it was stopped: the session is not at the rig any more, or
        interrupted(), which is asked before the first sample and after every piece, returns True.

        Nothing else that keeps a rig from playing is the subject's input: it is raised as a LabFault, and leaves the
        rig at rest unless it was the store alone.
        """
        halted = lambda: self.active != session.id or interrupted()  # noqa: E731
        job = self._worker.submit(session.present, watch, halted)
        try:
            return await asyncio.wrap_future(job)
        except Halted:
            raise
        except StoreFault as error:
            self.tell(str(error))
            raise LabFault(str(error)) from None
        except Exception as error:
            raise await self._at_rest(error) from None

    async def _at_rest(self, error: Exception) -> RigAtRest:
        """Put the rig to rest, hold it there unless subjects begin by themselves, and return the fault."""
        _LOG.error("a fault at the rig", exc_info=error)
        with suppress(Exception):
            await asyncio.get_running_loop().run_in_executor(self._worker, self.apparatus.rig.rest)
        self.paused = not self.auto_start
        fault = RigAtRest(str(error) if isinstance(error, TactuatorError) else fault_of(error))
        self.tell(str(fault))
        return fault

    async def session(self, row: Found) -> Session:
        """Return the session of the row, the same for all who ask; the first time it is resumed from the
        store.
        """
        async with self._opening:
            if row.id not in self._sessions:
                self._sessions[row.id] = await self.work(lambda: self._resumed(row))
            return self._sessions[row.id]

    def _resumed(self, row: Found) -> Session:
        return self.study.session(row, records.Visit("person", self.shown))

    async def catch_up(self, row: Found) -> None:
        """Resume the session anew where another station has gone on with it in the store that they share."""
        here = self.opened(row.id)
        if here is None or self.store.is_file:
            return
        stored = await self.work(lambda: self._resumed(row))
        if (stored.trials, stored.ended) != (here.trials, here.ended) or here.stage == "consent":
            self._sessions[row.id] = stored

    async def reopen(self, row: Found) -> None:
        """Resume a session anew, and close the page that is open for it: a visit that is void asks nothing more."""
        self._sessions.pop(row.id, None)
        await self.session(row)
        if row.id in self.tabs:
            await self.tabs[row.id]("changed")

    def opened(self, session: int) -> Session | None:
        """Return the session if it has been opened, or None."""
        return self._sessions.get(session)

    async def results(self, session: int) -> tuple[ResultTable, ...]:
        """Return the results of the session so far, computed beside the rig's work. Raises BadInput while there are
        none.
        """
        self._check(session)
        return await asyncio.to_thread(self.study.task.results, self.store, session)

    def may_play(self, session: int) -> bool:
        """Return whether the next trial of that session may be presented."""
        if self.active is None and self.auto_start:
            self.start(session)
        return self.active == session and not self.paused

    def start(self, session: int) -> None:
        """Put a session at the rig. Raises BadInput while another is there."""
        self._check(session)
        if self.active not in (None, session):
            there = next(row.subject_code for row in self._rows if row.id == self.active)
            raise BadInput(self.words("operator.refused_at_rig", subject=there))
        self.active, self.paused = session, False
        self.notify()

    def _check(self, session: int) -> None:
        if all(row.id != session for row in self._rows):
            raise BadInput(f"session {session} is not of this study", f"{[row.id for row in self._rows]}")

    async def stop(self) -> None:
        """Stop at once what plays; the rig is put to rest with no session at it."""
        self.active = None
        self.notify()
        await self.work(self.apparatus.rig.rest)

    def release(self, session: int) -> None:
        """Remove the session from the rig, if it is there."""
        if self.active == session:
            self.active = None
            self.notify()

    def pause(self, paused: bool) -> None:
        """Hold after the trial that plays, or go on; going on answers the call of the session at the rig."""
        self.paused = paused
        session = None if self.active is None else self.opened(self.active)
        if not paused and session is not None:
            session.release()
            self.calls.pop(session.id, None)
        self.notify()

    def hold(self, session: Session) -> None:
        """Hold a session that waits for the operator; without one, it begins again by itself."""
        failed = session.failed_practice
        if failed is None:
            return
        row = next(row for row in self._rows if row.id == session.id)
        self.calls[row.id] = self.words("operator.practice_failed", subject=row.subject_code, run=failed.title)
        if self.auto_start:
            session.release()
        elif self.active == row.id:
            self.paused = True
        self.notify()

    def tell(self, fault: str | None) -> None:
        """Show the operator a fault, or, with None, that it is over."""
        if fault != self.fault:
            self.fault = fault
            self.notify()

    def watch_clock(self) -> None:
        """Record a jump of the wall clock; durations within a session go by the monotonic clock, which has none."""
        jump_s = self.jumps.jump_s()
        if jump_s is not None:
            with self.store.begin() as connection:
                detail = f"the wall clock moved by {jump_s:.1f} s"
                records.note(connection, None, "clock-jump", detail, self.clock.utc(), records.PROGRAM)

    async def note(self, session: Session, kind: str, detail: str, who: str | None = None) -> None:
        """Store what was done to a session, NOTES_MAX times at most: a page may pause and go on without an end."""
        left = self.notes_left(session.id)
        if left >= 0:
            last = "" if left else f"; the last of {NOTES_MAX} that are kept"
            await self.work(lambda: session.note(kind, detail + last, who))

    def notes_left(self, session: int) -> int:
        """Count something that a page may do without an end, and return how often more it is stored."""
        self._notes[session] = self._notes.get(session, 0) + 1
        return NOTES_MAX - self._notes[session]

    def notify(self) -> None:
        """Notify those who wait that something changed."""
        self.changed.set()
        self.changed = asyncio.Event()

    async def until_changed(self, timeout_s: float) -> None:
        """Wait for a change, at most timeout_s seconds."""
        # not `wait_for`: of Python 3.11 it swallows a cancellation that comes together with the change
        with suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                await self.changed.wait()

    def close(self) -> None:
        """Finish what is being done and let go of the rig, which is put to rest."""
        self.active = None
        with suppress(Exception):
            self._worker.submit(self.apparatus.rig.rest).result()
        self._worker.shutdown(wait=True)
