"""Time, passed in: what the wall says, and what never jumps."""

from __future__ import annotations

import time
from datetime import UTC, datetime
from typing import Protocol


class Clock(Protocol):
    """utc for records, monotonic_s for durations within one process."""

    def utc(self) -> datetime:
        """Now, with its time zone."""
        ...

    def monotonic_s(self) -> float:
        """Seconds that only go forward."""
        ...


class SystemClock:
    """The machine's own."""

    def utc(self) -> datetime:
        """Now."""
        return datetime.now(UTC)

    def monotonic_s(self) -> float:
        """Seconds since some start."""
        return time.monotonic()


class JumpWatch:
    """Notices when the wall clock moves other than time passes."""

    def __init__(self, clock: Clock, tolerance_s: float = 2.0) -> None:
        self._clock = clock
        self._tolerance_s = tolerance_s
        self._utc, self._monotonic_s = clock.utc(), clock.monotonic_s()

    def jump_s(self) -> float | None:
        """How far the wall clock has jumped since last asked (forward positive), or None."""
        utc, monotonic_s = self._clock.utc(), self._clock.monotonic_s()
        jump = (utc - self._utc).total_seconds() - (monotonic_s - self._monotonic_s)
        self._utc, self._monotonic_s = utc, monotonic_s
        return jump if abs(jump) > self._tolerance_s else None
