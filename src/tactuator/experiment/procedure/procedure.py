"""Adaptive procedures: pure state machines that place the next trial and learn its outcome, and practice as one.

The kinds that a protocol file may name are entry points of the group GROUP; the project's own are found there too.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from itertools import product
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.entry_points import plugin, plugins
from tactuator.errors import BadInput
from tactuator.parameters import from_table, table
from tactuator.perception.psychometric import TARGET_3_DOWN_1_UP, weibull_rise

GROUP = "tactuator.procedures"
_TYPICAL_TRIALS = 80.0
"""Trials of a run of unknown length."""


@dataclass(frozen=True)
class Placement:
    """Where a trial is put: level, dB SL of the display, and the frequency where the procedure chooses it."""

    level_db_sl: float
    frequency_hz: float | None = None


@dataclass(frozen=True)
class Estimate:
    """A threshold, dB SL of the display, with its standard error where the procedure has one (else None)."""

    level_db_sl: float
    standard_error_db: float | None


@dataclass(frozen=True)
class Playable:
    """Range of stimuli that a display offers a procedure that chooses frequencies.

    band_hz: lowest and highest frequency. mains_hz: frequency whose multiples are avoided, 0 for none. clearance_hz:
    distance to keep from those multiples.
    """

    band_hz: tuple[float, float] = (0.4, 300.0)
    mains_hz: float = 60.0
    clearance_hz: float = 2.5


class Procedure(Protocol):
    """An adaptive procedure as a state machine.

    The same outcomes in the same order always give the same placements, so that replaying a run's outcomes resumes it.
    """

    def placement(self) -> Placement | None:
        """Return where the next trial is put, or None when the run is over. Asking twice gives the same answer."""

    def record(self, correct: bool) -> None:
        """Learn the outcome of the trial that `placement` returned. Raises BadInput once the run is over."""

    @property
    def trials(self) -> int:
        """Return the number of trials recorded so far."""

    @property
    def progress(self) -> float:
        """Return how far the run is, from 0 to 1; it never falls."""

    def estimate(self) -> Estimate | None:
        """Return the threshold as the procedure itself states it, or None while (or where) it has none."""
        return None

    @property
    def flags(self) -> tuple[str, ...]:
        """Return the names of what a reader must know of the run: floor, ceiling, trial-limit."""
        return ()

    @property
    def point(self) -> float:
        """Return the share correct, lapses included, at the level that its estimate stands for."""


class FixedTrials(Procedure):
    """The count of a run that is over after a fixed number of trials. Procedures inherit from it."""

    point = TARGET_3_DOWN_1_UP
    _trials = 0

    def __init__(self, limit: int) -> None:
        self._limit = limit

    @property
    def trials(self) -> int:
        """Return the number of trials recorded so far."""
        return self._trials

    @property
    def progress(self) -> float:
        """Return the share of the trials done."""
        return self._trials / self._limit

    @property
    def is_over(self) -> bool:
        """Tell whether every trial has been recorded."""
        return self._trials >= self._limit

    def _count(self) -> None:
        if self.is_over:
            raise BadInput(f"the run was over after {self._trials} trials", "no further response")
        self._trials += 1


@table("[procedure]")
class ProcedureKeys:
    """Keys of the table [procedure] for one kind of procedure, which build its runs.

    A kind is an entry point of GROUP: its name is `kind` in the file, and it refers to a table that inherits from this
    one, with the kind's own keys, and `build`.
    """

    chooses_frequency: ClassVar[bool] = False
    """Whether a run chooses the frequency of every trial, as a whole curve's does, so that the file lists none."""

    _: KW_ONLY
    kind: str = ""

    @property
    def typical_trials(self) -> float:
        """Return about how many trials a run has: its key `trials`, where it has one."""
        return float(getattr(self, "trials", _TYPICAL_TRIALS))

    def build(self, guess: float, playable: Playable) -> Procedure:
        """Return a fresh run over what can be played. guess: probability of a right answer without feeling."""
        raise NotImplementedError


def procedure_kind(name: str) -> type[ProcedureKeys]:
    """Return the keys of a kind of procedure, of this package or another. Raises BadInput for a name nobody declares,
    and for one whose entry point refers to anything else."""
    kind = plugin(GROUP, name)
    if not (isinstance(kind, type) and issubclass(kind, ProcedureKeys)):
        raise BadInput(f"{name!r} refers to {kind!r}", "a table that inherits from ProcedureKeys", where=(GROUP,))
    return kind


def parse_procedure(document: Any) -> ProcedureKeys:
    """Return the keys of a table [procedure]. Raises BadInput for an unknown kind, and for keys that it refuses."""
    if isinstance(document, ProcedureKeys):
        return document
    kind = document.get("kind") if isinstance(document, Mapping) else None
    if not isinstance(kind, str) or kind not in plugins(GROUP):
        raise BadInput(repr(kind), ", ".join(plugins(GROUP)), key="kind")
    return from_table(procedure_kind(kind), document)


class Practice(FixedTrials):
    """Practice of at most `limit` trials at level_db_sl, without an estimate.

    correct: number of right answers among the last `window` trials that passes practice and ends it; None: it is passed
    by doing all of its trials.
    """

    def __init__(
        self,
        level_db_sl: float,
        limit: int,
        frequency_hz: float | None = None,
        window: int = 1,
        correct: int | None = None,
    ) -> None:
        super().__init__(limit)
        self._placement, self._correct = Placement(level_db_sl, frequency_hz), correct
        self._last: deque[bool] = deque(maxlen=window)

    @property
    def passed(self) -> bool:
        """Return whether the criterion is met, or, without a criterion, whether all trials are done."""
        return self._trials >= self._limit if self._correct is None else sum(self._last) >= self._correct

    @property
    def is_over(self) -> bool:
        """Tell whether practice is passed or its trials are used up."""
        return self._trials >= self._limit or self.passed

    @property
    def progress(self) -> float:
        """Return the share of the trials done; with a criterion, the share of the fewest trials that can meet it."""
        if self._correct is None:
            return super().progress
        return 1.0 if self.passed else min(self._trials, self._correct) / (self._correct + 1)

    def placement(self) -> Placement | None:
        """Return the practice level, or None once practice is over."""
        return None if self.is_over else self._placement

    def record(self, correct: bool) -> None:
        """Count the outcome. Raises BadInput once practice is over."""
        self._count()
        self._last.append(correct)


_PROBABILITY_MARGIN = 1e-6


def psi_at(level_db: FloatArray, slope: FloatArray, lapse: FloatArray, guess: float, target: float) -> FloatArray:
    """Return psi of Weibull in amplitude at levels re threshold, kept off 0 and 1; arrays broadcast."""
    rise = weibull_rise(level_db, slope, (target - guess) / (1.0 - guess - lapse))
    psi = guess + (1.0 - guess - lapse) * rise
    return np.asarray(np.clip(psi, _PROBABILITY_MARGIN, 1.0 - _PROBABILITY_MARGIN))


@dataclass(frozen=True)
class Answering:
    """Psychometric functions of a detection task that a procedure thinks possible, with their prior probabilities.

    slopes: of the Weibull in amplitude, equally probable. lapses, lapse_shares: lapse rates and their probabilities.
    guess: probability of a right guess. target: share correct at threshold, lapses included. Raises BadInput unless 0
    <= guess < target < 1 - lapse for every lapse.
    """

    slopes: tuple[float, ...] = (0.8, 1.4, 2.1, 3.2)
    lapses: tuple[float, ...] = (0.02, 0.1, 0.2)
    lapse_shares: tuple[float, ...] = (0.55, 0.3, 0.15)
    guess: float = 1.0 / 3.0
    target: float = TARGET_3_DOWN_1_UP

    def __post_init__(self) -> None:
        if not self.slopes or min(self.slopes) <= 0.0 or len(self.lapses) != len(self.lapse_shares):
            raise BadInput("answering: slopes, lapses or shares", "positive slopes, a share for every lapse")
        if not 0.0 <= self.guess < self.target < 1.0 - max(self.lapses):
            raise BadInput(
                f"answering: guess {self.guess:g}, target {self.target:g}, lapses up to {max(self.lapses):g}",
                "0 <= guess < target < 1 - lapse",
            )

    @property
    def pairs(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return slope and lapse rate of every psychometric function, in the order of slopes, then lapses."""
        slopes, lapses = zip(*product(self.slopes, self.lapses), strict=True)
        return slopes, lapses

    def psi(self, level_db: FloatArray, slope: FloatArray, lapse: FloatArray) -> FloatArray:
        """Return the probability of a correct response at level_db relative to threshold; arguments broadcast."""
        return psi_at(level_db, slope, lapse, self.guess, self.target)

    def log_chance(self, correct: NDArray[np.bool_]) -> FloatArray:
        """Return the log probability of each answer if it was guessed."""
        return np.asarray(np.where(correct, np.log(self.guess), np.log1p(-self.guess)))
