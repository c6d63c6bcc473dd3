"""What a session has to know of the task that its subject does, be it detection or identification."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Protocol

from sqlalchemy import Connection

from tactuator.experiment.language.words import Words
from tactuator.experiment.protocol.plan import PlannedRun
from tactuator.experiment.protocol.study import StudyProtocol
from tactuator.experiment.result.tables import ResultTable
from tactuator.experiment.session.apparatus import Station
from tactuator.experiment.store.records import Played
from tactuator.experiment.store.store import Store
from tactuator.experiment.trial.presenter import Watch
from tactuator.experiment.trial.trial import Trial

Picture = Mapping[str, object]
"""A run as an operator's page draws it, in JSON's types: "kind" (track or confusion), "title", what that kind needs."""


@dataclass(frozen=True)
class Choice:
    """A response as it is offered; keys: characters any of which gives it; codes: keys by where they are on the board

    (KeyboardEvent.code), whatever the layout puts there.
    """

    response: str
    keys: tuple[str, ...]
    codes: tuple[str, ...] = ()


def key_codes(keys: Sequence[str]) -> tuple[str, ...]:
    """Return the physical keys that are meant by digits: on every layout they stand in the row and on the number pad,

    though an unshifted AZERTY key types another character. Letters are where the layout has them.
    """
    return tuple(f"{row}{key}" for key in keys if len(key) == 1 and key in "0123456789" for row in ("Digit", "Numpad"))


SHAPE_STEP_S, NOTHING_DB_SL = 0.02, -60.0


@dataclass(frozen=True)
class Shape:
    """What an interval plays, for a demonstration: the envelope, dB SL, a value each step_s; frequency_hz where it has

    one.
    """

    envelope_db_sl: tuple[float, ...]
    step_s: float
    frequency_hz: float | None = None


@dataclass(frozen=True)
class Question:
    """What the subject sees in every trial: the same in all, so that nothing of it tells the answer.

    intervals: names of those that are shown as they play; none where the subject is not to tell them apart.
    """

    prompt: str
    choices: tuple[Choice, ...]
    intervals: tuple[str, ...] = ()


@dataclass(frozen=True)
class Rules:
    """When there are breaks and how long they last at least; how long feedback stands, and an interruption may last."""

    feedback_s: float
    break_after_trials: int | None = None
    break_between_runs: bool = False
    break_s: float = 0.0
    resume_within_s: float = math.inf


@dataclass(frozen=True)
class Stagehand:
    """Who attends while a trial plays. watch: told of its intervals; halted: asked whether it is to end at once."""

    watch: Watch
    halted: Callable[[], bool] = lambda: False


class Course(Protocol):
    """A run that goes on. The same responses in the same order always lead to the same trial."""

    @property
    def seed(self) -> tuple[int, ...]:
        """Of the run's randomness."""
        ...

    @property
    def trials(self) -> int:
        """Answered so far."""
        ...

    @property
    def progress(self) -> float:
        """How far the run is, 0 to 1."""
        ...

    def trial(self) -> Trial | None:
        """The trial that stands; None when the run is over. Asking twice gives the same."""
        ...

    @property
    def passed(self) -> bool:
        """False for practice that is over and has not met its criterion."""
        ...

    def play(self, trial: Trial, stage: Stagehand, presented: datetime) -> Played:
        """Play the trial. presented: now. Raises Halted where it was stopped while it played."""
        ...

    def shape(self, trial: Trial, interval: int) -> Shape:
        """What the interval plays."""
        ...

    def record(self, response: str) -> None:
        """The response to the trial that stands; BadInput if it is not allowed."""
        ...

    def picture(self) -> Picture:
        """The run so far."""
        ...


class Task(Protocol):
    """A protocol at a station."""

    @property
    def protocol(self) -> StudyProtocol:
        """As it was read."""
        ...

    @property
    def station(self) -> Station:
        """Where it is done."""
        ...

    @property
    def words(self) -> Words:
        """In the study's language."""
        ...

    @property
    def question(self) -> Question:
        """What subjects see."""
        ...

    @property
    def rules(self) -> Rules:
        """How a session goes."""
        ...

    def enrol(self, connection: Connection, study: int) -> None:
        """Keep what a new study has besides its sessions; BadInput where a study that is there has something else."""
        ...

    def runs(self, subject: int, visit: int) -> tuple[PlannedRun, ...]:
        """Every run of a visit (from 1) of a subject (from 0): the same after any interruption."""
        ...

    def course(self, planned: PlannedRun, subject: int, visit: int, attempt: int) -> Course:
        """A planned run from its beginning."""
        ...

    def expected(self, planned: PlannedRun) -> tuple[float, float]:
        """How many trials a run has, about, and how many seconds one of them plays."""
        ...

    def results(self, store: Store, session: int) -> tuple[ResultTable, ...]:
        """What the session's answers say so far; BadInput while they say nothing."""
        ...
