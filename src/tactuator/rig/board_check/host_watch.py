"""Watch over the host in a test of a board: whether it had the processor, or other programs of the machine had it."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path

_WAITS = Path("/proc/thread-self/schedstat")
STARVED_SHARE = 0.05
"""A stream that runs dry although its host had 95 % of the time it wanted runs dry by itself."""


def waited_s(counts: Path = _WAITS) -> float:
    """Return the seconds for which this thread has been ready to run and had no processor, as Linux counts them; NaN on
    other systems.
    """
    try:
        return int(counts.read_text(encoding="ascii").split()[1]) / 1e9
    except (OSError, ValueError, IndexError):
        return math.nan


class HostWatch:
    """The host's waiting for a processor over the last `window` rows of a stream.

    clock: seconds; waited: seconds without a processor so far.
    """

    def __init__(
        self, window: int, clock: Callable[[], float] = time.monotonic, waited: Callable[[], float] = waited_s
    ) -> None:
        self._window, self._clock, self._waited = window, clock, waited
        self._marks = deque([(0, clock(), waited())])

    def mark(self, rows: int) -> None:
        """Take down how long the host has waited by the time that `rows` of the stream are played."""
        self._marks.append((rows, self._clock(), self._waited()))
        while len(self._marks) > 1 and self._marks[1][0] <= rows - self._window:
            self._marks.popleft()

    def waited_share(self) -> float:
        """Return the share of the time since the window's beginning for which the host waited, 0 to 1; NaN where the
        system does not tell.
        """
        _, begun_s, had_waited_s = self._marks[0]
        passed_s = self._clock() - begun_s
        return (self._waited() - had_waited_s) / passed_s if passed_s > 0.0 else 0.0

    def is_starved(self) -> bool:
        """Return whether what came too late may be the machine's fault: it waited too long, or nobody knows."""
        return not self.waited_share() < STARVED_SHARE
