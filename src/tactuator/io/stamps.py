"""Time stamps: the rate they show, and what to do about dropped samples and uneven steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import interpolate

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput

_MOST_DROPPED = 0.02
_RATE_TOLERANCE = 0.01


@dataclass(frozen=True, eq=False)
class Stamps:
    """Time stamps on an even grid. rate_hz: even rate. place: where each sample stands on the even grid, in samples,
    (n,). count: of that grid.

    even: the samples are the grid already. remarks: what is wrong, to be said.
    """

    rate_hz: float
    place: FloatArray
    count: int
    even: bool
    remarks: tuple[str, ...]

    def spread(self, values: FloatArray, hold: bool) -> FloatArray:
        """Return the values (n,) on the even grid (count,): held (a command) or interpolated (a position)."""
        if self.even:
            return values
        grid = np.arange(self.count, dtype=np.float64)
        if hold:
            index = np.clip(np.searchsorted(self.place, grid + 0.5, side="right") - 1, 0, values.size - 1)
            return values[index]
        return np.asarray(interpolate.make_interp_spline(self.place, values, k=min(3, values.size - 1))(grid))


def read_stamps(time_s: FloatArray, rate_hz: float | None) -> Stamps:
    """Judge stamps (n,), seconds. BadInput where they do not ascend, contradict rate_hz, or too much is missing."""
    if time_s.size < 3:
        raise BadInput(f"{time_s.size} time stamps", "3 or more")
    bad = np.flatnonzero(~np.isfinite(time_s))
    if bad.size:
        raise BadInput(f"the time stamp in row {bad[0] + 1} is not a number", "seconds")
    step = np.diff(time_s)
    back = np.flatnonzero(step <= 0.0)
    if back.size > max(0.3 * step.size, 0) or np.median(step) <= 0.0:
        raise BadInput("the time stamps do not ascend", "stamps that do (printed with enough digits)")
    typical = _typical_step(step)
    if back.size and np.min(step) < -0.5 * typical:
        raise BadInput(f"time goes back in row {int(np.argmin(step)) + 2}", "stamps that ascend")
    jumps = np.maximum(np.round(step / typical), 1.0)
    missing = int(np.sum(jumps - 1.0)) if np.any(step > 1.6 * typical) else 0
    if missing == 0:
        jumps[:] = 1.0
    place_by_count = np.concatenate([[0.0], np.cumsum(jumps)])
    rate = place_by_count[-1] / (time_s[-1] - time_s[0])
    if rate_hz is not None and abs(rate_hz / rate - 1.0) > _RATE_TOLERANCE:
        raise BadInput(f"the rate given is {rate_hz:g} Hz, the time stamps say {rate:.6g} Hz", "one that agrees")
    if missing > _MOST_DROPPED * time_s.size:
        raise BadInput(f"{missing} of {time_s.size + missing} samples are missing", "2 % at most")
    return _judge(time_s, rate, place_by_count, missing)


def _typical_step(step: FloatArray) -> float:
    """Return the median step, sharpened by the mean of all that are near it (stamps rounded to few digits
    alternate).
    """
    median = float(np.median(step))
    near = np.abs(step - median) <= 0.6 * median
    return float(np.mean(step[near]))


def _quantum(time_s: FloatArray) -> float:
    """Return the last decimal place that the stamps were printed with, seconds; 0 where they have all their digits."""
    some = time_s[:1000]
    for digits in range(10):
        scaled = some * 10.0**digits
        if np.max(np.abs(scaled - np.round(scaled))) < 1e-5:
            return float(10.0**-digits)
    return 0.0


def _judge(time_s: FloatArray, rate: float, by_count: FloatArray, missing: int) -> Stamps:
    place = (time_s - time_s[0]) * rate
    offset = float(np.mean(place - by_count))
    astray = place - by_count - offset
    worst, usual = float(np.max(np.abs(astray))), float(np.sqrt(np.mean(astray**2)))
    count = int(by_count[-1]) + 1
    remarks = []
    if missing:
        remarks.append(f"{missing} samples are missing: filled in between their neighbours")
    if usual <= 0.02 + 0.6 * _quantum(time_s) * rate and worst <= 1.0:
        # no more than what was lost in printing them
        return Stamps(rate, by_count, count, missing == 0, tuple(remarks))
    if usual > 0.35 * np.sqrt(max(count, 1)) or np.any(np.diff(place) <= 0.0):
        raise BadInput(f"the time stamps are uneven (off by {worst:.3g} steps)", "an even rate")
    remarks.append(f"the time stamps are uneven (off by up to {worst:.2g} steps): resampled at an even {rate:.6g} Hz")
    return Stamps(rate, np.clip(place, 0.0, count - 1.0) + 1e-9 * np.arange(place.size), count, False, tuple(remarks))
