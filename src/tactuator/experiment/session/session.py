"""A subject's session at a rig: which trial comes next, its presentation, and what becomes of its answer.

Its state is replayed from the store: after any interruption the committed trials are taken through the task's state,
and the same trial comes next.
"""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Literal

from tactuator.errors import BadInput, StoreFault, TimingMissed
from tactuator.experiment.presenter import Watch
from tactuator.experiment.protocol.study import PlannedRun
from tactuator.experiment.session.task import Clock, NextTrial, SessionTask
from tactuator.experiment.store import records
from tactuator.experiment.store.records import Found, PlayedTrial, stamp
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.voids import is_void
from tactuator.experiment.task.task import TaskState

_BETWEEN_TRIALS_S = 1.5
"""Time from the end of a trial to the next one where nothing is known of the subject yet."""
_PAUSE_S = 60.0
"""A trial that takes so much longer than its presentation was laid aside, and is left out of the pace."""
_TRIALS_AVERAGED = 30


@dataclass
class Pace:
    """Time of the last thirty trials, each from its beginning, as a share of what their presentation is said to take.

    What lies between trials, a pause or a break however short, is in it nowhere.
    """

    _taken: deque[tuple[float, float]] = field(init=False, default_factory=lambda: deque(maxlen=_TRIALS_AVERAGED))

    def answered(self, taken_s: float, played_s: float) -> None:
        """Take a trial into account that took taken_s, its presentation being said to take played_s."""
        if taken_s < _PAUSE_S + played_s:
            self._taken.append((taken_s, played_s + _BETWEEN_TRIALS_S))

    def trial_s(self, played_s: float) -> float:
        """Return how long a trial takes whose presentation is said to take played_s; before any pace, as assumed."""
        taken_s, said_s = (sum(column) for column in zip(*self._taken, strict=True)) if self._taken else (1.0, 1.0)
        return (played_s + _BETWEEN_TRIALS_S) * taken_s / said_s


_LEVEL_TOLERANCE_DB = 1e-6
"""Difference up to which a stored level is that of the replayed trial: databases keep all digits, text may not."""
_ATTEMPTS_MAX = 3
"""Number of times that a trial is played whose timing the rig misses, before that is a fault of the rig."""


@dataclass(frozen=True)
class Acknowledged:
    """An answer that is in the store.

    right: the right response, where the run has feedback. again: True where the answer was in the store already.
    """

    run: int
    number: int
    correct: bool
    right: str | None
    again: bool = False


@dataclass
class RunTally:
    """Progress of a planned run, of several attempts the last; state: as in the store, or `planned`; row: there."""

    planned: PlannedRun
    state: str = "planned"
    answered: int = 0
    correct: int = 0
    row: int | None = None

    @property
    def over(self) -> bool:
        """Return whether nothing of it is left to do."""
        return self.state in ("done", "stopped")


@dataclass
class Running:
    """The run in progress, with its state. presented: number of its last trial that was played, and how often."""

    row: int
    planned: PlannedRun
    attempt: int
    state: TaskState
    last_heard_s: float
    presented: tuple[int, int] = (-1, 0)


def replay(state: TaskState, run: int, answers: Sequence[Found]) -> None:
    """Take a state through a run's answers. Raises BadInput where the store's trials are not those of the task."""
    for row in answers:
        trial = state.trial()
        level = None if trial is None or trial.placement is None else trial.placement.level_db_sl
        if level is None or row.level_db_sl is None:
            same = level is row.level_db_sl
        else:
            same = abs(level - row.level_db_sl) <= _LEVEL_TOLERANCE_DB
        if trial is None or not same or trial.correct != row.correct_response:
            raise BadInput(f"run {run}, trial {row.number}: the store does not replay", "its own protocol")
        state.record(row.response)


Stage = Literal["consent", "break", "introduction", "trial", "done", "ended"]


class Session:
    """One visit of a subject.

    row: the session's in the store. subject: who it is, as events have it. version: of the protocol that the task is
    of. visit: who answers. tally: every planned run with its answered and right trials. pending: the trial that was
    played and waits for its answer, or None. failed_practice: the run that waits until the experimenter says how it
    goes on, or None. ended: how the session ended before its time (declined, withdrawn, withdrawn-discard), or None.
    Raises BadInput where the store's trials do not replay.
    """

    def __init__(
        self,
        store: Store,
        row: Found,
        task: SessionTask,
        version: int,
        clock: Clock,
        visit: records.Visit | None = None,
    ) -> None:
        self.store, self.id, self.task, self.version, self.clock = store, int(row.id), task, version, clock
        self.visit = visit or records.Visit()
        self._who = (int(row.subject_number), int(row.visit))
        self.subject = f"subject {row.subject_code}"
        self.runs = task.runs(*self._who)
        self.pending: tuple[NextTrial, PlayedTrial] | None = None
        self.failed_practice: PlannedRun | None = None
        self._pace = Pace()
        self.ended: str | None = None
        self._rested_since_s = 0.0
        self._trial_since_s: float | None = None
        self._running: Running | None = None
        self.tally = tuple(map(RunTally, self.runs))
        self._consented = self._introduced = False
        self.trials = self._since_break = 0
        self._load()

    # -- state from the store

    def _load(self) -> None:
        with self.store.read() as connection:
            row = records.session(connection, self.id)
            self.ended, pinned = row.ended, row.protocol_version_id
            self._consented = row.consented_utc is not None or not self.task.protocol.study.consent
            tallies = records.tallies(connection, self.id)
            self.trials = sum(tally.answered for tally in tallies.values())
            self._since_break = self.trials - records.last_break(connection, self.id)
            runs, void = records.latest_runs(connection, self.id), is_void(connection, self.id)
            going = next((run for run in runs if run.state == "running"), None)
            answers = [] if going is None else records.answers(connection, going.id)
        if pinned not in (None, self.version):
            raise BadInput(f"session {self.id} began under another version of the protocol", "that one")
        last = max((tally.last_utc for tally in tallies.values()), default=None)
        self._rested_since_s = self.clock.monotonic_s() - (0.0 if last is None else max(self._since_s(last), 0.0))
        for run in runs:
            tally, answered = self.tally[run.position], tallies.get(run.id)
            tally.state, tally.row = run.state, run.id
            if answered is not None:
                tally.answered, tally.correct = int(answered.answered), int(answered.right)
        for tally in self.tally:
            if void and not tally.over:  # nobody need answer what is left out
                tally.state = "stopped"
        if going is not None:
            self._take_up(going, answers)

    def _take_up(self, run: Found, answers: list[Found]) -> None:
        """Go on with a run, and count how long it lay there by the wall clock, all that is known after a crash."""
        self._running = self._new_running(run.id, self.runs[run.position], run.attempt)
        replay(self._running.state, run.id, answers)
        gap_s = self._since_s(answers[-1].server_received_utc if answers else run.started_utc)
        if gap_s < 0.0:
            detail = f"the clock is {-gap_s:.0f} s before the last answer: no interruption is counted"
            self.note("clock-jump", detail, records.PROGRAM)
        self._running.last_heard_s -= max(gap_s, 0.0)
        self._end_finished_run()

    def _since_s(self, stamped: str) -> float:
        return (self.clock.utc() - datetime.fromisoformat(stamped)).total_seconds()

    def _new_running(self, row: int, planned: PlannedRun, attempt: int) -> Running:
        state = self.task.begin(planned, *self._who, attempt)
        return Running(row, planned, attempt, state, self.clock.monotonic_s())

    # -- present state

    @property
    def stage(self) -> Stage:
        """Return what the subject is to do now."""
        if self.ended is not None:
            return "ended"
        if not self._consented:
            return "consent"
        upcoming = self.upcoming
        if upcoming is None:
            return "done"
        rules = self.task.rules
        between = rules.break_between_runs and self._running is None and self._since_break > 0
        if between or (rules.break_after_trials is not None and self._since_break >= rules.break_after_trials):
            return "break"
        introduced = self._introduced or self._running is not None or not upcoming.introduction
        return "trial" if introduced else "introduction"

    @property
    def break_left_s(self) -> float:
        """Return how long the subject has to rest still; 0 where no break is due, or nobody there needs it."""
        if self.stage != "break" or self.visit.respondent != "person":
            return 0.0
        return max(0.0, self.task.rules.break_s - (self.clock.monotonic_s() - self._rested_since_s))

    @property
    def time_left_s(self) -> float:
        """Return about how long the session still takes, breaks aside: what is planned, at the pace so far."""
        left_s, current = 0.0, self._running
        for run in (tally.planned for tally in self.tally if not tally.over):
            trials, played_s = self.task.expected(run)
            if current is not None and current.planned is run:
                trials = max(1.0, (1.0 - current.state.progress) * max(trials, float(current.state.trials)))
            left_s += trials * self._pace.trial_s(played_s)
        return left_s

    @property
    def upcoming(self) -> PlannedRun | None:
        """Return the run that goes on, or the next to begin; None at the end."""
        if self._running is not None:
            return self._running.planned
        return next((tally.planned for tally in self.tally if not tally.over), None)

    @property
    def progress(self) -> float:
        """Return the share of the whole session, 0 to 1; runs count by their trials where these are known before."""
        done = sum(tally.planned.trials or 1.0 for tally in self.tally if tally.over)
        if self._running is not None:
            done += (self._running.planned.trials or 1.0) * self._running.state.progress
        return done / sum(run.trials or 1.0 for run in self.runs)

    @property
    def running(self) -> Running | None:
        """Return the run in progress, or None."""
        return self._running

    @property
    def comes(self) -> tuple[str, str]:
        """Return what a page shows before the subject goes on: the stage and the introduction of the next run."""
        run = self.upcoming
        return self.stage, "" if run is None else "\n".join(filter(None, [run.announcement, run.introduction]))

    def next_trial(self) -> NextTrial:
        """Return the trial to present now; begins a run where none goes on, and again where it lay too long.

        Raises BadInput unless the stage is `trial`.
        """
        upcoming = self.upcoming
        if self.stage != "trial" or upcoming is None:
            raise BadInput(f"session is at {self.stage!r}", "a trial only where one is due")
        running = self._running
        if running is None:
            with self.store.read() as connection:
                runs = records.latest_runs(connection, self.id)
            before = next((run for run in runs if run.position == upcoming.position), None)
            known = self.tally[upcoming.position].state
            if before is not None and before.state != known and not self.store.is_file:
                raise BadInput(f"the visit of {self.subject} goes on at another station", "that station")
            running = self._begin(upcoming, 0 if before is None else before.attempt + 1)
        elif self.clock.monotonic_s() - running.last_heard_s > self.task.rules.resume_within_s:
            running = self._begin(running.planned, running.attempt + 1, replaced=running)
        trial = running.state.trial()
        assert trial is not None
        self._trial_since_s = self.clock.monotonic_s()
        return NextTrial(running.row, running.planned, trial, running.state.seed)

    def _begin(self, planned: PlannedRun, attempt: int, replaced: Running | None = None) -> Running:
        now = self.clock.utc()
        with self.store.begin() as connection:
            if replaced is not None:
                records.end_run(connection, replaced.row, "restarted", now)
                limit = self.task.rules.resume_within_s
                detail = f"run {replaced.row} lay longer than {limit:g} s"
                records.note(connection, self.id, "restart", detail, now, records.PROGRAM)
            apparatus = self.task.apparatus.record(planned.finger)
            row = records.begin_run(connection, self.id, planned, attempt, apparatus, self.visit, self.version, now)
            records.change_session(connection, self.id, protocol_version_id=self.version)
        tally = self.tally[planned.position]
        tally.state, tally.answered, tally.correct, tally.row = "running", 0, 0, row
        self._running = self._new_running(row, planned, attempt)
        return self._running

    # -- presentation, answers and events

    def present(self, watch: Watch, halted: Callable[[], bool] = lambda: False) -> NextTrial:
        """Play the next trial; again, if it was played and never answered, or its timing was missed.

        halted: called while it plays, True to stop it. Raises Halted where it was stopped, the trial then being
        unplayed, and TimingMissed where the rig missed the timing again and again.
        """
        self.pending = None
        following, outlet = self.next_trial(), self.task.apparatus.outlet
        watch = watch if outlet is None else outlet.watching(watch)
        for attempt in range(_ATTEMPTS_MAX):
            times = self._count_presentation(following.trial.number)
            try:
                played = self.task.play(following, watch, halted, self.clock.utc())
            except TimingMissed as missed:
                detail = f"run {following.run}, trial {following.trial.number}: {missed}"
                self.note("timing-missed", detail, records.PROGRAM)
                if attempt + 1 == _ATTEMPTS_MAX:
                    raise
                continue
            ended, ended_s = self.clock.utc(), self.clock.monotonic_s()
            self.pending = following, replace(played, ended=ended, ended_s=ended_s, presentations=times)
            if outlet is not None:
                outlet.played(following.run, self.pending[1])
            break
        return following

    def _count_presentation(self, number: int) -> int:
        assert self._running is not None
        last, times = self._running.presented
        self._running.presented = number, times + 1 if last == number else 1
        return self._running.presented[1]

    def answer(self, answer: records.Answer) -> Acknowledged:
        """Save the answer to the pending trial; it returns only after the commit.

        Raises BadInput where no trial waits, for an answer given before the last interval ended or was asked
        for, and for a response that is not allowed; and StoreFault, with nothing changed, where it could not be saved:
        the same answer may then come again.
        """
        running = self._running
        if self.pending is None or running is None:
            raise BadInput("no trial waits for an answer", "an answer after its trial")
        played = self.pending[1]
        if answer.received_s is not None and played.ended_s is not None and answer.received_s < played.ended_s:
            raise BadInput(f"answered {played.ended_s - answer.received_s:.3f} s before the interval ended", "after it")
        shown_ms, pressed_ms = answer.client_shown_ms, answer.client_pressed_ms
        if shown_ms is not None and pressed_ms is not None and pressed_ms < shown_ms:
            raise BadInput(f"answered {shown_ms - pressed_ms:g} ms before the question", "after it")
        number, correct = played.trial.number, played.trial.judge(answer.response)
        with self.store.begin() as connection:
            records.save_answer(connection, running.row, played, answer)
        self.pending = None
        running.state.record(answer.response)
        running.last_heard_s = self._rested_since_s = self.clock.monotonic_s()
        if self._trial_since_s is not None:
            taken_s = running.last_heard_s - self._trial_since_s + self.task.rules.feedback_s
            self._pace.answered(taken_s, self.task.expected(running.planned)[1])
        tally = self.tally[running.planned.position]
        tally.answered, tally.correct = tally.answered + 1, tally.correct + correct
        self.trials += 1
        self._since_break += 1
        self._end_finished_run()
        if (outlet := self.task.apparatus.outlet) is not None:
            ago_s = 0.0 if answer.received_s is None else self.clock.monotonic_s() - answer.received_s
            outlet.answered(running.row, played, answer.response, ago_s)
        right_response = played.trial.correct if running.planned.feedback else None
        return Acknowledged(running.row, number, correct, right_response)

    def already(self, run: int, number: int) -> Acknowledged | None:
        """Return the acknowledgement of an answer that is in the store, for one that is sent again, or None."""
        with self.store.read() as connection:
            row = records.answer(connection, self.id, run, number)
        if row is None:
            return None
        right_response = row.correct_response if self.runs[row.position].feedback else None
        return Acknowledged(run, number, bool(row.correct), right_response, again=True)

    def _end_finished_run(self) -> None:
        """Mark a run that has come to its end; where that cannot be saved, the replay of its trials marks it again.

        Practice that has not met its criterion is not over: it begins again, once the experimenter says so.
        """
        running = self._running
        if running is None or running.state.trial() is not None:
            return
        state = "done" if running.state.passed else "restarted"
        self._leave_run(state)
        with suppress(StoreFault), self.store.begin() as connection:
            now = self.clock.utc()
            records.end_run(connection, running.row, state, now)
            if state == "restarted":
                self.failed_practice = running.planned
                detail = f"run {running.row}: {running.state.trials} trials"
                records.note(connection, self.id, "practice-not-passed", detail, now, records.PROGRAM)

    def _leave_run(self, state: str) -> None:
        assert self._running is not None
        self.tally[self._running.planned.position].state = state
        self._running = self.pending = None
        self._introduced = False

    def give_consent(self, name: str = "") -> None:
        """Store consent to this text, in this version of the protocol, which the session stays with.

        Raises BadInput without a name where the protocol asks for it.
        """
        study, now = self.task.protocol.study, self.clock.utc()
        if study.consent_by == "name" and not name.strip():
            raise BadInput("consent without a name", "with it, since the protocol asks for it")
        with self.store.begin() as connection:
            records.change_session(
                connection,
                self.id,
                consented_utc=stamp(now),
                consent_version=study.consent_version or None,
                consent_sha256=hashlib.sha256(study.consent.encode()).hexdigest(),
                protocol_version_id=self.version,
            )
            if study.consent_by == "name":
                records.note(connection, self.id, records.CONSENT_NAME, name.strip(), now, self.subject)
        self._consented = True

    def decline(self) -> None:
        """End the session before it began, as the subject did not agree. Raises BadInput once there is consent."""
        if self.stage != "consent":
            raise BadInput(f"session is at {self.stage!r}", "declining where consent is asked for")
        self._end("declined", "before the first trial")

    def withdraw(self, keep: bool) -> None:
        """End the subject's part for good; keep: the answers so far may be used. Raises BadInput if it has ended."""
        if self.ended is not None:
            raise BadInput(f"session has ended ({self.ended})", "leaving one that goes on")
        if self._running is not None:
            self.stop_run()
        self._end("withdrawn" if keep else "withdrawn-discard", "answers kept" if keep else "answers not to be used")

    def _end(self, how: str, detail: str) -> None:
        now = self.clock.utc()
        with self.store.begin() as connection:
            records.change_session(connection, self.id, ended=how, ended_utc=stamp(now))
            records.note(connection, self.id, how, detail, now, self.subject)
        self.ended = how

    def end_break(self) -> None:
        """End a break. Raises BadInput before the break has lasted as long as it has to."""
        left_s = self.break_left_s
        if left_s > 0.0:
            raise BadInput(f"break: {left_s:.0f} s are left", "going on after them")
        self.note("break", "over", trials=self.trials)
        self._since_break = 0

    def release(self) -> None:
        """Begin practice again that was not passed."""
        self.failed_practice = None

    def introduce(self) -> None:
        """Remember that the subject has read what the next run is."""
        self._introduced = True

    def stop_run(self) -> None:
        """Stop the run in progress, or practice that was not passed; its trials stay, marked."""
        planned = self.failed_practice if self._running is None else self._running.planned
        if planned is None:
            raise BadInput("no run in progress")
        with self.store.begin() as connection:
            runs = records.latest_runs(connection, self.id)
            row = next(run.id for run in runs if run.position == planned.position)
            records.end_run(connection, row, "stopped", self.clock.utc())
        if self._running is None:
            self.tally[planned.position].state, self.failed_practice = "stopped", None
        else:
            self._leave_run("stopped")

    def note(self, kind: str, detail: str, who: str | None = None, trials: int | None = None) -> None:
        """Store an event of that kind; who: whose doing it was, None the subject's."""
        with self.store.begin() as connection:
            records.note(connection, self.id, kind, detail, self.clock.utc(), who or self.subject, trials)
