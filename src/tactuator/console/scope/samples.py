"""The newest samples of a rig, by their number, and windows of them for a page of any width."""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.errors import BadInput

SIGNALS = ("reference", "command", "position")
COARSE = 16
"""Rows of which the least and the greatest are kept, so that a long window is not searched row by row."""

Rows = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Window:
    """Columns of a picture: each holds the least and the greatest of `step` rows, from row `first` on.

    low, high: (columns, series), series as in ScopeSamples.
    """

    first: int
    step: int
    low: Rows
    high: Rows


class ScopeSamples:
    """Holds the newest `capacity` rows or more; a row has, for each of SIGNALS, one value a channel (signal by signal).

    One thread adds, others read. lost: rows that were missing in what was added, by their numbers.
    """

    def __init__(self, channels: int, capacity: int) -> None:
        self.series = len(SIGNALS) * channels
        self.channels = channels
        self._size = COARSE * (-(-capacity // COARSE) + 2)
        self._rows = np.full((self._size, self.series), np.nan, dtype=np.float32)
        self._low, self._high = (np.full((self._size // COARSE, self.series), np.nan, np.float32) for _ in range(2))
        self._lock = threading.Lock()
        self.end = self.lost = self.saturated = 0

    @property
    def oldest(self) -> int:
        """Return the number of the oldest row that is held; always a multiple of COARSE."""
        return max(0, -(-(self.end - self._size + COARSE) // COARSE) * COARSE)

    def add(self, first: int, rows: Rows, saturated: int = 0) -> None:
        """Append rows (n, series), of which the first bears that number; a number beyond the next one counts as loss.

        Raises BadInput for a number that was there already, and for another shape.
        """
        if rows.ndim != 2 or rows.shape[1] != self.series or first < self.end:
            raise BadInput(f"rows of shape {rows.shape} from {first} on", f"(n, {self.series}), from {self.end} on")
        with self._lock:
            missing = first - self.end
            self.lost += missing
            self.saturated += saturated
            if missing:
                self._put(np.full((min(missing, self._size), self.series), np.nan, np.float32), first)
            self._put(rows, first + len(rows))

    def _put(self, rows: Rows, end: int) -> None:
        """Write rows that end before row `end`, and the least and greatest of the stretches that they touch."""
        rows = rows[-self._size :]
        start = end - len(rows)
        self._rows[np.arange(start, end) % self._size] = rows
        self.end = end
        touched = np.arange(start // COARSE, -(-end // COARSE)) % (self._size // COARSE)
        stretches = self._rows.reshape(-1, COARSE, self.series)[touched]
        self._low[touched], self._high[touched] = stretches.min(axis=1), stretches.max(axis=1)

    def rows(self, start: int, stop: int) -> Rows:
        """Return a copy of the rows from `start` up to `stop`, as far as they are held."""
        with self._lock:
            start, stop = max(start, self.oldest), min(stop, self.end)
            return self._rows[np.arange(start, max(start, stop)) % self._size]

    def window(self, start: int, stop: int, columns: int) -> Window:
        """Return the rows from about `start` up to about `stop` in at most `columns` columns.

        Columns begin at multiples of their step, so that the same row always falls into a column with the same
        neighbours, and a picture that rolls does not flicker. Only whole columns are given.
        """
        step = max(1, -(-(stop - start) // columns))
        if step >= 2 * COARSE:
            step = -(-step // COARSE) * COARSE
            return self._decimated(start, stop, step, COARSE)
        return self._decimated(start, stop, step, 1)

    def _decimated(self, start: int, stop: int, step: int, unit: int) -> Window:
        with self._lock:
            first = -(-max(start, self.oldest) // step) * step
            count = max(0, (min(stop, self.end) - first) // step)
            places = np.arange(first // unit, (first + count * step) // unit)
            if unit == 1:
                low = high = self._rows[places % self._size]
            else:
                low, high = (kept[places % (self._size // unit)] for kept in (self._low, self._high))
        if step == 1:
            return Window(first, step, low, high)
        grouped = (count, step // unit, self.series)
        return Window(first, step, low.reshape(grouped).min(axis=1), high.reshape(grouped).max(axis=1))
