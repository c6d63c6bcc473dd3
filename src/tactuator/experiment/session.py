"""A subject's session: which trial comes next, and what becomes of its answer.

Everything it knows it learns from the store: after any interruption the committed trials are replayed through the
procedure and the same next trial stands there.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from typing import Literal

from tactuator.errors import BadInput
from tactuator.experiment import records
from tactuator.experiment.clock import Clock
from tactuator.experiment.plan import PlannedRun, plan_runs, run_seed
from tactuator.experiment.procedure import Procedure
from tactuator.experiment.protocol import Protocol
from tactuator.experiment.store import Store, StoreFault
from tactuator.experiment.trial import Trial

Stage = Literal["consent", "trial", "break", "done"]
_SAME_DB = 1e-6


@dataclass(frozen=True)
class NextTrial:
    """run: its row in the store; seed: of its presentation."""

    run: int
    planned: PlannedRun
    trial: Trial
    frequency_hz: float
    seed: tuple[int, ...]


@dataclass(frozen=True)
class Acknowledged:
    """An answer that is in the store for good. again: it was there already."""

    run: int
    number: int
    correct: bool
    again: bool = False


@dataclass
class _Running:
    """The run that goes on."""

    row: int
    planned: PlannedRun
    attempt: int
    procedure: Procedure
    seed: tuple[int, ...]
    last_heard_s: float
    levels: list[float] = field(default_factory=list)
    outcomes: list[bool] = field(default_factory=list)

    def record(self, correct: bool) -> None:
        """A trial is answered."""
        placement = self.procedure.placement()
        assert placement is not None
        self.levels.append(placement.level_db_sl)
        self.outcomes.append(correct)
        self.procedure.record(correct)


class Session:
    """apparatus: of a finger; band_hz: of the display. Raises BadInput where the store's trials do not replay."""

    def __init__(
        self,
        store: Store,
        session: int,
        number: int,
        protocol: Protocol,
        apparatus: Callable[[str], records.Apparatus],
        band_hz: tuple[float, float],
        clock: Clock,
    ) -> None:
        self.store, self.id, self.protocol, self.clock = store, session, protocol, clock
        self.runs = plan_runs(protocol, number)
        self._number, self._apparatus, self._band_hz = number, apparatus, band_hz
        self._running: _Running | None = None
        self._finished: set[int] = set()
        self._consented = False
        self.trials = self._since_break = 0
        self._load()

    # -- what the store says

    def _load(self) -> None:
        with self.store.read() as connection:
            row = records.session(connection, self.id)
            self._consented = row.consented_utc is not None or not self.protocol.study.consent
            self.trials = records.trial_count(connection, self.id)
            self._since_break = self.trials - records.last_break(connection, self.id)
            runs = records.latest_runs(connection, self.id)
            going = next((run for run in runs if run.state == "running"), None)
            answers = [] if going is None else records.answers(connection, going.id)
        self._finished = {run.position for run in runs if run.state in ("done", "stopped")}
        if going is not None:
            self._running = self._replay(going, answers)
            self._age(going, answers)
            self._settle()

    def _replay(self, run: records.Found, answers: list[records.Found]) -> _Running:
        running = self._fresh(run.id, self.runs[run.position], run.attempt)
        for row in answers:
            placement = running.procedure.placement()
            if placement is None or abs(placement.level_db_sl - row.level_db_sl) > _SAME_DB:
                raise BadInput(
                    f"run {run.id}, trial {row.number}: the store does not replay; allowed: its own protocol"
                )
            running.record(bool(row.correct))
        return running

    def _age(self, run: records.Found, answers: list[records.Found]) -> None:
        """How long the run has lain there already, by the wall clock: all that is known after a crash."""
        last = datetime.fromisoformat(answers[-1].server_received_utc if answers else run.started_utc)
        gap_s = (self.clock.utc() - last).total_seconds()
        if gap_s < 0.0:
            self._note("clock-jump", f"the clock is {-gap_s:.0f} s before the last answer: no interruption is counted")
        assert self._running is not None
        self._running.last_heard_s -= max(gap_s, 0.0)

    def _fresh(self, row: int, planned: PlannedRun, attempt: int) -> _Running:
        protocol = self.protocol
        if planned.practice:
            procedure: Procedure = protocol.practice(planned.frequency_hz or 100.0)
        else:
            procedure = protocol.procedure.build(protocol.forced_choice(), self._band_hz)
        seed = run_seed(protocol, self._number, planned.position, attempt)
        return _Running(row, planned, attempt, procedure, seed, self.clock.monotonic_s())

    # -- where it stands

    @property
    def stage(self) -> Stage:
        """What the subject is to do now."""
        if not self._consented:
            return "consent"
        if len(self._finished) == len(self.runs):
            return "done"
        return "break" if self._since_break >= self.protocol.session.break_after_trials else "trial"

    @property
    def progress(self) -> float:
        """Share of the whole session, 0 to 1."""
        part = self._running.procedure.progress if self._running is not None else 0.0
        return (len(self._finished) + part) / len(self.runs)

    @property
    def running(self) -> tuple[PlannedRun, Procedure] | None:
        """The run that goes on."""
        return None if self._running is None else (self._running.planned, self._running.procedure)

    @property
    def history(self) -> tuple[list[float], list[bool]]:
        """Levels (dB SL) and outcomes of the trials of the run that goes on."""
        return ([], []) if self._running is None else (list(self._running.levels), list(self._running.outcomes))

    def next_trial(self) -> NextTrial:
        """The trial to present now; begins a run where none goes on, and again where it lay too long.

        BadInput unless the stage is `trial`.
        """
        if self.stage != "trial":
            raise BadInput(f"session is at {self.stage!r}; allowed: a trial only where one is due")
        running = self._running
        if (
            running is not None
            and self.clock.monotonic_s() - running.last_heard_s > self.protocol.session.resume_within_s
        ):
            running = self._begin(running.planned, running.attempt + 1, replaced=running)
        if running is None:
            position = min(set(range(len(self.runs))) - self._finished)
            running = self._begin(self.runs[position], self._attempts(position))
        placement = running.procedure.placement()
        assert placement is not None
        trial = self.protocol.forced_choice().trial(running.procedure.trials, placement, running.seed)
        frequency = placement.frequency_hz if placement.frequency_hz is not None else running.planned.frequency_hz
        assert frequency is not None
        return NextTrial(running.row, running.planned, trial, frequency, running.seed)

    def _attempts(self, position: int) -> int:
        with self.store.read() as connection:
            return records.attempts(connection, self.id, position)

    def _begin(self, planned: PlannedRun, attempt: int, replaced: _Running | None = None) -> _Running:
        now = self.clock.utc()
        with self.store.begin() as connection:
            if replaced is not None:
                records.end_run(connection, replaced.row, "restarted", now)
                limit = self.protocol.session.resume_within_s
                records.note(connection, self.id, "restart", f"run {replaced.row} lay longer than {limit:g} s", now)
            kind = self.protocol.procedure.kind
            apparatus = self._apparatus(planned.finger)
            row = records.begin_run(connection, self.id, planned, attempt, kind, apparatus, now)
        self._running = self._fresh(row, planned, attempt)
        return self._running

    # -- what comes in

    def answer(self, played: records.Played, answer: records.Answer) -> Acknowledged:
        """Save the answer to the trial that stands; it returns only after the commit.

        BadInput for an answer that is not allowed or to another trial; StoreFault, with nothing changed, where it could
        not be saved: the same answer may come again.
        """
        running = self._running
        number = played.trial.number
        if running is None or number != running.procedure.trials:
            raise BadInput(f"answer to trial {number}; allowed: to the trial that stands")
        correct = played.trial.judge(answer.response)
        with self.store.begin() as connection:
            records.save_answer(connection, running.row, played, answer)
        running.record(correct)
        running.last_heard_s = self.clock.monotonic_s()
        self.trials += 1
        self._since_break += 1
        self._settle()
        return Acknowledged(running.row, number, correct)

    def already(self, run: int, number: int) -> Acknowledged | None:
        """The acknowledgement of an answer that is in the store, or None: for an answer that is sent again."""
        with self.store.read() as connection:
            row = records.answer(connection, self.id, run, number)
        return None if row is None else Acknowledged(run, number, bool(row.correct), again=True)

    def _settle(self) -> None:
        """Mark a run that has come to its end. Where that cannot be saved, the replay of its trials says it again."""
        running = self._running
        if running is None or running.procedure.placement() is not None:
            return
        self._finished.add(running.planned.position)
        self._running = None
        with suppress(StoreFault), self.store.begin() as connection:
            records.end_run(connection, running.row, "done", self.clock.utc())

    def give_consent(self) -> None:
        """The subject agreed."""
        with self.store.begin() as connection:
            records.consent(connection, self.id, self.clock.utc())
        self._consented = True

    def end_break(self) -> None:
        """The subject goes on."""
        self._note("break", "over", self.trials)
        self._since_break = 0

    def stop_run(self) -> None:
        """The operator gives up the run that goes on; its trials stay, marked."""
        if self._running is None:
            raise BadInput("no run goes on; allowed: stopping one that does")
        with self.store.begin() as connection:
            records.end_run(connection, self._running.row, "stopped", self.clock.utc())
        self._finished.add(self._running.planned.position)
        self._running = None

    def _note(self, kind: str, detail: str, trials: int | None = None) -> None:
        with self.store.begin() as connection:
            records.note(connection, self.id, kind, detail, self.clock.utc(), trials)
