"""A subject's session: which trial comes next, and what becomes of its answer, whatever the task.

Everything it knows it learns from the store: after any interruption the committed trials are replayed through the
task's course and the same next trial stands there.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from typing import Literal

from tactuator.errors import BadInput, StoreFault
from tactuator.experiment.protocol.plan import PlannedRun
from tactuator.experiment.session.clock import Clock
from tactuator.experiment.session.task import Course, Task
from tactuator.experiment.store import records
from tactuator.experiment.store.store import Store
from tactuator.experiment.trial.trial import Trial

Stage = Literal["consent", "break", "introduction", "trial", "done"]
_SAME_DB = 1e-6


@dataclass(frozen=True)
class NextTrial:
    """run: its row in the store; seed: of the run."""

    run: int
    planned: PlannedRun
    trial: Trial
    seed: tuple[int, ...]


@dataclass(frozen=True)
class Acknowledged:
    """An answer that is in the store for good. right: the right response, where the run has feedback; again: it was

    there already.
    """

    run: int
    number: int
    correct: bool
    right: str | None
    again: bool = False


@dataclass(frozen=True)
class RunTally:
    """How far a planned run is. state: as in the store, or `planned`."""

    planned: PlannedRun
    state: str
    answered: int
    correct: int


@dataclass
class _Running:
    """The run that goes on."""

    row: int
    planned: PlannedRun
    attempt: int
    course: Course
    last_heard_s: float


class Session:
    """number: of the subject. Raises BadInput where the store's trials do not replay."""

    def __init__(self, store: Store, session: int, number: int, task: Task, clock: Clock) -> None:
        self.store, self.id, self.task, self.clock = store, session, task, clock
        self.runs = task.runs(number)
        self._number = number
        self._running: _Running | None = None
        self._states: dict[int, str] = {}
        self._tally: dict[int, tuple[int, int]] = {}
        self._consented = self._introduced = False
        self.trials = self._since_break = 0
        self._load()

    # -- what the store says

    def _load(self) -> None:
        with self.store.read() as connection:
            row = records.session(connection, self.id)
            self._consented = row.consented_utc is not None or not self.task.protocol.study.consent
            self.trials = records.trial_count(connection, self.id)
            self._since_break = self.trials - records.last_break(connection, self.id)
            runs = records.latest_runs(connection, self.id)
            tallies = records.tallies(connection, self.id)
            going = next((run for run in runs if run.state == "running"), None)
            answers = [] if going is None else records.answers(connection, going.id)
        self._states = {run.position: run.state for run in runs}
        self._tally = {run.position: tallies.get(run.id, (0, 0)) for run in runs}
        if going is not None:
            self._running = self._replay(going, answers)
            self._age(going, answers)
            self._settle()

    def _replay(self, run: records.Found, answers: list[records.Found]) -> _Running:
        running = self._fresh(run.id, self.runs[run.position], run.attempt)
        for row in answers:
            trial = running.course.trial()
            if trial is None or not _is_stored(trial, row):
                raise BadInput(
                    f"run {run.id}, trial {row.number}: the store does not replay; allowed: its own protocol"
                )
            running.course.record(row.response)
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
        course = self.task.course(planned, self._number, attempt)
        return _Running(row, planned, attempt, course, self.clock.monotonic_s())

    # -- where it stands

    @property
    def stage(self) -> Stage:
        """What the subject is to do now."""
        if not self._consented:
            return "consent"
        upcoming = self.upcoming
        if upcoming is None:
            return "done"
        if self._break_is_due():
            return "break"
        introduced = self._introduced or self._running is not None or not upcoming.introduction
        return "trial" if introduced else "introduction"

    def _break_is_due(self) -> bool:
        rules = self.task.rules
        between = rules.break_between_runs and self._running is None and self._since_break > 0
        return between or (rules.break_after_trials is not None and self._since_break >= rules.break_after_trials)

    @property
    def upcoming(self) -> PlannedRun | None:
        """The run that goes on, or the next to begin; None at the end."""
        if self._running is not None:
            return self._running.planned
        return next((run for run in self.runs if not self._is_over(run)), None)

    def _is_over(self, run: PlannedRun) -> bool:
        return self._states.get(run.position) in ("done", "stopped")

    @property
    def progress(self) -> float:
        """Share of the whole session, 0 to 1: runs count by their trials where these are known before."""
        done = sum(run.trials or 1.0 for run in self.runs if self._is_over(run))
        if self._running is not None:
            done += (self._running.planned.trials or 1.0) * self._running.course.progress
        return done / sum(run.trials or 1.0 for run in self.runs)

    @property
    def course(self) -> Course | None:
        """Of the run that goes on."""
        return None if self._running is None else self._running.course

    @property
    def tally(self) -> tuple[RunTally, ...]:
        """Every planned run, how many trials are answered and how many of them right; of attempts, the last."""
        return tuple(
            RunTally(run, self._states.get(run.position, "planned"), *self._tally.get(run.position, (0, 0)))
            for run in self.runs
        )

    def next_trial(self) -> NextTrial:
        """The trial to present now; begins a run where none goes on, and again where it lay too long.

        BadInput unless the stage is `trial`.
        """
        upcoming = self.upcoming
        if self.stage != "trial" or upcoming is None:
            raise BadInput(f"session is at {self.stage!r}; allowed: a trial only where one is due")
        running = self._running
        if running is None:
            running = self._begin(upcoming, self._attempts(upcoming.position))
        elif self.clock.monotonic_s() - running.last_heard_s > self.task.rules.resume_within_s:
            running = self._begin(running.planned, running.attempt + 1, replaced=running)
        trial = running.course.trial()
        assert trial is not None
        return NextTrial(running.row, running.planned, trial, running.course.seed)

    def _attempts(self, position: int) -> int:
        with self.store.read() as connection:
            return records.attempts(connection, self.id, position)

    def _begin(self, planned: PlannedRun, attempt: int, replaced: _Running | None = None) -> _Running:
        now = self.clock.utc()
        with self.store.begin() as connection:
            if replaced is not None:
                records.end_run(connection, replaced.row, "restarted", now)
                limit = self.task.rules.resume_within_s
                records.note(connection, self.id, "restart", f"run {replaced.row} lay longer than {limit:g} s", now)
            apparatus = self.task.station.apparatus(planned.finger)
            row = records.begin_run(connection, self.id, planned, attempt, apparatus, now)
        self._states[planned.position], self._tally[planned.position] = "running", (0, 0)
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
        if running is None or number != running.course.trials:
            raise BadInput(f"answer to trial {number}; allowed: to the trial that stands")
        correct = played.trial.judge(answer.response)
        with self.store.begin() as connection:
            records.save_answer(connection, running.row, played, answer)
        running.course.record(answer.response)
        running.last_heard_s = self.clock.monotonic_s()
        answered, right = self._tally[running.planned.position]
        self._tally[running.planned.position] = (answered + 1, right + correct)
        self.trials += 1
        self._since_break += 1
        self._settle()
        told = played.trial.correct if running.planned.feedback else None
        return Acknowledged(running.row, number, correct, told)

    def already(self, run: int, number: int) -> Acknowledged | None:
        """The acknowledgement of an answer that is in the store, or None: for an answer that is sent again."""
        with self.store.read() as connection:
            row = records.answer(connection, self.id, run, number)
        if row is None:
            return None
        told = row.correct_response if self.runs[row.position].feedback else None
        return Acknowledged(run, number, bool(row.correct), told, again=True)

    def _settle(self) -> None:
        """Mark a run that has come to its end. Where that cannot be saved, the replay of its trials says it again."""
        running = self._running
        if running is None or running.course.trial() is not None:
            return
        self._over("done")
        with suppress(StoreFault), self.store.begin() as connection:
            records.end_run(connection, running.row, "done", self.clock.utc())

    def _over(self, state: str) -> None:
        assert self._running is not None
        self._states[self._running.planned.position] = state
        self._running, self._introduced = None, False

    def give_consent(self) -> None:
        """The subject agreed."""
        with self.store.begin() as connection:
            records.consent(connection, self.id, self.clock.utc())
        self._consented = True

    def end_break(self) -> None:
        """The subject goes on."""
        self._note("break", "over", self.trials)
        self._since_break = 0

    def introduce(self) -> None:
        """The subject has read what the next run is."""
        self._introduced = True

    def stop_run(self) -> None:
        """The operator gives up the run that goes on; its trials stay, marked."""
        if self._running is None:
            raise BadInput("no run goes on; allowed: stopping one that does")
        with self.store.begin() as connection:
            records.end_run(connection, self._running.row, "stopped", self.clock.utc())
        self._over("stopped")

    def _note(self, kind: str, detail: str, trials: int | None = None) -> None:
        with self.store.begin() as connection:
            records.note(connection, self.id, kind, detail, self.clock.utc(), trials)


def _is_stored(trial: Trial, row: records.Found) -> bool:
    """Whether a trial is the one that the store's row says."""
    level = None if trial.placement is None else trial.placement.level_db_sl
    if level is None or row.level_db_sl is None:
        same = level is row.level_db_sl
    else:
        same = abs(level - row.level_db_sl) <= _SAME_DB
    return same and trial.correct == row.correct_response
