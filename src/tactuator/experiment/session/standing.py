"""State of a session: the trial that comes next, an answer that is saved, the progress of each run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tactuator.errors import BadInput
from tactuator.experiment.protocol.plan import PlannedRun
from tactuator.experiment.session.task import Course
from tactuator.experiment.store.cells import Found
from tactuator.experiment.trial.trial import Trial

_LEVEL_TOLERANCE_DB = 1e-6


@dataclass(frozen=True)
class NextTrial:
    """The trial to present next; run: its row in the store; seed: of the run."""

    run: int
    planned: PlannedRun
    trial: Trial
    seed: tuple[int, ...]


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


@dataclass(frozen=True)
class RunTally:
    """Progress of a planned run; state: as in the store, or `planned`."""

    planned: PlannedRun
    state: str
    answered: int
    correct: int


@dataclass
class Running:
    """The run that goes on, with its course."""

    row: int
    planned: PlannedRun
    attempt: int
    course: Course
    last_heard_s: float


def replay(course: Course, run: int, answers: Sequence[Found]) -> None:
    """Take a course through a run's answers. Raises BadInput where the store's trials are not those of the course."""
    for row in answers:
        trial = course.trial()
        if trial is None or not _is_stored(trial, row):
            raise BadInput(f"run {run}, trial {row.number}: the store does not replay", "its own protocol")
        course.record(row.response)


def _is_stored(trial: Trial, row: Found) -> bool:
    """Return whether a trial is the one in the store's row."""
    level = None if trial.placement is None else trial.placement.level_db_sl
    if level is None or row.level_db_sl is None:
        same = level is row.level_db_sl
    else:
        same = abs(level - row.level_db_sl) <= _LEVEL_TOLERANCE_DB
    return same and trial.correct == row.correct_response
