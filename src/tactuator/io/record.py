"""Reading of records, in our own HDF5 and in whatever else holds a command and a position, and writing."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tactuator import __version__
from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.atomic import atomic_path
from tactuator.io.columns import MOST_SAMPLES, Columns, read_columns
from tactuator.io.formats.hdf5 import written_hdf5
from tactuator.io.stamps import read_stamps
from tactuator.signals.record import Record

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
    columns = read_columns(path)
    try:
        return _assemble(path, columns, (input_name, output_name, reference_name), time_name, rate_hz)
    except BadInput as error:
        raise error.within(f"record {path}") from None


def _assemble(
    path: Path,
    columns: Columns,
    names: tuple[str | None, str | None, str | None],
    time_name: str | None,
    rate_hz: float | None,
) -> Record:
    time = _pick(columns, time_name, TIME_NAMES, "time")
    u_name, y_name = _signals(columns, names[0], names[1], time)
    r_name = _pick(columns, names[2], REFERENCE_NAMES, "reference")
    u, y = columns.values[u_name], columns.values[y_name]
    r = None if r_name is None else columns.values[r_name]
    if names[2] is None and r is not None and (r.size != u.size or not np.all(np.isfinite(r))):
        r = None
    if u.size != y.size or (r is not None and r.size != u.size):
        many = f", {r_name} {r.size}" if r is not None else ""
        raise BadInput(f"{u_name} has {u.size} samples, {y_name} {y.size}{many}", "as many of each")
    for name, values in ((u_name, u), (y_name, y), *(((str(r_name), r),) if r is not None else ())):
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            more = f" and in {bad.size - 1} more" if bad.size > 1 else ""
            raise BadInput(f"{name} is not a number in row {bad[0] + 1} of {values.size}{more}", "numbers")
    remarks = [*columns.remarks, *([f"only the first {u.size} samples are read"] if columns.cut else [])]
    known = _known_rate(columns, rate_hz)
    if time is not None and columns.values[time].size == u.size:
        stamps = read_stamps(_seconds(time, columns.values[time]), known)
        u, y = stamps.spread(u, True), stamps.spread(y, False)
        r = None if r is None else stamps.spread(r, True)
        known, remarks = stamps.rate_hz, remarks + list(stamps.remarks)
    elif known is None:
        raise BadInput("there is no rate and no time stamps", "a time column, or --rate-hz")
    about = {"file": path.name, "input": u_name, "output": y_name} | dict(columns.attributes)
    return Record(
        rate_hz=float(known),
        command=u,
        position=y,
        command_unit=columns.units.get(u_name, "V" if u_name.endswith("_v") else ""),
        position_unit=columns.units.get(y_name, "V" if y_name.endswith("_v") else ""),
        reference=r,
        about=about,
        remarks=tuple(remarks),
    )


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


def _seconds(name: str, values: FloatArray) -> FloatArray:
    for ending, factor in (("_ms", 1e-3), ("_us", 1e-6), ("_ns", 1e-9)):
        if name.lower().endswith(ending):
            return values * factor
    return values


def _pick(columns: Columns, asked: str | None, usual: tuple[str, ...], what: str) -> str | None:
    if asked is not None:
        if asked in columns.values:
            return asked
        raise BadInput(f"there is no {what} column {asked!r}", f"{', '.join(columns.values)}")
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
        missing = " and ".join(option for option, known in (("--input", u), ("--output", y)) if known is None)
        raise BadInput("which column is which is not clear", f"{missing}, each with one of {', '.join(rest)}")
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
