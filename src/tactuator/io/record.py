"""Records and frequency responses, in our own HDF5 and in whatever else has such columns; the rate by time stamps."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactuator import __version__
from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, within
from tactuator.io.atomic import atomic_path
from tactuator.io.column_name import QUANTITIES, ColumnName, column_name
from tactuator.io.columns import MOST_SAMPLES, Columns, read_columns
from tactuator.io.hdf5 import written_hdf5
from tactuator.io.kinds import require_kind, require_replaceable
from tactuator.io.response_table import NO_NAMES, ResponseColumns, are_of_response, asked_column, response_of
from tactuator.io.stamps import elapsed, even_stamps, of_bare_rate, one_rate, read_clock, read_stamps, runs_of
from tactuator.parameters import SMALLEST
from tactuator.signals.multisine import without_periods
from tactuator.signals.record import FrequencyResponse, Record

_MOST_UNREAD, _LONGEST_UNREAD = 0.02, 20
"""Share of a signal's samples that may be no numbers, and how many of them in a row."""
_FEWEST_OF_RUN = 100
"""Rows below which a run is left out."""
_ONE_RATE = 1e-3
"""Difference of the rates by their stamps up to which runs have one."""

FORMAT = "tactuator-record/1"
INPUT_NAMES = ("command_v", "command", "input", "u", "in", "voltage", "uest", "vir", "torque", "force", "current")
OUTPUT_NAMES = ("position_v", "position", "output", "y", "out", "yest", "qm", "angle", "displacement", "velocity")
REFERENCE_NAMES = ("reference", "reference_v", "setpoint", "ref")
TIME_NAMES = ("time_s", "time", "t", "time_ms", "t_ms", "time_us", "t_us", "timestamp", "seconds", "x_value")


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
        return _longest(_assemble(path, columns, input, output, reference, time, rate_hz))


def read_runs(path: Path, response: ResponseColumns = NO_NAMES, **names: Any) -> list[Record] | FrequencyResponse:
    """Read all runs of a record, the longest first, or a frequency response.

    names: as for `read_record`, and from_s and to_s, the part of a record that is read: what lies outside is not
    judged. Raises BadInput.
    """
    return _runs(path, measured_columns(path), response, **names)


def read_measured(path: Path, response: ResponseColumns = NO_NAMES, **names: Any) -> Record | FrequencyResponse:
    """Read what a file has: a record as `read_record` does, or a frequency response. Raises BadInput."""
    return measured_of(path, measured_columns(path), response, **names)


def measured_of(
    path: Path, columns: Columns, response: ResponseColumns = NO_NAMES, **names: Any
) -> Record | FrequencyResponse:
    """Return what `read_measured` reads in a file whose columns are read already."""
    read = _runs(path, columns, response, **names)
    return _longest(read) if isinstance(read, list) else read


def _runs(path: Path, columns: Columns, response: ResponseColumns, **names: Any) -> list[Record] | FrequencyResponse:
    with within(f"record {path}"):
        is_response = are_of_response(columns, response)
    if is_response:
        return response_of(path, columns, response)
    with within(f"record {path}"):
        return _assemble(path, columns, **names)


def _longest(runs: list[Record]) -> Record:
    """Return the first of several runs, and that it is one of them."""
    first, *others = runs
    if not others:
        return first
    return replace(first, remarks=(*first.remarks, f"the longest of {len(runs)} runs is used"))


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
    from_s: float | None = None,
    to_s: float | None = None,
) -> list[Record]:
    """Return the runs of a record, the longest first, of the part from from_s to to_s."""
    clock = _clock(columns, time)
    u_column, y_column = _signals(columns, input, output, clock)
    u_name, y_name = u_column.text, y_column.text
    r_column = _pick(columns, reference, REFERENCE_NAMES, "reference")
    r_name = None if r_column is None else r_column.text
    u, y = columns.values[u_name], columns.values[y_name]
    r = None if r_name is None else columns.values[r_name]
    if reference is None and r is not None and (r.size != u.size or not np.all(np.isfinite(r))):
        r = None
    if u.size != y.size or (r is not None and r.size != u.size):
        many = f", {r_name} {r.size}" if r is not None else ""
        raise BadInput(f"{u_name} has {u.size} samples, {y_name} {y.size}{many}", "as many of each")
    remarks = [*columns.remarks, *([f"only the first {u.size} samples are read"] if columns.cut else [])]
    stated = _stated_rates(columns, rate_hz, (u_name, y_name))
    stamps, stated, of_time = _timed(columns, clock, stated, u.size)
    remarks += of_time
    about = {"file": path.name, "input": u_name, "output": y_name} | dict(columns.attributes)
    units = _unit(columns, u_column), _unit(columns, y_column)
    remarks += _reported(u_column, y_column, units[0], named=input is not None or output is not None)
    remarks += _of_units(u_column, y_column)
    quantity = y_column.quantity
    if quantity not in ("", "displacement") and "quantity" not in about:
        about["quantity"] = quantity
        remarks.append(f"{y_name!r} is read as {quantity} (`quantity`)")
    read = {u_name, y_name, clock.text if clock else "", "" if r is None else str(r_name)}
    columns.require_values(read)
    if unread := _unread(columns, read, columns.values[y_name].size):
        remarks.append(f"not read: {', '.join(map(repr, unread))}")
    names = (u_name, y_name) if r is None else (u_name, y_name, str(r_name))
    table = _Rows(names, (u, y) if r is None else (u, y, r), stamps, stated)
    if from_s is not None or to_s is not None:
        table, about = table.between(from_s, to_s), without_periods(about)
    runs = _records(table, units, about, remarks)
    if rate_hz is None and stamps is not None:
        _require_head(columns.head_hz, runs[0].rate_hz)
    return runs


def _timed(
    columns: Columns, clock: ColumnName | None, stated: Mapping[str, float], count: int
) -> tuple[FloatArray | None, Mapping[str, float], list[str]]:
    """Return the time stamps of so many rows, seconds, if any; the rates that are stated; what is to be said of both.
    Raises BadInput without either.
    """
    if clock is not None and columns.values[clock.text].size == count:
        factor = clock.unit.factor if clock.unit.kind == "time" else 0.0
        stamps, remarks = read_clock(columns.values[clock.text], clock.text, factor, one_rate(stated))
        return stamps, stated, [*remarks, *_of_units(clock), *_of_bare_rates(stated)]
    if stated:
        return None, stated, _of_bare_rates(stated)
    known = one_rate(columns.head_hz, "rates that agree, or `rate_hz`")
    if known is None:
        raise BadInput("there is no rate and no time column", "`time` NAME or NAME=UNIT, or `rate_hz`")
    remarks = [f"the rate is that of the file's head, {known:g} Hz", *_of_bare_rates(columns.head_hz)]
    return None, columns.head_hz, remarks


def _of_bare_rates(stated: Mapping[str, float]) -> list[str]:
    """Return what is to be said of a rate that is stated without any unit."""
    units = {name: column_name(name.strip("`")).unit.kind for name in stated}
    return [] if not stated or any(units.values()) else of_bare_rate(*next(iter(stated.items())))


def _require_head(head: Mapping[str, float], rate_hz: float) -> None:
    """Raise BadInput where a file's head states rates, and none of them is that of the time stamps."""
    refusals = []
    for name, hertz in head.items():
        try:
            one_rate({name: hertz, "the time column": rate_hz})
        except BadInput as error:
            refusals.append(error)
    if refusals and len(refusals) == len(head):
        raise BadInput(refusals[0].got, "rates that agree; `time` NAME=UNIT, or `rate_hz`")


def _reported(command: ColumnName, position: ColumnName, command_unit: str, *, named: bool) -> Iterator[str]:
    """Yield what is to be reported of how columns were chosen and of their units; named: by the user."""
    usual = {_plain(command.base), _plain(position.base)} & {*INPUT_NAMES, *OUTPUT_NAMES}
    if not named and not usual:
        yield f"{command.text!r} is read as the command, {position.text!r} as the position (`input`, `output`)"
    if command_unit and command.unit.kind != "voltage":
        yield f"the command {command.text!r} is read in {command_unit}, where a display commands volts"


def _of_units(*columns: ColumnName) -> Iterator[str]:
    """Yield what is to be said of the units of columns."""
    for name in columns:
        if name.is_unknown:
            yield f"{name.text!r} has no unit that is known"
        if name.guessed:
            yield f"{name.text!r} is read in {name.unit.text}, as stated, not in {name.guessed}"


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows of a record. names, signals: of command, position and, if any, reference; stamps: seconds (n,), or None;
    stated: rates that are known without them; first: the row of the file, first_s: its time; is_part: of a file's rows.
    """

    names: tuple[str, ...]
    signals: tuple[FloatArray, ...]
    stamps: FloatArray | None
    stated: Mapping[str, float]
    first: int = 0
    first_s: float = 0.0
    is_part: bool = False

    @property
    def rate_hz(self) -> float:
        """Return the rate that is stated, hertz; 1 where none is."""
        return one_rate(self.stated) or 1.0

    def of(self, rows: slice, first_s: float) -> _Rows:
        """Return some of the rows."""
        stamps = None if self.stamps is None else self.stamps[rows]
        signals, first = tuple(values[rows] for values in self.signals), self.first + rows.start
        return replace(self, signals=signals, stamps=stamps, first=first, first_s=first_s, is_part=True)

    def times(self) -> FloatArray:
        """Return the time of each row since the first, seconds, also where stamps are amiss."""
        count = self.signals[0].size
        return np.arange(count) / self.rate_hz if self.stamps is None else elapsed(self.stamps)

    def between(self, from_s: float | None, to_s: float | None) -> _Rows:
        """Return the rows between two times since the first. Raises BadInput where that is nothing."""
        time = self.times()
        step = float(np.median(np.diff(time))) if time.size > 1 else 0.0
        whole, first_s = float(time[-1]) + step, from_s or 0.0
        last_s = whole if to_s is None else to_s
        if not 0.0 <= first_s < last_s <= whole + step:
            raise BadInput(f"from {first_s:g} s to {last_s:g} s", f"ascending, within 0 .. {whole:g} s")
        begin, end = (int(np.searchsorted(time, edge - 0.5 * step)) for edge in (first_s, last_s))
        return self.of(slice(begin, end), first_s)

    def trimmed(self) -> _Rows:
        """Return the rows from the first to the last in which all signals are numbers."""
        whole = np.flatnonzero(np.all(np.isfinite(self.signals), axis=0))
        if not whole.size or whole.size == self.signals[0].size:
            return self
        rows = slice(int(whole[0]), int(whole[-1]) + 1)
        return self.of(rows, self.first_s + float(self.times()[rows.start]))

    def record(self, units: tuple[str, str], about: dict[str, str], remarks: list[str]) -> Record:
        """Return the rows as a record at an even rate, with what is to be said of it."""
        rows = self.trimmed()
        remarks = [*remarks, *self._left_out(rows)]
        remarks += [rows.require_numbers(name, values) for name, values in zip(rows.names, rows.signals, strict=True)]
        command, position, *others = rows.signals
        if rows.stamps is None:
            stamps = even_stamps(command.size, rows.rate_hz)
        else:
            stamps = read_stamps(rows.stamps, rows.stated, rows.first).held_against(position)
        reference = stamps.spread(others[0], True) if others else None
        command, position = stamps.spread(command, True), stamps.spread(position, False)
        said = tuple(filter(None, [*remarks, *stamps.remarks]))
        if rows.is_part:
            from_s = float(about.get("from_s", 0.0)) + rows.first_s
            about = about | {"from_s": f"{from_s:.9g}", "to_s": f"{from_s + command.size / stamps.rate_hz:.9g}"}
        return Record(float(stamps.rate_hz), command, position, *units, reference, about, said)

    def _left_out(self, rows: _Rows) -> list[str]:
        lost = self.signals[0].size - rows.signals[0].size
        return [f"{lost} rows at the ends are left out: not all of their cells are numbers"] if lost else []

    def require_numbers(self, name: str, values: FloatArray) -> str:
        """Return what is to be said of samples (n,) that were not read. Raises BadInput where they are too many, or the
        others no sizes to reckon with.
        """
        bad = np.flatnonzero(~np.isfinite(values))
        in_a_row = int(np.max(np.diff(np.flatnonzero(np.concatenate([[True], np.isfinite(values), [True]]))))) - 1
        if bad.size > _MOST_UNREAD * values.size or in_a_row > _LONGEST_UNREAD:
            more = f" and in {bad.size - 1} more" if bad.size > 1 else ""
            more += f", {in_a_row} in a row" if in_a_row > _LONGEST_UNREAD else ""
            raise BadInput(
                f"{name} is not a number in row {self.first + bad[0] + 1} of {self.first + values.size}{more}",
                f"numbers (2 % may lack, {_LONGEST_UNREAD} in a row; a part: `from_s`, `to_s`)",
            )
        largest = np.abs(values[np.isfinite(values)]).max(initial=0.0)
        if largest > 0.0 and not SMALLEST <= largest <= 1.0 / SMALLEST:
            raise BadInput(f"the largest {name} is {largest:.3g}", f"{SMALLEST:g} to {1.0 / SMALLEST:g}")
        if not bad.size:
            return ""
        lacks = (
            f"{bad.size} samples of {name} were not read, the first"
            if bad.size > 1
            else f"1 sample of {name} was not read,"
        )
        return f"{lacks} in row {self.first + bad[0] + 1}: filled in"


def _records(table: _Rows, units: tuple[str, str], about: dict[str, str], remarks: list[str]) -> list[Record]:
    """Return a record of each run that a table has, the longest first; all have its rate."""
    parts = [slice(0, table.signals[0].size)] if table.stamps is None else runs_of(table.stamps)
    if len(parts) == 1:
        return [table.record(units, about, remarks)]
    time = table.times()
    long = [part for part in parts if part.stop - part.start >= _FEWEST_OF_RUN]
    if not long:
        raise BadInput(f"time goes back in row {table.first + parts[1].start + 1}", "stamps that ascend")
    runs = [table.of(part, table.first_s + float(time[part.start])).record(units, about, []) for part in long]
    runs.sort(key=lambda run: -run.command.size)
    first = runs[0]
    alike = [run for run in runs if abs(run.rate_hz / first.rate_hz - 1.0) < _ONE_RATE]
    rows = ", ".join(str(table.first + part.start + 1) for part in parts[1:6]) + ", ..." * (len(parts) > 6)
    remark = f"the time begins anew in row {rows}: {len(parts)} runs"
    if len(alike) < len(parts):
        remark += f", {len(parts) - len(alike)} of them left out (shorter than 100 rows, or at another rate)"
    # rates by stamps differ by what was lost in printing them
    alike = [replace(run, rate_hz=first.rate_hz) for run in alike]
    return [replace(first, remarks=(*remarks, remark, *first.remarks)), *alike[1:]]


_OF_SIGNALS = ("voltage", "current", "force", *QUANTITIES)


def _unit(columns: Columns, column: ColumnName) -> str:
    """Return the unit of a signal, as a model names it; one that is not known as the file has it."""
    return column.unit.text or columns.units.get(column.text, "")


def _by_unit(columns: Columns) -> ColumnName | None:
    """Return the only column whose unit is one of time."""
    times = [name for name in _names_of(columns, columns.values) if name.unit.kind == "time"]
    return times[0] if len(times) == 1 and columns.values[times[0].text].size > 1 else None


def _names_of(columns: Columns, names: Iterable[str]) -> list[ColumnName]:
    return [column_name(name, columns.units.get(name, "")) for name in names]


def _unread(columns: Columns, read: set[str], count: int) -> list[str]:
    """Return the columns beside those that were read that look like a command, a position, a reference or a time."""
    rest = [
        name
        for name, values in columns.values.items()
        if name not in read and values.size == count and _has_numbers(values)
    ]
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


def _stated_rates(columns: Columns, rate_hz: float | None, names: Sequence[str]) -> Mapping[str, float]:
    """Return the rate of the option, and those that the file states of these columns, or of all, otherwise than by its
    head. Raises BadInput where they contradict.
    """
    if rate_hz is not None and not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise BadInput(f"the rate given is {rate_hz:g} Hz", "a positive number")
    stated = {} if rate_hz is None else {"`rate_hz`": rate_hz}
    for place, hertz in columns.stated_hz.items():
        group = place.rpartition(".")[0]
        if not group or any(name.startswith(group) for name in names):
            stated[place] = hertz
    one_rate(stated)
    return stated


def _has_numbers(values: FloatArray) -> bool:
    return bool(np.count_nonzero(np.isfinite(values)) > 1)


def _pick(columns: Columns, asked: str | None, usual: tuple[str, ...], what: str) -> ColumnName | None:
    """Return the column that an option names, or the first of the usual names, with a unit behind it or without."""
    if asked is not None:
        return asked_column(columns, asked, what)
    found = _usual(columns, usual)
    if found is not None and what in ("input", "output") and f"{found.text}.2" in columns.values:
        allowed = f"`{what}` {found.text!r} or '{found.text}.2'"
        raise BadInput(f"two columns are named {found.text!r} and differ", allowed)
    return found


def _usual(columns: Columns, usual: tuple[str, ...]) -> ColumnName | None:
    names = _names_of(columns, reversed(list(columns.values)))
    usable = [name for name in names if _has_numbers(columns.values[name.text])]
    named = {_plain(name.base): name for name in usable} | {_plain(name.text): name for name in usable}
    named |= {name.text.lower(): name for name in usable}
    return next((named[name] for name in usual if name in named), None)


def _clock(columns: Columns, asked: str | None) -> ColumnName | None:
    clock = _pick(columns, asked, TIME_NAMES, "time") or _by_unit(columns)
    if clock is not None and asked is not None and clock.unit.kind not in ("", "time"):
        raise BadInput(f"{clock.text!r}, named as time, is in {clock.unit.text}", "a column of seconds, or NAME=UNIT")
    return clock


def _signals(
    columns: Columns, input_name: str | None, output_name: str | None, time: ColumnName | None
) -> tuple[ColumnName, ColumnName]:
    u = _pick(columns, input_name, INPUT_NAMES, "input")
    y = _pick(columns, output_name, OUTPUT_NAMES, "output")
    many = [name for name, values in columns.values.items() if _has_numbers(values)]
    beside = [name for name in many if not time or name != time.text]
    rest = _names_of(columns, beside)
    if len(rest) > 2:
        rest = [name for name in rest if _plain(name.base) not in REFERENCE_NAMES]
    if u is None and y is None and len(rest) == 2:
        u, y = sorted(rest, key=_leans)
    elif u is None and y is not None and len(rest) == 2 and y.text in beside:
        u = next(name for name in rest if name.text != y.text)
    elif y is None and u is not None and len(rest) == 2 and u.text in beside:
        y = next(name for name in rest if name.text != u.text)
    if u is None or y is None:
        signals = (("the command (`input`)", u), ("the position (`output`)", y))
        missing = " and ".join(signal for signal, known in signals if known is None)
        missing += " (and `time`)" if time is None else ""
        named = ", ".join(name.text for name in rest)
        raise BadInput("which column is which is not clear", f"names of {missing}, each one of {named}")
    if u.text == y.text:
        raise BadInput(f"input and output are both {u.text!r}", "two different columns")
    if time is not None and time.text in (u.text, y.text):
        which = "command" if time.text == u.text else "position"
        raise BadInput(f"{time.text!r} is the {which} and the time", "another column for one of them")
    return u, y


_OF_COMMAND = re.compile(r"driv|actuat|excit|stimul|control|demand|motor|ampl|amp$|dac|ao\d|source|soll|cmd|comm")
_OF_POSITION = re.compile(r"sens|encod|respon|measur|feedb|laser|lvdt|probe|gauge|pickup|adc|ai\d|ist")


def _leans(column: ColumnName) -> int:
    """Return 1 for a column that is a position rather than a command by its name or unit, -1 the other way round."""
    words = {word.rstrip("0123456789") for word in column.words}
    is_position = column.quantity != "" or any(map(_OF_POSITION.match, column.words)) or bool(words & {*OUTPUT_NAMES})
    return is_position - (any(map(_OF_COMMAND.match, column.words)) or bool(words & {*INPUT_NAMES}))


def check_record_path(path: Path) -> None:
    """Refuse a path that a record cannot be written to, before it is taken."""
    if path.suffix.lower() not in (".h5", ".hdf5"):
        raise BadInput(f"record {path}: ending {path.suffix!r}", ".h5, .hdf5")
    require_replaceable(path, "record")


def write_record(path: str | Path, record: Record) -> None:
    """Write our own HDF5: datasets command, position (and reference) with units, rate and origin as attributes."""
    check_record_path(Path(path))
    with atomic_path(path, "record") as beside, written_hdf5(beside) as written:
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
