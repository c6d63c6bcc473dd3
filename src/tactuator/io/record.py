"""Records and frequency responses, in our own HDF5 and in whatever else has such columns; the rate by time stamps."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from tactuator import __version__
from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, within
from tactuator.io.atomic import atomic_path
from tactuator.io.column_name import QUANTITIES, ColumnName, column_name
from tactuator.io.columns import MOST_SAMPLES, Columns, read_columns
from tactuator.io.hdf5 import written_hdf5
from tactuator.io.kinds import require_kind
from tactuator.io.response_table import NO_NAMES, ResponseColumns, are_of_response, asked_column, response_of
from tactuator.signals.record import FrequencyResponse, Record

_MOST_DROPPED = 0.02
_RATE_TOLERANCE = 0.01
_FEWEST = 50
_LARGEST = 1e100
"""Beyond it, and below its inverse, an estimate's powers are no numbers."""


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
        """Return the values (n,) on the even grid (count,): held (a command) or interpolated (a position)."""
        if self.even:
            return values
        grid = np.arange(self.count, dtype=np.float64)
        if hold:
            index = np.clip(np.searchsorted(self.place, grid + 0.5, side="right") - 1, 0, values.size - 1)
            return values[index]
        return np.asarray(scipy.interpolate.make_interp_spline(self.place, values, k=min(3, values.size - 1))(grid))

    def held_against(self, position: FloatArray) -> Stamps:
        """Return the same, or even ones where the position (n,) was not read when they say: what it lacks of a curve
        through its neighbours does then not follow the way that its slope goes in the time that a stamp is off.
        """
        if self.even or position.size != self.count or position.size < _FEWEST:
            return self
        slope, off = np.gradient(position), self.place - np.arange(self.count)
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


FORMAT = "tactuator-record/1"
INPUT_NAMES = ("command_v", "command", "input", "u", "voltage", "in", "uest", "vir", "torque", "force", "current")
OUTPUT_NAMES = ("position_v", "position", "output", "y", "out", "yest", "qm", "angle", "displacement", "velocity")
REFERENCE_NAMES = ("reference", "reference_v", "setpoint", "ref")
TIME_NAMES = ("time_s", "time", "t", "time_ms", "t_ms", "time_us", "t_us", "timestamp", "seconds", "x_value")
RATE_NAMES = ("rate_hz", "fs", "rate", "samplerate", "sample_rate", "sampling_rate")
STEP_NAMES = ("ts", "dt", "sample_time", "sampletime")


def read_record(
    path: str | Path,
    *,
    input: str | None = None,
    output: str | None = None,
    reference: str | None = None,
    time: str | None = None,
    rate_hz: float | None = None,
) -> Record:
    """Read a record of any format that `read_columns` knows; names of columns or variables choose what is what.

    Left to itself it takes the usual names (command_v, input, u, ...), or, of exactly two columns beside the time, the
    first as command. A name may be given with its unit, NAME=UNIT. The rate comes from rate_hz, the file, or the time
    stamps, which must agree. Raises BadInput.
    """
    path = Path(path)
    columns = measured_columns(path)
    with within(f"record {path}"):
        return _assemble(path, columns, input, output, reference, time, rate_hz)


def read_measured(path: Path, response: ResponseColumns = NO_NAMES, **names: Any) -> Record | FrequencyResponse:
    """Read what a file has: a record as `read_record` does, or a frequency response. Raises BadInput."""
    return measured_of(path, measured_columns(path), response, **names)


def measured_of(
    path: Path, columns: Columns, response: ResponseColumns = NO_NAMES, **names: Any
) -> Record | FrequencyResponse:
    """Return what `read_measured` reads in a file whose columns are read already."""
    with within(f"record {path}"):
        is_response = are_of_response(columns, response)
    if is_response:
        return response_of(path, columns, response)
    with within(f"record {path}"):
        return _assemble(path, columns, **names)


def measured_columns(path: Path) -> Columns:
    """Return the columns of a file that may be a record or a response. Raises BadInput for a file of another kind."""
    require_kind(path, "record", "response", "sound")
    return read_columns(path)


def _assemble(
    path: Path,
    columns: Columns,
    input: str | None = None,
    output: str | None = None,
    reference: str | None = None,
    time: str | None = None,
    rate_hz: float | None = None,
) -> Record:
    clock = _pick(columns, time, TIME_NAMES, "time") or _by_unit(columns)
    if clock is not None and time is not None and clock.unit.kind not in ("", "time"):
        raise BadInput(f"{clock.text!r}, named as time, is in {clock.unit.text}", "a column of seconds, or NAME=UNIT")
    u_column, y_column = _signals(columns, input, output, clock)
    u_name, y_name = u_column.text, y_column.text
    if clock is not None and clock.text in (u_name, y_name):
        which = "command" if clock.text == u_name else "position"
        raise BadInput(f"{clock.text!r} is the {which} and the time", "another column for one of them")
    r_column = _pick(columns, reference, REFERENCE_NAMES, "reference")
    r_name = None if r_column is None else r_column.text
    u, y = columns.values[u_name], columns.values[y_name]
    r = None if r_name is None else columns.values[r_name]
    if reference is None and r is not None and (r.size != u.size or not np.all(np.isfinite(r))):
        r = None
    if u.size != y.size or (r is not None and r.size != u.size):
        many = f", {r_name} {r.size}" if r is not None else ""
        raise BadInput(f"{u_name} has {u.size} samples, {y_name} {y.size}{many}", "as many of each")
    for name, values in ((u_name, u), (y_name, y), *(((str(r_name), r),) if r is not None else ())):
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            more = f" and in {bad.size - 1} more" if bad.size > 1 else ""
            units = " ('#' before a row of units)" if bad.tolist() == [0] else ""
            raise BadInput(f"{name} is not a number in row {bad[0] + 1} of {values.size}{more}", f"numbers{units}")
        largest = np.abs(values).max(initial=0.0)
        if largest > 0.0 and not 1.0 / _LARGEST <= largest <= _LARGEST:
            raise BadInput(f"the largest {name} is {largest:.3g}", f"{1.0 / _LARGEST:g} to {_LARGEST:g}")
    remarks = [*columns.remarks, *([f"only the first {u.size} samples are read"] if columns.cut else [])]
    known = _known_rate(columns, rate_hz)
    if clock is not None and columns.values[clock.text].size == u.size:
        stamps = read_stamps(columns.values[clock.text] * clock.unit.factor, known).held_against(y)
        u, y = stamps.spread(u, True), stamps.spread(y, False)
        r = None if r is None else stamps.spread(r, True)
        known, remarks = stamps.rate_hz, remarks + list(stamps.remarks)
    elif known is None:
        raise BadInput("there is no rate and no time stamps", "a time column, or the rate in Hz")
    about = {"file": path.name, "input": u_name, "output": y_name} | dict(columns.attributes)
    quantity = y_column.quantity
    if quantity not in ("", "displacement") and "quantity" not in about:
        about["quantity"] = quantity
        remarks.append(f"{y_name!r} is read as {quantity} (--quantity)")
    read = {u_name, y_name, clock.text if clock else "", "" if r is None else str(r_name)}
    if unread := _unread(columns, read, columns.values[y_name].size):
        remarks.append(f"not read: {', '.join(map(repr, unread))}")
    u_unit, y_unit = _unit(columns, u_column), _unit(columns, y_column)
    return Record(float(known), u, y, u_unit, y_unit, r, about, tuple(remarks))


_OF_SIGNALS = ("voltage", "current", "force", *QUANTITIES)


def _unit(columns: Columns, column: ColumnName) -> str:
    """Return the unit of a signal, as a model names it."""
    return column.unit.text if column.unit.kind in _OF_SIGNALS else columns.units.get(column.text, "")


def _by_unit(columns: Columns) -> ColumnName | None:
    """Return the only column whose unit is one of time."""
    times = [name for name in _names_of(columns, columns.values) if name.unit.kind == "time"]
    return times[0] if len(times) == 1 and columns.values[times[0].text].size > 1 else None


def _names_of(columns: Columns, names: Iterable[str]) -> list[ColumnName]:
    return [column_name(name, columns.units.get(name, "")) for name in names]


def _unread(columns: Columns, read: set[str], count: int) -> list[str]:
    """Return the columns beside those that were read that look like a command, a position, a reference or a time."""
    rest = [name for name, values in columns.values.items() if name not in read and values.size == count]
    usual = {*INPUT_NAMES, *OUTPUT_NAMES, *REFERENCE_NAMES, *TIME_NAMES}
    return [
        name.text
        for name in _names_of(columns, rest)
        if _plain(name.base) in usual or name.unit.kind in (*_OF_SIGNALS, "time") or name.has(*_LIKE_SIGNALS)
    ]


_LIKE_SIGNALS = ("posit", "displ", "veloc", "accel", "command", "input", "output", "time", "refer", "setpoint")


def _plain(name: str) -> str:
    """Return the last part of a name, as a variable of a struct has several, in small letters."""
    return name.lower().rpartition(".")[2].strip(" _,/:-")


def _known_rate(columns: Columns, rate_hz: float | None) -> float | None:
    """Return the rate that the option or the file (an attribute, a variable fs or Ts) gives; the two must agree."""
    if rate_hz is not None and not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise BadInput(f"the rate given is {rate_hz:g} Hz", "a positive number")
    inside = columns.rate_hz
    for name, values in columns.values.items():
        if values.size == 1 and inside is None and values[0] > 0.0:
            plain = name.lower().rpartition(".")[2]
            if plain in RATE_NAMES:
                inside = float(values[0])
            elif plain in STEP_NAMES:
                inside = 1.0 / float(values[0])
    if rate_hz is None:
        return inside
    if inside is not None and abs(rate_hz / inside - 1.0) > 0.01:
        raise BadInput(f"the rate given is {rate_hz:g} Hz, the file says {inside:g} Hz", "one that agrees")
    return rate_hz


def _pick(columns: Columns, asked: str | None, usual: tuple[str, ...], what: str) -> ColumnName | None:
    """Return the column that an option names, or the first of the usual names, with a unit behind it or without."""
    if asked is not None:
        return asked_column(columns, asked, what)
    names = _names_of(columns, reversed(list(columns.values)))
    usable = [name for name in names if columns.values[name.text].size > 1]
    named = {_plain(name.base): name for name in usable} | {_plain(name.text): name for name in usable}
    named |= {name.text.lower(): name for name in usable}
    return next((named[name] for name in usual if name in named), None)


def _signals(
    columns: Columns, input_name: str | None, output_name: str | None, time: ColumnName | None
) -> tuple[ColumnName, ColumnName]:
    u = _pick(columns, input_name, INPUT_NAMES, "input")
    y = _pick(columns, output_name, OUTPUT_NAMES, "output")
    beside = [name for name, values in columns.values.items() if values.size > 1 and (not time or name != time.text)]
    rest = _names_of(columns, beside)
    if len(rest) > 2:
        rest = [name for name in rest if _plain(name.base) not in REFERENCE_NAMES]
    if u is None and y is None and len(rest) == 2:
        u, y = rest
    elif u is None and y is not None and len(rest) == 2 and y.text in beside:
        u = next(name for name in rest if name.text != y.text)
    elif y is None and u is not None and len(rest) == 2 and u.text in beside:
        y = next(name for name in rest if name.text != u.text)
    if u is None or y is None:
        signals = (("command (input)", u), ("position (output)", y))
        missing = " and ".join(signal for signal, known in signals if known is None)
        missing += " (and time)" if time is None else ""
        named = ", ".join(name.text for name in rest)
        raise BadInput("which column is which is not clear", f"names for {missing}, each one of {named}")
    if u.text == y.text:
        raise BadInput(f"input and output are both {u.text!r}", "two different columns")
    return u, y


def write_record(path: str | Path, record: Record) -> None:
    """Write our own HDF5: datasets command, position (and reference) with units, rate and origin as attributes."""
    with atomic_path(path) as beside, written_hdf5(beside) as written:
        file = written.file
        file.attrs["format"] = FORMAT
        file.attrs["tool"] = __version__
        file.attrs["rate_hz"] = record.rate_hz
        for key, value in record.about.items():
            file.attrs[key] = value
        signals = [
            ("command", record.command, record.command_unit),
            ("position", record.position, record.position_unit),
        ]
        if record.reference is not None:
            signals.append(("reference", record.reference, "1"))
        for name, values, unit in signals:
            file.create_dataset(name, data=values, compression="gzip", compression_opts=1, shuffle=True)
            file[name].attrs["unit"] = unit


__all__ = ["FORMAT", "MOST_SAMPLES", "read_record", "write_record"]
