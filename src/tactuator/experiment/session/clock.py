"""Clocks that are passed in: wall time, and a time that never jumps."""

from __future__ import annotations

import time
from datetime import UTC, datetime
from typing import Protocol


class Clock(Protocol):
    """A clock: `utc` for records, `monotonic_s` for durations within one process."""

    def utc(self) -> datetime:
        """Return the present time with its time zone."""
        ...

    def monotonic_s(self) -> float:
        """Return seconds that only go forward."""
        ...


class SystemClock:
    """The clock of the machine."""

    def utc(self) -> datetime:
        """Return the present time in UTC."""
        return datetime.now(UTC)

    def monotonic_s(self) -> float:
        """Return the seconds since some start."""
        return time.monotonic()


class JumpWatch:
    """Detector of jumps of the wall clock, relative to the monotonic one."""

    def __init__(self, clock: Clock, tolerance_s: float = 2.0) -> None:
        self._clock = clock
        self._tolerance_s = tolerance_s
        self._utc, self._monotonic_s = clock.utc(), clock.monotonic_s()

    def jump_s(self) -> float | None:
        """Return how far the wall clock has jumped since the last call (forward positive), or None."""
        utc, monotonic_s = self._clock.utc(), self._clock.monotonic_s()
        jump = (utc - self._utc).total_seconds() - (monotonic_s - self._monotonic_s)
        self._utc, self._monotonic_s = utc, monotonic_s
        return jump if abs(jump) > self._tolerance_s else None
