"""Judging as a session's task: any task of `tactuator.tasks`, its tones on the fingers of the display."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from tactuator.experiment.protocol.file import JudgingProtocol, plan_judging
from tactuator.experiment.protocol.study import PlannedRun, run_seed
from tactuator.experiment.session.task import OfferedResponse, Question, Rules
from tactuator.experiment.session.tones import ToneCourse, ToneTask
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import answered_runs
from tactuator.experiment.task.task_keys import JudgedTone, Judgement, Place, TaskRun
from tactuator.experiment.trial import Trial
from tactuator.table import ResultTable


@dataclass(frozen=True)
class JudgingTask(ToneTask):
    """A protocol with a task at an apparatus. Raises BadInput where the display has no such finger."""

    protocol: JudgingProtocol

    def __post_init__(self) -> None:
        super().__post_init__()
        for finger in self.protocol.task.fingers_used():
            self.apparatus.channel(finger)
        for index in range(len(self.protocol.task.plans(self.words))):
            self.protocol.task.begin(index, self.place, (0,)).trial(0)

    @property
    def place(self) -> Place:
        """Return what the task's runs are played on."""
        timing = self.protocol.timing
        return Place(self.apparatus.playable(timing), timing)

    @property
    def question(self) -> Question:
        """Return the question of every trial."""
        asked = self.protocol.task.asked(self.words)
        choices = tuple(OfferedResponse(response, keys) for response, keys in asked.responses)
        return Question(asked.prompt, choices, asked.intervals)

    @property
    def rules(self) -> Rules:
        """Return the rules of a session, as the protocol has them."""
        session = self.protocol.session
        return Rules.of(session, self.protocol.timing.feedback_s if session.feedback else 0.0)

    def runs(self, subject: int, visit: int = 1) -> tuple[PlannedRun, ...]:
        """Return practice, then the runs of the task in the subject's order."""
        return plan_judging(self.protocol, self.words, subject, visit)

    def expected(self, planned: PlannedRun) -> tuple[float, float]:
        """Return the approximate number of trials of a run, and how many seconds one of them plays."""
        task = self.protocol.task
        intervals = max(len(task.asked(self.words).intervals), 1)
        return self._expected(planned, task.plans(self.words)[planned.part].trials, intervals, self.rules.feedback_s)

    def course(self, planned: PlannedRun, subject: int, visit: int = 1, attempt: int = 0) -> JudgingCourse:
        """Return the course of a run from its beginning."""
        seed = run_seed(self.protocol, subject, planned.position, attempt, visit)
        return JudgingCourse(self, planned, seed, self.protocol.task.begin(planned.part, self.place, seed))

    def tones(self, planned: PlannedRun, trial: Trial) -> Sequence[Sequence[JudgedTone]]:
        """Return the tones of every interval."""
        assert isinstance(trial, Judgement)
        return trial.tones

    def results(self, store: Store, session: int) -> tuple[ResultTable, ...]:
        """Return what the answers of the runs that are done come to. Raises BadInput where there is none."""
        runs = answered_runs(store, self.protocol.task.kind, session=session)
        notes = (self.words("results.simulated"),) if any(run.simulated for run in runs) else ()
        tables = self.protocol.task.results(runs, self.words)
        return tuple(replace(table, notes=(*notes, *table.notes)) for table in tables)


@dataclass
class JudgingCourse(ToneCourse):
    """Course of one run of the task's state machine."""

    task: JudgingTask
    run: TaskRun

    @property
    def _limit(self) -> float:
        return self.task.protocol.session.practice_trials if self.planned.practice else math.inf

    @property
    def progress(self) -> float:
        """Return how far the run is, from 0 to 1."""
        return min(1.0, self.trials / self._limit) if self.planned.practice else self.run.progress

    def _draw(self) -> Judgement | None:
        return None if self.trials >= self._limit else self.run.trial(self.trials)

    def _learn(self, trial: Trial, response: str, correct: bool) -> None:
        assert isinstance(trial, Judgement)
        self.run.record(trial, response)
