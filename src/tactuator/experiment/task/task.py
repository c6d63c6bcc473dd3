"""Tasks: what is played in a trial, what a subject is asked of it, and what the answers come to.

A task is one file: a table that inherits from `Task`, whose fields are the keys of [task] in a protocol. Its name
is an entry point of the group GROUP; the project's own are found there too. Everything else (session, store, pages,
simulated people, export) is the same for all of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Any

from tactuator.entry_points import plugin, plugins
from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Playable, Runs
from tactuator.experiment.trial import Timing, Tone, Trial, number_of
from tactuator.experiment.words import Words
from tactuator.parameters import from_table, table
from tactuator.perception.curve import COMFORT_DB_SL
from tactuator.result import Chart, ResultTable

GROUP = "tactuator.tasks"


@dataclass(frozen=True)
class Planned:
    """A run of a task. frequency_hz: None for several. what: in the run's title. trials: about how many."""

    finger: str
    frequency_hz: float | None
    what: str
    trials: float


@dataclass(frozen=True)
class Place:
    """What a run is played on: the range of its stimuli, the times of a trial, and the display's highest level on a
    finger at a frequency.
    """

    playable: Playable
    timing: Timing
    highest_db_sl: Callable[[str, float], float] = lambda finger, hertz: COMFORT_DB_SL


Picture = Mapping[str, object]
"""A run as an operator's page draws it, in JSON's types: "kind" (track, curve, confusion) and what that kind needs."""


@dataclass
class TaskState:
    """State of a run: the same responses in the same order always lead to the same trial.

    A kind of run has `draw` and `share_done`, and `learn` where its trials follow from the answers. seed: of all that
    is drawn. answered: trials, their responses, and whether these were right. limit: trials after which practice ends.
    """

    seed: tuple[int, ...]
    answered: list[tuple[Trial, str, bool]] = field(init=False, default_factory=list)
    limit: float = field(init=False, default=math.inf)
    _next: tuple[int, Trial | None] = field(init=False, default=(-1, None))

    @property
    def trials(self) -> int:
        """Number of trials answered so far, catch trials included."""
        return len(self.answered)

    @property
    def share_done(self) -> float:
        """How far the run is, from 0 to 1."""
        raise NotImplementedError

    @property
    def progress(self) -> float:
        """How far the run is, from 0 to 1, or practice to its limit."""
        return self.share_done if math.isinf(self.limit) else min(1.0, self.trials / self.limit)

    @property
    def passed(self) -> bool:
        """False for practice that is over and has not met its criterion, True otherwise."""
        return True

    def draw(self, number: int) -> Trial | None:
        """Return the trial of that number, after those before it were learnt, or None when the run is over."""
        raise NotImplementedError

    def learn(self, trial: Trial, response: str, correct: bool) -> None:
        """Learn nothing, as a run does whose trials are planned."""

    def trial(self) -> Trial | None:
        """Return the next trial, or None when the run is over. It is drawn once for each answer."""
        if self._next[0] != self.trials:
            self._next = (self.trials, None if self.trials >= self.limit else self.draw(self.trials))
        return self._next[1]

    def record(self, response: str) -> None:
        """Record the response to the next trial. Raises BadInput when the run is over, or for no response."""
        trial = self.trial()
        if trial is None:
            raise BadInput("the run is over", "a response to a trial")
        correct = trial.judge(response)
        self.answered.append((trial, response, correct))
        self.learn(trial, response, correct)

    def picture(self) -> Picture:
        """Return the run so far as an operator's page draws it: the level and outcome of every trial."""
        levels = [0.0 if trial.placement is None else trial.placement.level_db_sl for trial, _, _ in self.answered]
        return {"kind": "track", "levels_db_sl": levels, "correct": [right for _, _, right in self.answered]}


@dataclass
class ProcedureState(TaskState):
    """State of a run whose trials a procedure places; a kind of run has `draw`."""

    procedure: Runs

    @property
    def share_done(self) -> float:
        """The progress of the procedure."""
        return self.procedure.progress()

    @property
    def passed(self) -> bool:
        """False for practice that has not met its criterion, True otherwise."""
        return self.procedure.passed

    def learn(self, trial: Trial, response: str, correct: bool) -> None:
        """Move the procedure on."""
        self.procedure.record(correct)

    def picture(self) -> Picture:
        """Return the level and outcome of every trial, or what else the procedure draws."""
        return {**super().picture(), **self.procedure.picture()}


@dataclass(frozen=True)
class Answered:
    """A trial and its answer as the store has it. tones: of each interval as commanded, None where it had not just one.

    level_db_sl: of its placement, None without one. correct: the answer was the one that counts as yes.
    curve_point: the placement's frequency and the level of the display's threshold curve there, dB re 1 um; None where
    nobody knows it.
    """

    tones: tuple[Tone | None, ...]
    level_db_sl: float | None
    response: str
    correct: bool
    curve_point: tuple[float, float] | None = None

    @classmethod
    def of(cls, trial: Trial, response: str) -> Answered:
        """Return the answer to a trial as it would come from the store."""
        tones = tuple(interval[0] if len(interval) == 1 else None for interval in trial.tones)
        level = None if trial.placement is None else trial.placement.level_db_sl
        return cls(tones, level, response, trial.judge(response))

    @property
    def number(self) -> float:
        """Return the number that was answered. Raises BadInput for an answer that is none above zero."""
        return number_of(self.response)


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

    intervals: names of those that are shown as they play.
    """

    prompt: str
    responses: tuple[tuple[str, tuple[str, ...]], ...] = ()
    intervals: tuple[str, ...] = ()


@table("[task]")
class Task:
    """Keys of the table [task] for one kind of task, which a kind inherits from and extends."""

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

    def placed(self, place: Place) -> Iterator[Tone]:
        """Yield every tone that the keys place, once for each time they do."""
        yield from ()

    def warnings(self) -> Iterator[str]:
        """Yield what the results will lack."""
        yield from ()

    def faults(self, place: Place) -> Iterator[BadInput]:
        """Yield every reason why no run can reach a result there, whatever the answers."""
        yield from ()

    def begin(self, index: int, place: Place, seed: tuple[int, ...]) -> TaskState:
        """Return a fresh run of the plan of that index. seed: of all that is drawn."""
        raise NotImplementedError

    def response_to(self, trial: Trial, felt_db_sl: Sequence[float]) -> str:
        """Return what a simulated person answers to whom the tones of the intervals feel that strong.

        Raises BadInput where strength is not what the task asks for.
        """
        raise BadInput(f"task {self.kind}: strength is not what it asks for", "a task of strength")

    def results(self, runs: Sequence[AnsweredRun], words: Words) -> tuple[ResultTable, ...]:
        """Return what the answers come to."""
        raise NotImplementedError

    def chart(self, runs: Sequence[AnsweredRun], words: Words) -> Chart | None:
        """Return the figure of the answers, None where a task has none."""
        return None


def parse_task(document: Any) -> Task:
    """Return the task of a table [task]. Raises BadInput for an unknown kind, and for keys that it refuses."""
    if isinstance(document, Task):
        return document
    name = document.get("kind") if isinstance(document, Mapping) else None
    if not isinstance(name, str) or name not in plugins(GROUP):
        raise BadInput(repr(name), ", ".join(plugins(GROUP)), key="kind")
    kind = plugin(GROUP, name)
    if not (isinstance(kind, type) and issubclass(kind, Task)):
        raise BadInput(f"{name!r} refers to {kind!r}", "a table that inherits from Task", where=(GROUP,))
    return from_table(kind, document)
