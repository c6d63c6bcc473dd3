"""What every adaptive procedure is: a pure state machine that places the next trial and learns its outcome."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True)
class Placement:
    """Where the next trial is put: level in dB SL of the display, and the frequency where a procedure chooses it."""

    level_db_sl: float
    frequency_hz: float | None = None


@dataclass(frozen=True)
class Estimate:
    """A threshold, dB SL of the display, with its standard error where the procedure has one (else None)."""

    level_db_sl: float
    standard_error_db: float | None


@dataclass(frozen=True)
class Playable:
    """What a display can play to a procedure that chooses frequencies: its band, and the mains lines to keep off.

    mains_hz: 0 where there is none; clearance_hz: the distance to keep from its multiples.
    """

    band_hz: tuple[float, float] = (0.4, 300.0)
    mains_hz: float = 60.0
    clearance_hz: float = 2.5


class Procedure(Protocol):
    """The same outcomes in the same order always give the same placements: replaying a run is enough to resume it."""

    def placement(self) -> Placement | None:
        """The next trial, or None when the run is over. Asking twice gives the same answer."""
        ...

    def record(self, correct: bool) -> None:
        """The outcome of the trial that `placement` told; BadInput once the run is over."""
        ...

    @property
    def trials(self) -> int:
        """Trials recorded so far."""
        ...

    @property
    def progress(self) -> float:
        """How far the run is, 0 to 1; never falls."""
        ...

    def estimate(self) -> Estimate | None:
        """The threshold as the procedure itself states it, or None while (or where) it has none."""
        ...

    @property
    def flags(self) -> tuple[str, ...]:
        """What happened in the run that its reader must know: floor, ceiling, trial-limit."""
        ...
