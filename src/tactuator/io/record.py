"""Records and frequency responses, in our own HDF5 and in whatever else has such columns; the rate by time stamps."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from tactuator import __version__
from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, unknown, within
from tactuator.io.atomic import atomic_path
from tactuator.io.columns import MOST_SAMPLES, Columns, read_columns
from tactuator.io.hdf5 import written_hdf5
from tactuator.io.kinds import require_kind
from tactuator.signals.record import FrequencyResponse, Record

_MOST_DROPPED = 0.02
_RATE_TOLERANCE = 0.01
_FEWEST = 50
_LARGEST = 1e100
"""Beyond it, and below its inverse, an estimate's powers are no numbers."""


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


FREQUENCY_NAMES = ("frequency_hz", "frequency", "freq_hz", "freq", "f_hz", "hz", "f")
MAGNITUDE_NAMES = ("magnitude", "gain", "amplitude", "abs", "mag", "magnitude_v")
LEVEL_NAMES = ("magnitude_db", "gain_db", "level_db", "mag_db", "db", "amplitude_db")
PHASE_NAMES = {"phase_deg": np.pi / 180.0, "phase_degrees": np.pi / 180.0, "phase_rad": 1.0, "phase": np.pi / 180.0}
REAL_NAMES, IMAGINARY_NAMES = ("real", "re", "response_real"), ("imag", "imaginary", "im", "response_imag")
_TYPICAL = 0.01
"""Relative error of a magnitude that comes without one: a tenth of a decibel."""


def are_of_response(columns: Columns) -> bool:
    """Return whether columns are a frequency and a magnitude (or real and imaginary part)."""
    names = {name.lower() for name in columns.values}
    parts = bool(names & set(REAL_NAMES)) and bool(names & set(IMAGINARY_NAMES))
    return bool(names & set(FREQUENCY_NAMES)) and (parts or bool(names & {*MAGNITUDE_NAMES, *LEVEL_NAMES}))


def response_of(path: Path, columns: Columns) -> FrequencyResponse:
    """Return the response in a file's columns; points that are no number are left out, with a remark. Raises
    BadInput.
    """
    with within(f"response {path}"):
        return _assembled(path, columns)


def _assembled(path: Path, columns: Columns) -> FrequencyResponse:
    lower = {name.lower(): values for name, values in columns.values.items()}
    frequency = _first(lower, FREQUENCY_NAMES)
    level, magnitude = _first(lower, LEVEL_NAMES), _first(lower, MAGNITUDE_NAMES)
    real, imaginary = _first(lower, REAL_NAMES), _first(lower, IMAGINARY_NAMES)
    if level is None and magnitude is None and real is not None and imaginary is not None:
        magnitude = np.hypot(real, imaginary)
        lower["phase_rad"] = np.arctan2(imaginary, real)
    if frequency is None or (level is None and magnitude is None):
        raise BadInput(
            f"columns {', '.join(columns.values)}",
            "frequency_hz with magnitude or magnitude_db (and phase_deg), or with real and imag",
        )
    size = magnitude if magnitude is not None else 10.0 ** (np.asarray(level) / 20.0)
    phase = next((lower[name] * factor for name, factor in PHASE_NAMES.items() if name in lower), None)
    deviation, said = _deviation(lower, size.size)
    known = np.isfinite(frequency) & np.isfinite(size) & np.isfinite(deviation)
    remarks = [*columns.remarks, *([said] if said else [])]
    if phase is not None and np.mean(np.isfinite(phase)) < 0.5:
        raise BadInput(
            f"the phase is missing at {int(np.sum(~np.isfinite(phase)))} of {phase.size} points",
            "fewer than half, or no phase column at all (then the least phase is taken)",
        )
    if phase is not None:
        known &= np.isfinite(phase)
    if not np.all(known):
        remarks.append(f"{int(np.sum(~known))} of {known.size} points are no numbers and are left out")
    if phase is None:
        remarks.append("there is no phase: that of least lag is taken, without dead time")
    order = np.argsort(frequency[known], kind="stable")
    hertz, size, deviation = (column[known][order] for column in (frequency, size, deviation))
    turned = None if phase is None else phase[known][order]
    about = {"file": path.name, "kind": "response"}
    assumed = not {"confidence_db", "coherence"} & set(lower)
    return FrequencyResponse(hertz, size, turned, deviation, about, tuple(remarks), assumed)


def _first(columns: dict[str, FloatArray], names: tuple[str, ...]) -> FloatArray | None:
    return next((columns[name] for name in names if name in columns), None)


def _deviation(columns: dict[str, FloatArray], count: int) -> tuple[FloatArray, str]:
    """Return the relative standard error, by a confidence in decibels (95 %) or by the coherence of one average."""
    if "confidence_db" in columns:
        return np.maximum((10.0 ** (columns["confidence_db"] / 20.0) - 1.0) / 1.96, 1e-5), ""
    if "coherence" in columns:
        share = np.clip(columns["coherence"], 1e-3, 1.0 - 1e-6)
        return np.maximum(np.sqrt((1.0 - share) / (2.0 * share)), 1e-4), "the coherence is taken to be of one average"
    return np.full(count, _TYPICAL), "there is no confidence: 1 % of the magnitude is taken"


FORMAT = "tactuator-record/1"
INPUT_NAMES = ("command_v", "command", "input", "u", "voltage", "in", "uest", "vir", "torque", "force", "current")
OUTPUT_NAMES = ("position_v", "position", "output", "y", "out", "yest", "qm", "angle", "displacement", "velocity")
REFERENCE_NAMES = ("reference", "reference_v", "setpoint", "ref")
TIME_NAMES = ("time_s", "time", "t", "time_ms", "t_ms", "time_us", "t_us", "timestamp", "seconds")
RATE_NAMES = ("rate_hz", "fs", "rate", "samplerate", "sample_rate", "sampling_rate")
STEP_NAMES = ("ts", "dt", "sample_time", "sampletime")


def read_record(
    path: str | Path,
    *,
    input_name: str | None = None,
    output_name: str | None = None,
    reference_name: str | None = None,
    time_name: str | None = None,
    rate_hz: float | None = None,
) -> Record:
    """Read a record of any format that `read_columns` knows; names of columns or variables choose what is what.

    Left to itself it takes the usual names (command_v, input, u, ...), or, of exactly two columns beside the time, the
    first as command. The rate comes from rate_hz, the file, or the time stamps, which must agree. Raises BadInput.
    """
    path = Path(path)
    columns = measured_columns(path)
    with within(f"record {path}"):
        return _assemble(path, columns, input_name, output_name, reference_name, time_name, rate_hz)


def read_measured(path: Path, **names: Any) -> Record | FrequencyResponse:
    """Read what a file has: a record as `read_record` does, or a frequency response. Raises BadInput."""
    return measured_of(path, measured_columns(path), **names)


def measured_of(path: Path, columns: Columns, **names: Any) -> Record | FrequencyResponse:
    """Return what `read_measured` reads in a file whose columns are read already."""
    if are_of_response(columns):
        return response_of(path, columns)
    with within(f"record {path}"):
        return _assemble(path, columns, **names)


def measured_columns(path: Path) -> Columns:
    """Return the columns of a file that may be a record or a response. Raises BadInput for a file of another kind."""
    require_kind(path, "record", "response", "sound")
    return read_columns(path)


def _assemble(
    path: Path,
    columns: Columns,
    input_name: str | None = None,
    output_name: str | None = None,
    reference_name: str | None = None,
    time_name: str | None = None,
    rate_hz: float | None = None,
) -> Record:
    time = _pick(columns, time_name, TIME_NAMES, "time")
    u_name, y_name = _signals(columns, input_name, output_name, time)
    if time in (u_name, y_name):
        which = "command" if time == u_name else "position"
        raise BadInput(f"{time!r} is the {which} and the time", "another column for one of them")
    r_name = _pick(columns, reference_name, REFERENCE_NAMES, "reference")
    u, y = columns.values[u_name], columns.values[y_name]
    r = None if r_name is None else columns.values[r_name]
    if reference_name is None and r is not None and (r.size != u.size or not np.all(np.isfinite(r))):
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
    if time is not None and columns.values[time].size == u.size:
        stamps = read_stamps(columns.values[time] * _SECONDS.get(_ending(time), 1.0), known).held_against(y)
        u, y = stamps.spread(u, True), stamps.spread(y, False)
        r = None if r is None else stamps.spread(r, True)
        known, remarks = stamps.rate_hz, remarks + list(stamps.remarks)
    elif known is None:
        raise BadInput("there is no rate and no time stamps", "a time column, or the rate in Hz")
    about = {"file": path.name, "input": u_name, "output": y_name} | dict(columns.attributes)
    u_unit, y_unit = (columns.units.get(name, _UNITS.get(_ending(name), "")) for name in (u_name, y_name))
    return Record(float(known), u, y, u_unit, y_unit, r, about, tuple(remarks))


_UNITS = {"v": "V", "mv": "mV", "mm": "mm", "um": "um", "m": "m", "nm": "nm"}
_SECONDS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_ENDING = re.compile(r"(?:_|[\[(])\s*(?!Nm\b)([^\W_]+)\s*[\])]?$")


def _ending(name: str) -> str:
    """Return what a column's name ends in after `_` or in brackets, in small letters, with u for µ; none for Nm."""
    match = _ENDING.search(name)
    return match[1].casefold().replace("\u03bc", "u") if match else ""


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


def _pick(columns: Columns, asked: str | None, usual: tuple[str, ...], what: str) -> str | None:
    if asked is not None:
        if asked in columns.values:
            return asked
        raise unknown(f"{what} column", asked, columns.values)
    lower = {name.lower().rpartition(".")[2]: name for name in reversed(list(columns.values))}
    lower |= {name.lower(): name for name in columns.values}
    return next((lower[name] for name in usual if name in lower and columns.values[lower[name]].size > 1), None)


def _signals(columns: Columns, input_name: str | None, output_name: str | None, time: str | None) -> tuple[str, str]:
    u = _pick(columns, input_name, INPUT_NAMES, "input")
    y = _pick(columns, output_name, OUTPUT_NAMES, "output")
    rest = [name for name, values in columns.values.items() if name != time and values.size > 1]
    rest = [name for name in rest if name.lower().rpartition(".")[2] not in REFERENCE_NAMES] if len(rest) > 2 else rest
    if u is None and y is None and len(rest) == 2:
        u, y = rest
    elif u is None and len(rest) == 2 and y in rest:
        u = next(name for name in rest if name != y)
    elif y is None and len(rest) == 2 and u in rest:
        y = next(name for name in rest if name != u)
    if u is None or y is None:
        signals = (("command (input)", u), ("position (output)", y))
        missing = " and ".join(signal for signal, known in signals if known is None)
        missing += " (and time)" if time is None else ""
        raise BadInput("which column is which is not clear", f"names for {missing}, each one of {', '.join(rest)}")
    if u == y:
        raise BadInput(f"input and output are both {u!r}", "two different columns")
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
