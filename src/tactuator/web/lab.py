"""What the server holds: a study, a station, who is at the rig, and what the operator has asked for."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import TypeVar

from tactuator.errors import BadInput, StoreFault, TactuatorError
from tactuator.experiment.result.tables import ResultTable
from tactuator.experiment.session.clock import Clock, JumpWatch
from tactuator.experiment.session.presented_session import Conduct
from tactuator.experiment.session.session import NextTrial, Session
from tactuator.experiment.session.task import Task
from tactuator.experiment.store import records
from tactuator.experiment.store.store import Store
from tactuator.experiment.trial.presenter import Watch

_T = TypeVar("_T")
_LOG = logging.getLogger(__name__)


class Fault(Exception):
    """Rig or store failed; the message is one line for the operator."""


class RigAtRest(Fault):
    """It was not the store: the rig is at rest, and plays nothing until somebody says so."""


class Lab:
    """One rig, one study. Everything that touches the rig or the store goes through `work`, one thing at a time.

    active: session at the rig. auto_start: a subject who comes to a free rig may begin without the operator.
    """

    def __init__(self, store: Store, task: Task, study: int, clock: Clock, auto_start: bool = False) -> None:
        self.store, self.task, self.study, self.clock = store, task, study, clock
        self.auto_start = auto_start
        self.active: int | None = None
        self.paused = False
        self.fault: str | None = None
        self.jumps = JumpWatch(clock)
        self.changed = asyncio.Event()
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="rig")
        self._conducts: dict[int, Conduct] = {}
        self._opening = asyncio.Lock()
        with store.read() as connection:
            self._rows = records.sessions(connection, study)

    @property
    def sessions(self) -> list[records.Found]:
        """The study's sessions, as they were when the server began."""
        return self._rows

    def by_token(self, token: str) -> records.Found | None:
        """The session that a subject's link opens."""
        return next((row for row in self._rows if row.link_token == token), None)

    async def work(self, job: Callable[[], _T]) -> _T:
        """Run `job` where rig and store are used. Raises BadInput as the job does.

        Whatever else goes wrong is a Fault: kept for the operator to see, and the rig is left at rest unless it was the
        store alone.
        """
        try:
            return await asyncio.get_running_loop().run_in_executor(self._worker, job)
        except BadInput:
            raise
        except StoreFault as error:
            self.tell(str(error))
            raise Fault(str(error)) from None
        except Exception as error:
            raise await self._at_rest(error) from None

    async def present(self, conduct: Conduct, watch: Watch) -> NextTrial:
        """Play the trial that stands. Nothing that keeps a rig from it is the subject's input: all of it is a Fault."""
        try:
            return await self.work(lambda: conduct.present(watch))
        except BadInput as error:
            raise await self._at_rest(error) from None

    async def _at_rest(self, error: Exception) -> RigAtRest:
        """Put the rig to rest and hold it there, unless subjects begin by themselves; the fault."""
        _LOG.error("a fault at the rig", exc_info=error)
        with suppress(Exception):
            await asyncio.get_running_loop().run_in_executor(self._worker, self.task.station.rig.rest)
        self.paused = not self.auto_start
        fault = RigAtRest(str(error) if isinstance(error, TactuatorError) else f"{type(error).__name__}: {error}")
        self.tell(str(fault))
        return fault

    async def conduct(self, row: records.Found) -> Conduct:
        """The session's one conduct, resumed from the store the first time, however many ask for it at once."""
        async with self._opening:
            if row.id not in self._conducts:
                self._conducts[row.id] = await self.work(
                    lambda: Conduct(Session(self.store, row.id, row.subject_number, self.task, self.clock))
                )
            return self._conducts[row.id]

    def opened(self, session: int) -> Conduct | None:
        """The session's conduct if it has been opened."""
        return self._conducts.get(session)

    async def results(self, session: int) -> tuple[ResultTable, ...]:
        """What the session's answers say so far, computed beside the rig's work. BadInput while they say nothing."""
        self._check(session)
        return await asyncio.to_thread(self.task.results, self.store, session)

    def may_play(self, session: int) -> bool:
        """Whether the next trial of that session may be presented."""
        if self.active is None and self.auto_start:
            self.start(session)
        return self.active == session and not self.paused

    def start(self, session: int) -> None:
        """Put a session at the rig. BadInput while another is there."""
        self._check(session)
        if self.active not in (None, session):
            raise BadInput(f"session {self.active} is at the rig; allowed: stop it first")
        self.active, self.paused = session, False
        self.notify()

    def _check(self, session: int) -> None:
        if all(row.id != session for row in self._rows):
            raise BadInput(f"session {session} is not of this study; allowed: {[row.id for row in self._rows]}")

    async def stop(self) -> None:
        """Rig to rest, nobody at it."""
        self.active = None
        self.notify()
        await self.work(self.task.station.rig.rest)

    def pause(self, paused: bool) -> None:
        """Hold after the trial that plays, or go on."""
        self.paused = paused
        self.notify()

    def tell(self, fault: str | None) -> None:
        """A fault for the operator, or None: it is over."""
        if fault != self.fault:
            self.fault = fault
            self.notify()

    def watch_clock(self) -> None:
        """Note a wall clock that jumped: durations within a session go by the monotonic clock and are not touched."""
        jump_s = self.jumps.jump_s()
        if jump_s is not None:
            with self.store.begin() as connection:
                records.note(
                    connection, None, "clock-jump", f"the wall clock moved by {jump_s:.1f} s", self.clock.utc()
                )

    def notify(self) -> None:
        """Something changed: whoever waits looks again."""
        self.changed.set()
        self.changed = asyncio.Event()

    async def until_changed(self, timeout_s: float) -> None:
        """Wait for a change, but not for ever."""
        try:
            await asyncio.wait_for(self.changed.wait(), timeout_s)
        except TimeoutError:
            return

    def close(self) -> None:
        """Finish what is being done and let go, the rig at rest."""
        with suppress(Exception):
            self._worker.submit(self.task.station.rig.rest).result()
        self._worker.shutdown(wait=True)
