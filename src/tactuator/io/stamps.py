"""Time stamps of a record: counters that wrap, dates, several runs, an even rate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, agreed

_MOST_DROPPED = 0.02
_RATE_TOLERANCE = 0.01
_FEWEST = 50
_FELT_HZ = 600.0
"""Twice the highest frequency that is felt: a rate below it is unusual."""
_REPEATED = 0.3
"""Share of steps that are none, from which on stamps are too coarse to say which rows are missing."""
_EPOCH_S = (9.4e8, 4.1e9)
"""Seconds since 1970 of the years 2000 to 2100."""
_LONGEST_STEP_S = 10.0
_MANY_WRAPS, _MOST_RUNS, _LEAP = 3, 100, 50.0
"""Wraps that no runs of equal length are taken for, runs of one file, and steps from which on a pause is no sample."""


@dataclass(frozen=True, eq=False)
class Stamps:
    """Time stamps on an even grid. rate_hz: even rate. place: where each sample is on the even grid, in samples,
    (n,). count: of that grid.

    even: the samples are the grid already. remarks: what is wrong, to be said.
    """

    rate_hz: float
    place: FloatArray
    count: int
    even: bool
    remarks: tuple[str, ...]

    def spread(self, values: FloatArray, hold: bool) -> FloatArray:
        """Return the values (n,) on the even grid (count,): held (a command) or interpolated (a position). Those that
        were not read (NaN) count as missing.
        """
        was_read = np.isfinite(values)
        if self.even and was_read.all():
            return values
        grid, place, values = np.arange(self.count, dtype=np.float64), self.place[was_read], values[was_read]
        if hold:
            index = np.clip(np.searchsorted(place, grid + 0.5, side="right") - 1, 0, values.size - 1)
            return values[index]
        return np.asarray(scipy.interpolate.make_interp_spline(place, values, k=min(3, values.size - 1))(grid))

    def held_against(self, position: FloatArray) -> Stamps:
        """Return the same, or even ones where the position (n,) was not read when they say: what it lacks of a curve
        through its neighbours does then not follow the way that its slope goes in the time that a stamp is off.
        """
        if self.even or position.size != self.count or position.size < _FEWEST:
            return self
        index, was_read = np.arange(self.count), np.isfinite(position)
        position = np.interp(index, index[was_read], position[was_read])
        slope, off = np.gradient(position), self.place - index
        follows, lacks = (_beside_neighbours(values) for values in (off * slope, position))
        power = float(follows @ follows)
        share = float(follows @ lacks) / power if power > 0.0 else 1.0
        doubt = 3.0 * float(np.std(lacks - share * follows)) / np.sqrt(power) if power > 0.0 else np.inf
        if share + doubt > 0.5:
            return self
        remark = f"{self.remarks[-1].rpartition(':')[0]}, and the position does not follow them: taken as even"
        return replace(self, even=True, remarks=(*self.remarks[:-1], remark))


def _beside_neighbours(values: FloatArray) -> FloatArray:
    """Return what values (n,) depart from the cubic through two neighbours on either side, (n - 4,)."""
    return np.convolve(values, np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0, mode="valid")


def one_rate(stated: Mapping[str, float], allowed: str = "rates that agree") -> float | None:
    """Return the rate, hertz, of several statements, by who makes them. Raises BadInput where two contradict."""
    return agreed(stated, lambda one, other: abs(other / one - 1.0) <= _RATE_TOLERANCE, "{:.6g} Hz".format, allowed)


def of_bare_rate(name: str, rate_hz: float) -> list[str]:
    """Return what is to be said of a rate by something without a unit: below what a display needs it is doubtful."""
    return [f"{name!r} has no unit: read as a rate of {rate_hz:.4g} Hz"] if rate_hz < _FELT_HZ else []


def read_stamps(time_s: FloatArray, stated: Mapping[str, float], first: int = 0) -> Stamps:
    """Judge stamps (n,), seconds, from a row `first` of the file on. Raises BadInput where they do not ascend,
    contradict the rate stated, hertz by who states it, or too much is missing.
    """
    if time_s.size < 3:
        raise BadInput(f"{time_s.size} time stamps", "3 or more")
    bad = np.flatnonzero(~np.isfinite(time_s))
    if bad.size:
        raise BadInput(
            f"the time stamp in row {first + bad[0] + 1} is not a number",
            "seconds, 12:30:05.25, or dates as 2024-05-01T12:30:05.25",
        )
    step = np.diff(time_s)
    back = np.flatnonzero(step <= 0.0)
    if np.all(step >= 0.0) and back.size > _REPEATED * step.size and time_s[-1] > time_s[0]:
        return _counted(time_s, one_rate(stated), first)
    if back.size > max(0.3 * step.size, 0) or np.median(step) <= 0.0:
        raise BadInput("the time stamps do not ascend", "stamps that do (printed with enough digits)")
    typical = _typical_step(step)
    if back.size and np.min(step) < -0.5 * typical:
        raise BadInput(f"time goes back in row {first + int(np.argmin(step)) + 2}", "stamps that ascend")
    jumps = np.maximum(np.round(step / typical), 1.0)
    missing = int(np.sum(jumps - 1.0)) if np.any(step > 1.6 * typical) else 0
    if missing == 0:
        jumps[:] = 1.0
    place_by_count = np.concatenate([[0.0], np.cumsum(jumps)])
    rate = place_by_count[-1] / (time_s[-1] - time_s[0])
    one_rate({**stated, "the time column": rate})
    if missing > _MOST_DROPPED * time_s.size:
        raise BadInput(f"{missing} of {time_s.size + missing} samples are missing", "2 % at most")
    return _judge(time_s, rate, place_by_count, missing)


def even_stamps(count: int, rate_hz: float) -> Stamps:
    """Return the stamps of samples without any, at a rate that is known."""
    return Stamps(rate_hz, np.arange(float(count)), count, True, ())


def _counted(time_s: FloatArray, rate_hz: float | None, first: int) -> Stamps:
    """Return the even grid of a stated rate for stamps (n,) that repeat, as whole milliseconds of a quick record do.

    Raises BadInput without a rate, and where rows are missing or the rate is another.
    """
    step = np.diff(time_s)
    tick, count = float(np.min(step[step > 0.0])), time_s.size
    by_number = (count - 1) / (time_s[-1] - time_s[0])
    if rate_hz is None:
        got = f"the time stamps repeat, {1.0 / np.mean(step > 0.0):.3g} rows each"
        raise BadInput(got, f"the sampling rate as well (`rate_hz`), {by_number:.5g} by their number")
    off = time_s * rate_hz - np.arange(count)
    off -= np.median(off)
    worst = int(np.argmax(np.abs(off)))
    if abs(off[worst]) > tick * rate_hz + 1.0:
        rows = f"the time stamp in row {first + worst + 1} is off by {abs(off[worst]):.3g} rows"
        got = f"at the {rate_hz:g} Hz given {rows}"
        raise BadInput(f"{got} ({by_number:.6g} Hz by their number)", "a rate that agrees, and no missing rows")
    remark = f"the time stamps repeat (steps of {tick:.3g} s): taken as even at the {rate_hz:g} Hz given"
    return replace(even_stamps(count, rate_hz), remarks=(remark,))


def read_clock(raw: FloatArray, name: str, factor: float, rate_hz: float | None) -> tuple[FloatArray, list[str]]:
    """Return the seconds of a column of time (n,) of that name, and what had to be assumed of it.

    factor: seconds of the column's unit, 0 where no unit is known: it may then have dates in milliseconds and finer, or
    count ticks, of which a stated rate says how long they are. A counter that wraps is counted on.
    """
    finite = raw[np.isfinite(raw)]
    if finite.size < 3:
        return raw * (factor or 1.0), []
    raw, wraps = _unwrapped(raw, factor or 1.0)
    if factor:
        return raw * factor, wraps
    step = _usual_step(raw)
    for words, unit in (("milliseconds", 1e-3), ("microseconds", 1e-6), ("nanoseconds", 1e-9)):
        low, high = (year / unit for year in _EPOCH_S)
        if step * unit < _LONGEST_STEP_S and low <= finite.min() and finite.max() <= high:
            return (raw - finite[0]) * unit, [*wraps, f"the time stamps are read as {words} since 1970"]
    is_counter = bool(np.all(finite == np.round(finite)))
    if rate_hz is not None and is_counter and step > 0.0 and abs(rate_hz * step - 1.0) > _RATE_TOLERANCE:
        remark = f"the time stamps count ticks, {step:.6g} to a sample at the {rate_hz:g} Hz given"
        return raw / (step * rate_hz), [*wraps, remark]
    if rate_hz is None and step > 0.0 and not _EPOCH_S[0] <= finite.min() <= _EPOCH_S[1]:
        wraps += of_bare_rate(name, 1.0 / step)
    return raw, wraps


def _usual_step(time: FloatArray) -> float:
    """Return the usual step of stamps (n,), some of which may be NaN, repeat, or go back."""
    step = np.diff(time)
    ahead = step[step >= 0.0]
    if not ahead.size:
        return 0.0
    median = float(np.median(ahead))
    return _typical_step(ahead) if median > 0.0 else float(np.mean(ahead))


def _unwrapped(raw: FloatArray, factor: float) -> tuple[FloatArray, list[str]]:
    """Return a counter's stamps (n,) counted on where it wraps, and what is to be said of that.

    It wraps where every step back is, but for a step or two, one of the spans of counters. A step back to the very
    first stamp may as well be another run, unless many are as far apart.
    """
    step, usual = np.diff(raw), _usual_step(raw)
    back = np.flatnonzero(step < -0.5 * usual)
    if not back.size or usual <= 0.0:
        return raw, []
    near = 2.5 * max(usual, float(np.min(step[step > 0.0])))
    first = raw[np.isfinite(raw)][0]
    for span, name in _spans(factor):
        if span > 4.0 * near and np.all(np.abs(usual - step[back] - span) < near):
            if back.size < _MANY_WRAPS and np.all(np.abs(raw[back + 1] - first) < 0.05 * usual):
                continue
            turns = np.zeros(raw.size)
            turns[back + 1] = span
            return raw + np.cumsum(turns), [f"the time counter wraps at {name} in row {back[0] + 2}: counted on"]
    return raw, []


def _spans(factor: float) -> list[tuple[float, str]]:
    """Return the spans at which counters wrap, in the unit of a column of `factor` seconds, with their names: powers of
    two of its unit and of decimal parts of it, and a minute, an hour and a day.
    """
    parts = ((1.0, ""), (1e-3, " thousandths"), (1e-6, " millionths"))
    counters = [(2.0**bits * part, f"2^{bits}{name}") for bits in (8, 16, 24, 31, 32) for part, name in parts]
    clocks = [
        (seconds / factor, name) for seconds, name in ((60.0, "a minute"), (3600.0, "an hour"), (86400.0, "a day"))
    ]
    return counters + clocks


def elapsed(seconds: FloatArray) -> FloatArray:
    """Return the time of every row since the first, (n,): a stamp that is none, goes back or leaps counts a step."""
    step, usual = np.diff(seconds), _usual_step(seconds)
    is_step = (step >= 0.0) & (step < _LEAP * usual)
    return np.concatenate([[0.0], np.cumsum(np.where(is_step, step, usual))])


def runs_of(seconds: FloatArray) -> list[slice]:
    """Return the rows of each run, where the time goes back by half of a run and more: there another one begins."""
    usual = _usual_step(seconds)
    back = np.flatnonzero(np.diff(seconds) < -0.5 * usual) + 1
    begins = [0]
    for row in back if back.size <= _MOST_RUNS else ():
        if seconds[row - 1] - seconds[row] >= 0.5 * (seconds[row - 1] - seconds[begins[-1]]):
            begins.append(int(row))
    return [slice(begin, end) for begin, end in zip(begins, [*begins[1:], seconds.size], strict=True)]


def _typical_step(step: FloatArray) -> float:
    """Return the median step, sharpened by the mean of all that are near it (rounded stamps alternate)."""
    median = float(np.median(step))
    near = np.abs(step - median) <= 0.6 * median
    return float(np.mean(step[near]))


def _quantum(time_s: FloatArray) -> float:
    """Return the last decimal place that the stamps were printed with, seconds; 0 where they have all their digits."""
    some = time_s[-1000:]  # the coarsest, where all have as many digits in all
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
