"""Tasks: what is played in a trial, what a subject is asked of it, and what the answers come to.

A task is one file: a table that inherits from `TaskKeys`, whose fields are the keys of [task] in a protocol. Its name
is an entry point of the group GROUP; the project's own are found there too. Everything else (session, store, pages,
simulated people, export) is the same for all of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any, Protocol

from tactuator.entry_points import plugin, plugins
from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Placement, Playable
from tactuator.experiment.trial import Timing, Trial
from tactuator.experiment.words import Words
from tactuator.parameters import from_table, table
from tactuator.perception.curve import COMFORT_DB_SL
from tactuator.table import Chart, ResultTable

GROUP = "tactuator.tasks"


@dataclass(frozen=True)
class JudgedTone:
    """A tone of an interval. role: what it is for (standard, comparison ...), without a colon.

    onset_s: from the interval's beginning. duration_s: None as the protocol's [timing] has it. measured_db_sl: at the
    sensor, None where nobody knows it. Raises BadInput for a level above comfort.
    """

    role: str
    finger: str
    frequency_hz: float
    level_db_sl: float
    onset_s: float = 0.0
    duration_s: float | None = None
    measured_db_sl: float | None = None

    def __post_init__(self) -> None:
        if self.level_db_sl > COMFORT_DB_SL + 1e-9:
            raise BadInput(f"tone of {self.level_db_sl:g} dB SL", f"{COMFORT_DB_SL:g} at most")

    @property
    def label(self) -> str:
        """Return role, finger and frequency as the store has them of an interval with this one tone."""
        return f"{self.role}:{self.finger}:{self.frequency_hz:.10g}"

    def lasts_s(self, timing: Timing) -> float:
        """Return its duration."""
        return timing.duration_s(self.frequency_hz) if self.duration_s is None else self.duration_s

    def ramp_s(self, timing: Timing) -> float:
        """Return the duration of its ramps, in proportion to the tone where that is shorter than an interval."""
        usual_s = timing.duration_s(self.frequency_hz)
        return timing.ramp_at_s(self.frequency_hz) * min(1.0, self.lasts_s(timing) / usual_s)


@dataclass(frozen=True)
class Judgement(Trial):
    """A trial that is judged. tones: of every interval.

    Without responses the answer is any positive number. correct: "" for that; where no answer is right, the one that
    counts as yes. Raises BadInput as `Trial` does.
    """

    tones: tuple[tuple[JudgedTone, ...], ...] = ()

    @classmethod
    def of(
        cls,
        number: int,
        tones: Sequence[Sequence[JudgedTone]],
        responses: tuple[str, ...],
        correct: str,
        placement: Placement | None = None,
    ) -> Judgement:
        """Return a trial with those tones in each interval, labelled as the store has them."""
        labels = tuple("+".join(tone.label for tone in interval) for interval in tones)
        return cls(number, labels, responses, correct, placement, tuple(tuple(interval) for interval in tones))

    def __post_init__(self) -> None:
        if self.responses or self.correct:
            super().__post_init__()

    def judge(self, response: str) -> bool:
        """Return whether the response is the one that `correct` names. Raises BadInput if it is not allowed."""
        if self.responses:
            return super().judge(response)
        estimate(response)
        return False


def estimate(response: str) -> float:
    """Return the number that was answered. Raises BadInput for what is not one above zero."""
    try:
        number = float(response.replace(",", "."))
    except ValueError:
        number = math.nan
    if not (number > 0.0 and math.isfinite(number)):
        raise BadInput(f"response {response!r}", "a number above 0")
    return number


@dataclass(frozen=True)
class Planned:
    """A run of a task. frequency_hz: None for several. what: in the run's title. trials: about how many."""

    finger: str
    frequency_hz: float | None
    what: str
    trials: float


@dataclass(frozen=True)
class Place:
    """What a run is played on: the range of its stimuli, and the times of a trial."""

    playable: Playable
    timing: Timing


class TaskRun(Protocol):
    """A run of a task as a state machine: the same responses in the same order always lead to the same trial."""

    @property
    def progress(self) -> float:
        """Return how far the run is, from 0 to 1."""

    def trial(self, number: int) -> Judgement | None:
        """Return the trial that stands, the number-th of the run, or None when the run is over."""

    def record(self, trial: Judgement, response: str) -> None:
        """Learn the response to the trial that stands."""


@dataclass(frozen=True)
class Answered:
    """A trial and its answer as the store has it. tones: of each interval as commanded, None where it had not just one.

    level_db_sl: of its placement, None without one. correct: the answer was the one that counts as yes.
    curve_point: the placement's frequency and the level of the display's threshold curve there, dB re 1 um; None where
    nobody knows it.
    """

    tones: tuple[JudgedTone | None, ...]
    level_db_sl: float | None
    response: str
    correct: bool
    curve_point: tuple[float, float] | None = None

    @classmethod
    def of(cls, trial: Judgement, response: str) -> Answered:
        """Return the answer to a trial as it would come from the store."""
        tones = tuple(interval[0] if len(interval) == 1 else None for interval in trial.tones)
        level = None if trial.placement is None else trial.placement.level_db_sl
        return cls(tones, level, response, trial.judge(response))

    @property
    def number(self) -> float:
        """Return the number that was answered. Raises BadInput for an answer that is none above zero."""
        return estimate(self.response)


@dataclass(frozen=True)
class AnsweredRun:
    """A run with its answers. simulated: nobody felt it."""

    subject: str
    finger: str
    frequency_hz: float | None
    trials: tuple[Answered, ...]
    simulated: bool = False


@dataclass(frozen=True)
class TaskPrompt:
    """What a subject is asked. responses: each with its keys; none: a number is asked for.

    intervals: names of those that are told apart as they play.
    """

    prompt: str
    responses: tuple[tuple[str, tuple[str, ...]], ...] = ()
    intervals: tuple[str, ...] = ()


@table("[task]")
class TaskKeys:
    """Keys of the table [task] for one kind of task, which a kind inherits from, with keys of its own."""

    _: KW_ONLY
    kind: str = ""

    def asked(self, words: Words) -> TaskPrompt:
        """Return what is asked in every trial."""
        raise NotImplementedError

    def fingers_used(self) -> tuple[str, ...]:
        """Return the fingers that are stimulated."""
        raise NotImplementedError

    def plans(self, words: Words) -> tuple[Planned, ...]:
        """Return the runs of a session, whose order is the subject's own."""
        raise NotImplementedError

    def begin(self, index: int, place: Place, seed: tuple[int, ...]) -> TaskRun:
        """Return a fresh run of the plan of that index. seed: of all that is drawn."""
        raise NotImplementedError

    def results(self, runs: Sequence[AnsweredRun], words: Words) -> tuple[ResultTable, ...]:
        """Return what the answers come to."""
        raise NotImplementedError

    def chart(self, runs: Sequence[AnsweredRun], words: Words) -> Chart | None:
        """Return the figure of the answers, None where a task has none."""
        return None


def parse_task(document: Any) -> TaskKeys:
    """Return the keys of a table [task]. Raises BadInput for an unknown kind, and for keys that it refuses."""
    if isinstance(document, TaskKeys):
        return document
    name = document.get("kind") if isinstance(document, Mapping) else None
    if not isinstance(name, str) or name not in plugins(GROUP):
        raise BadInput(repr(name), ", ".join(plugins(GROUP)), key="kind")
    kind = plugin(GROUP, name)
    if not (isinstance(kind, type) and issubclass(kind, TaskKeys)):
        raise BadInput(f"{name!r} refers to {kind!r}", "a table that inherits from TaskKeys", where=(GROUP,))
    return from_table(kind, document)
