"""Protocol of an adaptive procedure: a pure state machine that places the next trial and learns its outcome."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from tactuator.errors import BadInput


@dataclass(frozen=True)
class Placement:
    """Placement of a trial: level in dB SL of the display, and the frequency where the procedure chooses it (else
    None).
    """

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


class FixedTrials:
    """The count of a run that is over after a fixed number of trials. Procedures inherit from it."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._trials = 0

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


class Procedure(Protocol):
    """An adaptive procedure as a state machine.

    The same outcomes in the same order always give the same placements, so that replaying a run's outcomes resumes it.
    """

    def placement(self) -> Placement | None:
        """Return where the next trial is put, or None when the run is over. Asking twice gives the same answer."""
        ...

    def record(self, correct: bool) -> None:
        """Learn the outcome of the trial that `placement` returned. Raises BadInput once the run is over."""
        ...

    @property
    def trials(self) -> int:
        """Return the number of trials recorded so far."""
        ...

    @property
    def progress(self) -> float:
        """Return how far the run is, from 0 to 1; it never falls."""
        ...

    def estimate(self) -> Estimate | None:
        """Return the threshold as the procedure itself states it, or None while (or where) it has none."""
        ...

    @property
    def flags(self) -> tuple[str, ...]:
        """Return the names of what a reader must know of the run: floor, ceiling, trial-limit."""
        ...
