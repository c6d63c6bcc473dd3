"""Protocol files of studies in which tones are judged: their table [task] says what is asked."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from tactuator.experiment.protocol.study import PlannedRun, RunRules, StudyProtocol, further
from tactuator.experiment.task.task import Task, parse_task
from tactuator.experiment.trial import Marks, Timing
from tactuator.experiment.words import Words
from tactuator.parameters import Flag, Whole, kept_by, table


@table("[session]")
class JudgingRules(RunRules):
    """Keys of [session]: practice before the first run, breaks, and the longest interruption of a run."""

    practice_trials: Annotated[Whole, Field(ge=0, le=100, description="trials of practice")] = 5
    feedback: Annotated[Flag, Field(description="of discrimination: the right response is shown")] = False


@table("protocol")
class JudgingProtocol(StudyProtocol):
    """The protocol file of a study whose table [task] names the task."""

    task: Annotated[Task, *kept_by(parse_task, "a kind of task, with its keys")]
    session: JudgingRules = JudgingRules()
    timing: Timing = Timing()
    marks: Marks | None = None

    @property
    def asks(self) -> str:
        return self.task.kind

    def warnings(self) -> Iterator[str]:
        yield from super().warnings()
        yield from self.task.warnings()

    def parts(self, words: Words) -> tuple[PlannedRun, ...]:
        return tuple(
            PlannedRun(
                plan.finger,
                plan.frequency_hz,
                paradigm=self.task.kind,
                procedure=self.task.kind,
                feedback=self.session.feedback,
                title=words("run.title", finger=plan.finger, what=plan.what),
                typical_trials=plan.trials,
                part=part,
            )
            for part, plan in enumerate(self.task.plans(words))
        )

    def order(self, count: int, subject: int, visit: int) -> Sequence[int]:
        rng = np.random.default_rng([self.study.seed, 13, subject, *further(visit)])
        return [int(index) for index in rng.permutation(count)]

    def practice(self, parts: Sequence[PlannedRun], order: Sequence[int], words: Words) -> Sequence[PlannedRun]:
        trials = self.session.practice_trials
        return [parts[index].practised(trials, words("run.practice_plain"), words) for index in order[: trials and 1]]
