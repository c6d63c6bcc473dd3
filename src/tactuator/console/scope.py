"""The newest samples of a rig, by their number, and pictures of them: what a page's width can show, as bytes."""

from __future__ import annotations

import struct
import threading
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactuator.console.fields import Count, Finite, Name, PageSetting
from tactuator.errors import BadInput

KEPT_S = 60.0
"""How far back samples are kept."""
SIGNALS = ("reference", "command", "position")
COARSE = 16
"""Rows of which the least and the greatest are kept, so that a long window is not searched row by row."""
HEADER = struct.Struct("<4I4d4I")
"""Number, columns, series, values a column (1 or 2); first row, step, end of the samples, row of the trigger (NaN:
none); frames left out, rows lost, rows in which a limit was reached, 1 where a single shot is done.
"""
_SEARCH_S = 2.0
_HYSTERESIS = 0.02
"""Share of the signal's range by which it has to leave the level before it can pass it again."""

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


@dataclass(frozen=True)
class Trigger:
    """Condition of a trigger: series (column of ScopeSamples), level in its unit, direction."""

    series: int
    level: float
    edge: Literal["rising", "falling"] = "rising"


def newest_crossing(samples: ScopeSamples, trigger: Trigger, start: int, stop: int) -> int | None:
    """Return the number of the newest row, from `start` up to `stop`, at which the signal has passed the level, or
    None.
    """
    start = max(start, samples.oldest)
    values = samples.rows(start, stop)[:, trigger.series].astype(np.float64)
    sign = 1.0 if trigger.edge == "rising" else -1.0
    values, level = sign * values, sign * trigger.level
    if values.size < 2 or not np.any(np.isfinite(values)):
        return None
    low_enough = level - _HYSTERESIS * float(np.nanmax(values) - np.nanmin(values))
    # -1: below, ready; 1: at or above the level; between them the last of the two counts
    sides = np.where(values >= level, 1, np.where(values < low_enough, -1, 0))
    settled = np.flatnonzero(sides)
    passed = settled[1:][np.diff(sides[settled]) == 2]
    return None if passed.size == 0 else start + int(passed[-1])


@dataclass(frozen=True)
class Look(PageSetting):
    """Setting of the page's picture: what its width can show of which stretch, and where that is.

    mode: "roll" follows the newest row, "auto" a trigger where there is one, "normal" a trigger alone, "single" the
    next one; "hold" stays at row `end`. share: of the picture, ahead of the trigger.
    """

    span_s: Annotated[Finite, Field(ge=0.001, le=KEPT_S)]
    columns: Annotated[int, Field(ge=10, le=4000, strict=True)]
    mode: Literal["off", "roll", "auto", "normal", "single", "hold"] = "roll"
    channel: Name = ""
    signal: Literal["reference", "command", "position"] = "position"
    level: Finite = 0.0
    edge: Literal["rising", "falling"] = "rising"
    share: Annotated[Finite, Field(ge=0.0, le=1.0)] = 0.2
    end: Count = 0


class View:
    """A page's picture: its setting, and where a trigger or a hold has put it."""

    def __init__(self, samples: ScopeSamples, rate_hz: float, channels: tuple[str, ...]) -> None:
        self._samples, self._rate, self._channels = samples, rate_hz, channels
        self.look: Look | None = None
        self._crossing: int | None = None
        self._armed_at = 0
        self.done = False

    def set(self, look: Look) -> None:
        """Take another setting; a single shot waits for what comes from now on."""
        self.look = look
        self._crossing, self._armed_at, self.done = None, self._samples.end, False

    def frame(self, number: int, dropped: int) -> bytes | None:
        """Return the next frame, or None where there is nothing to be shown."""
        look, samples = self.look, self._samples
        if look is None or look.mode == "off" or samples.end == 0:
            return None
        span = max(2, round(look.span_s * self._rate))
        stop = self._stop(look, span)
        if stop is None:
            return None
        window = samples.window(max(0, stop - span), stop, look.columns)
        values = (window.low,) if window.step == 1 else (window.low, window.high)
        content = np.stack(values, axis=-1).transpose(1, 0, 2)  # series, columns, least and greatest
        counts = (number, content.shape[1], content.shape[0], content.shape[2])
        crossing = float("nan") if self._crossing is None else float(self._crossing)
        rows = (float(window.first), float(window.step), float(samples.end), crossing)
        counted = (dropped, samples.lost, samples.saturated, int(self.done))
        return HEADER.pack(*counts, *rows, *counted) + np.ascontiguousarray(content, dtype="<f4").tobytes()

    def _stop(self, look: Look, span: int) -> int | None:
        newest = self._samples.end
        if look.mode == "hold":
            self.done = True
            return look.end
        if look.mode == "roll" or look.channel not in self._channels:
            return newest
        if not self.done:
            self._look_for(look, span)
        if self._crossing is None:
            return newest if look.mode == "auto" else None
        return self._crossing + self._after(look, span)

    def _look_for(self, look: Look, span: int) -> None:
        series = SIGNALS.index(look.signal) * len(self._channels) + self._channels.index(look.channel)
        trigger = Trigger(series, look.level, look.edge)
        last = self._samples.end - self._after(look, span)
        start = max(self._armed_at if look.mode == "single" else 0, last - max(span, round(_SEARCH_S * self._rate)))
        crossing = newest_crossing(self._samples, trigger, start, last)
        if crossing is not None or look.mode == "auto":
            self._crossing = crossing
        self.done = look.mode == "single" and crossing is not None

    def _after(self, look: Look, span: int) -> int:
        return round((1.0 - look.share) * span)
