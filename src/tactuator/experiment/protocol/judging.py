"""Protocol files of studies in which tones are judged: their table [task] says what is asked."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from tactuator.experiment.language.words import Words
from tactuator.experiment.protocol.study import PlannedRun, RunRules, StudyProtocol, further
from tactuator.experiment.task.task_keys import TaskKeys, parse_task
from tactuator.experiment.trial.trial import Marks, Timing
from tactuator.parameters import Flag, Whole, kept_by, table


@table("[session]")
class JudgingRules(RunRules):
    """Keys of [session]: practice before the first run, breaks, and the longest interruption of a run."""

    practice_trials: Annotated[Whole, Field(ge=0, le=100, description="trials of practice")] = 5
    feedback: Annotated[Flag, Field(description="of discrimination: the right response is told")] = False


@table("protocol")
class JudgingProtocol(StudyProtocol):
    """The protocol file of a study whose table [task] names the task."""

    task: Annotated[TaskKeys, *kept_by(parse_task, "a kind of task, with its keys")]
    session: JudgingRules = JudgingRules()
    timing: Timing = Timing()
    marks: Marks | None = None


def plan_judging(protocol: JudgingProtocol, words: Words, subject: int, visit: int = 1) -> tuple[PlannedRun, ...]:
    """Return the runs of a visit of a subject: practice on the first, then every run of the task in an order of the
    subject's own. `part` names the plan of the task that each run is of.
    """
    plans = protocol.task.plans(words)
    rng = np.random.default_rng([protocol.study.seed, 13, subject, *further(visit)])
    order = [int(index) for index in rng.permutation(len(plans))]
    practice = order[:1] if protocol.session.practice_trials else []
    runs = []
    for position, part in enumerate([*practice, *order]):
        practises, plan = position < len(practice), plans[part]
        title = words("run.title", finger=plan.finger, what=plan.what)
        runs.append(
            PlannedRun(
                position,
                plan.finger,
                plan.frequency_hz,
                practises,
                protocol.task.kind,
                "fixed" if practises else protocol.task.kind,
                protocol.session.feedback,
                words("run.practice", title=title) if practises else title,
                words("run.practice_plain") if practises else "",
                part=part,
            )
        )
    return tuple(runs)
