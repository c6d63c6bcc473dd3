"""A frequency response out of a table's columns: which column is what, in which unit, and what was done to it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, unknown, within
from tactuator.io.column_name import QUANTITIES, ColumnName, column_name, unit_of
from tactuator.io.columns import Columns, read_columns
from tactuator.io.kinds import require_kind
from tactuator.parameters import table
from tactuator.signals.record import FrequencyResponse

_LIKE_ANGLE = re.compile("(?i)deg|rad|arc|cyc|rev|turn|perc|[%\u00b0\u03c0]")
"""Texts in brackets that are a unit of an angle, if not one that is known."""
_TYPICAL = 0.01
"""Relative error of a magnitude that comes without one: a tenth of a decibel."""
_LEAST_TURN_DEG = 45.0
"""A phase without a unit that stays within it may as well be radians, of seven turns of dead time."""
_ALIKE_DB, _ALIKE_RAD = 0.1, 0.02
"""Difference up to which two columns say the same: what rounding to three digits leaves."""
_FEW = 0.02
"""Share of the points at which they may differ: bad readings."""
_LINEAR = ("", "displacement", "velocity", "acceleration", "voltage", "current", "force", "impedance")
"""Kinds of units that a magnitude, a real and an imaginary part may have."""
_PLAIN_NAMES = {"magnitude", "magnitude_db", "gain", "gain_db", "phase_deg", "phase_rad", "real", "imag", "imaginary"}


@table("plant")
class ResponseColumns:
    """Names of a response's columns, each perhaps with its unit as NAME=UNIT; ignore: those that are left unread."""

    frequency: str | None = None
    magnitude: str | None = None
    phase: str | None = None
    real: str | None = None
    imaginary: str | None = None
    ignore: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return any((self.frequency, self.magnitude, self.phase, self.real, self.imaginary))


NO_NAMES = ResponseColumns()


_ASIDE = re.compile(
    "confid|noise|error|std|deviat|distort|thd|floor|delay|group|latency|uncert|limit|target|minim|maxim|toleran|snr|"
    "attenuat|loss|weight|lag$|squar|power|invers|recipr|normal|relativ|index|bin$|neg|half|sqrt|\\d*log(10)?$|l[gn]$|x10+$|\u00b2$"
)
"""Beginnings of words that make a column something else than the response itself."""
_CHANGED = re.compile(
    r"^\s*[-\u2212]|^1\s*/|(?:[/*^\u00d7]|\bx)\s*[2-9.]|(?<![\w.])(?:10+|0?\.\d+|\d+[eE][-+]?\d+)(?!\w)|(?i:freq\w*\s+ratio)"
)
"""What makes a name that of a multiple, a power or an inverse."""
_LOGARITHMS = {"log", "20log", "log10", "20log10"}
_ROLES = (
    ("coherence", "coher|coh$|cxy$|gamma2$|\u03b32$", ("",)),
    ("imaginary", "imag|im$", _LINEAR),
    ("real", "real$|re$", _LINEAR),
    ("frequency", "freq|fr\u00e9q|frec|omega|f$|\u03c9$|w$|hz$", ("", "angular")),
    ("frequency", "", ("frequency",)),
    ("phase", "", ("angle",)),
    ("phase", "phas|fase|angle|argument|theta|ph$|pha$|arg$|ang$|phi$|\u03c6$|\u2220$", ("",)),
    ("level", "", ("level",)),
    ("level", "db$|spl$", ("",)),
    ("magnitude", "magn|ampl|modul|betrag|gain|mag$|abs$|h$|tf$|frf$|transmissib|ratio$", _LINEAR),
    ("amplitude", "", _LINEAR[1:]),
    ("amplitude", "displ|veloc|accel", ("",)),
)
"""Roles of columns: the first one of whose words one begins so, and whose unit is of one of the kinds."""


def role_of(column: ColumnName) -> str:
    """Return what a column is in a response: frequency, level (dB), magnitude, amplitude (in a unit of motion), phase,
    real, imaginary, coherence, confidence; "" for another.
    """
    words, kind = column.words, column.unit.kind
    if "confidence" in words and kind == "level":
        return "confidence"
    if any(map(_ASIDE.match, words - (_LOGARITHMS if kind == "level" else set()))) or _CHANGED.search(column.base):
        return ""
    words = words - {"re"} if "db" in words else words
    for role, starts, kinds in _ROLES:
        if kind in kinds and (not starts or any(re.match(starts, word) for word in words)):
            return role
    return ""


def asked_column(columns: Columns, asked: str, what: str) -> ColumnName:
    """Return the column that an option names, as NAME or NAME=UNIT. Raises BadInput for one that there is not, and for
    a unit that is unknown or not the one in brackets in its name.
    """
    if asked in columns.values:
        return column_name(asked, columns.units.get(asked, ""))
    name, _, unit = asked.rpartition("=")
    if name not in columns.values:
        raise unknown(f"{what} column", asked, columns.values)
    if unit_of(unit) is None:
        raise BadInput(f"the unit {unit!r} of {name!r}", "Hz, s, deg, rad, dB, V, A, N, mm, mm/s, m/s2 and their like")
    return column_name(name, unit)


def are_of_response(columns: Columns, asked: ResponseColumns = NO_NAMES) -> bool:
    """Return whether columns are a frequency with a magnitude, or with what may be one."""
    if asked:
        return True
    names = _described(columns)
    roles = {role_of(column) for column in names}
    if "frequency" not in roles:
        return {"real", "imaginary"} <= roles or ("phase" in roles and bool(roles & {"level", "magnitude"}))
    if roles & {"level", "magnitude", "real", "imaginary"}:
        return True
    has_time = any(column.unit.kind == "time" or column.has("time") or column.words == {"t"} for column in names)
    is_sure = any(role_of(column) == "frequency" and (column.unit.kind or column.words != {"f"}) for column in names)
    return is_sure and not has_time


def read_response(path: Path, asked: ResponseColumns = NO_NAMES) -> FrequencyResponse:
    """Read the frequency response in a file. Raises BadInput."""
    require_kind(path, "response", "record")
    return response_of(path, read_columns(path), asked)


def response_of(path: Path, columns: Columns, asked: ResponseColumns = NO_NAMES) -> FrequencyResponse:
    """Return the response in a file's columns; what is done to its points is remarked. Raises BadInput."""
    with within(f"response {path}"):
        return _Reader(columns, asked).response(path.name)


def _described(columns: Columns) -> list[ColumnName]:
    """Return the names of the columns that have numbers, or should have by their name."""
    many = [name for name, values in columns.values.items() if values.size > 1]
    names = [column_name(name, columns.units.get(name, "")) for name in many]
    return [name for name in names if np.isfinite(columns.values[name.text]).any() or role_of(name)]


class _Reader:
    """Finds what each column of a response is. read: those that were; remarks: to be said."""

    def __init__(self, columns: Columns, asked: ResponseColumns) -> None:
        missing = [name for name in asked.ignore if name not in columns.values]
        if missing:
            raise unknown("column to ignore", missing[0], columns.values)
        named = (asked.frequency, asked.magnitude, asked.phase, asked.real, asked.imaginary)
        pairs = (each.rpartition("=") for each in named if each and each not in columns.values)
        units = {**columns.units, **{name: unit for name, _, unit in pairs if name in columns.values}}
        self.columns, self.asked = replace(columns, units=units), asked
        self.names = [column for column in _described(self.columns) if column.text not in asked.ignore]
        self.read: set[str] = set()
        self.remarks = list(columns.remarks)

    def response(self, file: str) -> FrequencyResponse:
        """Return the response."""
        frequency = self.one("frequency", self.asked.frequency, ("frequency",), ("frequency", "angular", ""))
        if frequency is None:
            raise BadInput(f"no frequency among {self._list()}", "a column frequency_hz, or `frequency` NAME")
        if frequency.unit.kind == "" and (frequency.unknown or frequency.words & {"omega", "\u03c9", "w"}):
            allowed = f"`frequency` {frequency.text + '=Hz'!r} or {frequency.text + '=rad/s'!r}"
            raise BadInput(f"the frequency {frequency.text!r} has no unit that is known", allowed)
        hertz = self.values(frequency) * frequency.unit.factor
        self.names = [column for column in self.names if self.values(column).size == hertz.size]
        said = self._said()
        self._require_read(said.phase)
        self.columns.require_values(self.read)
        deviation, assumed = self._deviation(hertz.size)
        about = {"file": file, "kind": "response"}
        main = said.columns[0]
        if main.unit.kind in QUANTITIES:
            about["unit"] = main.unit.text
        if main.quantity not in ("", "displacement"):
            about["quantity"] = main.quantity
            self.remarks.append(f"{main.text!r} is read as a response of {main.quantity} (`quantity`)")
        return self._assembled(hertz, said, deviation, about, assumed)

    def values(self, column: ColumnName) -> FloatArray:
        """Return the numbers of a column."""
        return self.columns.values[column.text]

    def one(self, role: str, asked: str | None, roles: Sequence[str], kinds: Sequence[str]) -> ColumnName | None:
        """Return the column of a role, or None. Raises BadInput for two, and for one that an option
        names whose unit is of none of the kinds.
        """
        if asked is not None:
            column = asked_column(self.columns, asked, role)
            if column.unit.kind not in kinds:
                allowed = f"a column for `{role}` in another unit, or NAME=UNIT"
                raise BadInput(f"{column.text!r}, named as {role}, is in {column.unit.text}", allowed)
            size = self.names and self.values(self.names[0]).size
            if role != "frequency" and self.values(column).size != size:
                raise BadInput(f"{column.text!r} has {self.values(column).size} points, not {size}", "as many in each")
            self.read.add(column.text)
            return column
        found = [column for column in self.names if role_of(column) in roles]
        if len(found) > 1:
            several = ", ".join(repr(column.text) for column in found)
            raise BadInput(f"{len(found)} columns may be the {role}: {several}", f"`{role}` NAME, the one that is")
        self.read.update(column.text for column in found)
        return found[0] if found else None

    def _list(self) -> str:
        return f"columns {', '.join(column.text for column in self.names)}"

    def _said(self) -> _Said:
        """Return the magnitude, the phase and the columns that say them. Raises BadInput where others say them
        differently.
        """
        asked, said = self.asked, list[_Said]()
        if asked.magnitude is None and asked.phase is None:
            real = self.one("real", asked.real, ("real",), _LINEAR)
            imaginary = self.one("imaginary", asked.imaginary, ("imaginary",), _LINEAR)
            if real is not None and imaginary is not None:
                value = self.values(real) + 1j * self.values(imaginary)
                said.append(_Said((real, imaginary), np.abs(value), np.angle(value)))
            elif half := real or imaginary:
                got = f"{half.text!r} without its other half among {self._list()}"
                raise BadInput(got, f"`{'imaginary' if imaginary is None else 'real'}` NAME")
        if asked.real is None and asked.imaginary is None:
            phase = self.one("phase", asked.phase, ("phase",), ("angle", ""))
            turned = None if phase is None else self._radians(phase)
            for column in self._sizes(bool(said)):
                said.append(_Said((column, *((phase,) if phase else ())), self._linear(column), turned))
        if not said:
            allowed = "frequency_hz with magnitude or magnitude_db (and phase_deg), or with real and imag"
            raise BadInput(f"no magnitude among {self._list()}", f"{allowed}; `magnitude` NAME says which")
        for other in said[1:]:
            said[0].require_alike(other)
        self.remarks += said[0].remarks()
        return said[0]

    def _sizes(self, has_parts: bool) -> list[ColumnName]:
        """Return the columns of a magnitude: the one that is named, else one in linear units and one in dB."""
        if self.asked.magnitude is not None:
            named = self.one("magnitude", self.asked.magnitude, (), ("level", *_LINEAR))
            return [named] if named else []
        sizes = [self.one("magnitude", None, (role,), ()) for role in ("magnitude", "level")]
        if not has_parts and not any(sizes):
            sizes = [self.one("magnitude", None, ("amplitude",), ())]
        return [column for column in sizes if column is not None]

    def _linear(self, column: ColumnName) -> FloatArray:
        values = self.values(column)
        return np.asarray(10.0 ** (values * column.unit.factor / 20.0)) if _is_level(column) else values

    def _radians(self, column: ColumnName) -> FloatArray:
        """Return a phase in radians. Raises BadInput for one without a unit that may be either."""
        values, unit = self.values(column), column.unit
        if unit.kind == "angle":
            return values * unit.factor
        largest = _largest(values)
        if 0.0 < largest <= _LEAST_TURN_DEG or _LIKE_ANGLE.search(column.unknown):
            got = f"the phase {column.text!r} has no unit and stays within {largest:.3g}: degrees or radians"
            raise BadInput(got, f"`phase` {column.text + '=deg'!r} or `phase` {column.text + '=rad'!r}")
        return np.radians(values)

    def _require_read(self, phase: FloatArray | None) -> None:
        """Name the columns that are not read. Raises BadInput where one of them may be the phase that is missing."""
        known = {"coherence", "confidence"}
        unread = [column for column in self.names if column.text not in self.read and role_of(column) not in known]
        if not unread:
            return
        named = ", ".join(repr(column.text) for column in unread)
        if phase is None:
            first = unread[0].text
            allowed = f"`phase` {first!r} if it is the phase, or `ignore` {first!r}"
            raise BadInput(f"a magnitude without phase, beside what is not read: {named}", allowed)
        self.remarks.append(f"not read: {named}")

    def _deviation(self, count: int) -> tuple[FloatArray, bool]:
        """Return the relative standard error, by a confidence in decibels (95 %) or by the coherence of one average,
        and whether it is assumed.
        """
        if confidence := self.one("confidence", None, ("confidence",), ()):
            return np.maximum((10.0 ** (self.values(confidence) / 20.0) - 1.0) / 1.96, 1e-5), False
        coherence = self.one("coherence", None, ("coherence",), ())
        if coherence is None:
            self.remarks.append("there is no confidence: 1 % of the magnitude is taken")
            return np.full(count, _TYPICAL), True
        share = self.values(coherence)
        if not (np.nanmax(share) <= 1.01 and np.nanmin(share) >= 0.0):
            got = f"{coherence.text!r} goes from {np.nanmin(share):.3g} to {np.nanmax(share):.3g}"
            raise BadInput(got, f"0 to 1, or `ignore` {coherence.text!r}")
        self.remarks.append("the coherence is taken to be of one average")
        share = np.clip(share, 1e-3, 1.0 - 1e-6)
        return np.maximum(np.sqrt((1.0 - share) / (2.0 * share)), 1e-4), False

    def _assembled(
        self, hertz: FloatArray, said: _Said, deviation: FloatArray, about: dict[str, str], assumed: bool
    ) -> FrequencyResponse:
        """Return the response at its points in order, each frequency once, those of no number and 0 Hz left out."""
        size, phase = said.size, said.phase
        known = np.isfinite(hertz) & np.isfinite(size) & np.isfinite(deviation)
        if phase is None:
            self.remarks.append("there is no phase: that of least lag is taken, without dead time")
        else:
            if np.mean(np.isfinite(phase)) < 0.5:
                got = f"the phase is missing at {int(np.sum(~np.isfinite(phase)))} of {phase.size} points"
                raise BadInput(got, "fewer than half, or no phase column at all (then the least phase is taken)")
            known &= np.isfinite(phase)
        if not np.all(known):
            self.remarks.append(f"{int(np.sum(~known))} of {known.size} points are no numbers and are left out")
        if still := int(np.sum(known & (hertz == 0.0))):
            self.remarks.append(f"{still} {'row' if still == 1 else 'rows'} of 0 Hz left out")
            known &= hertz != 0.0
        if np.any(size[known] <= 0.0):
            raise BadInput(
                "a magnitude of the response is zero or below", "above zero (in dB: a name in _db, or NAME=dB)"
            )
        turned = None if phase is None else phase[known]
        points = _each_once(hertz[known], size[known], turned, deviation[known], self.remarks)
        return FrequencyResponse(*points, about, tuple(self.remarks), assumed)


@dataclass(frozen=True, eq=False)
class _Said:
    """What columns say of a response: its magnitude, and its phase in radians, if any; (n,)."""

    columns: tuple[ColumnName, ...]
    size: FloatArray
    phase: FloatArray | None

    def require_alike(self, other: _Said) -> None:
        """Raise BadInput where other columns say the magnitude, or the phase, differently."""
        with np.errstate(all="ignore"):
            off = np.abs(20.0 * np.log10(self.size / other.size)) / _ALIKE_DB
            if self.phase is not None and other.phase is not None:
                off = np.fmax(off, np.abs(np.angle(np.exp(1j * (self.phase - other.phase)))) / _ALIKE_RAD)
        off = np.where(np.isfinite(off), off, 0.0)
        if np.mean(off > 1.0) > _FEW:
            one, two = (", ".join(repr(column.text) for column in each.columns) for each in (self, other))
            got = f"{one} and {two} say the response differently, most in row {int(np.argmax(off)) + 1}"
            raise BadInput(got, "`magnitude` and `phase`, or `real` and `imaginary`, that are of one response")

    def remarks(self) -> list[str]:
        """Return what was read in columns whose names do not say it all."""
        said, named = [], []
        for column in self.columns:
            if role_of(column) == "phase" and self.phase is not None and column.unit.kind != "angle":
                largest = _largest(np.degrees(self.phase))
                said.append(f"the phase {column.text!r} has no unit and is read in degrees (it goes to {largest:.3g})")
            elif column.text not in _PLAIN_NAMES:
                unit = column.unit.text or ("dB" if _is_level(column) else "linear units")
                named.append(f"{column.text!r}{f' in {unit}' if unit else ''}")
        return [*([f"the response is read in {', '.join(named)}"] if named else []), *said]


def _largest(values: FloatArray) -> float:
    return float(np.abs(values[np.isfinite(values)]).max(initial=0.0))


def _is_level(column: ColumnName) -> bool:
    return column.unit.kind == "level" or role_of(column) == "level"


def _each_once(
    hertz: FloatArray, size: FloatArray, phase: FloatArray | None, deviation: FloatArray, remarks: list[str]
) -> tuple[FloatArray, FloatArray, FloatArray | None, FloatArray]:
    """Return the points in order of frequency; those of one frequency are averaged (complex, or in dB without a phase),
    with an error that is no less than they differ by.
    """
    frequency, first, place, count = np.unique(hertz, return_index=True, return_inverse=True, return_counts=True)
    if frequency.size == hertz.size:
        return frequency, size[first], None if phase is None else phase[first], deviation[first]
    value = np.log(size) + 0j if phase is None else size * np.exp(1j * (phase - phase[first][place]))
    mean = (np.bincount(place, value.real) + 1j * np.bincount(place, value.imag)) / count
    apart = np.zeros(frequency.size)
    np.maximum.at(apart, place, np.abs(value - mean[place]) / (1.0 if phase is None else size))
    times = f"{count.min()}" if count.min() == count.max() else f"up to {count.max()}"
    remarks.append(
        f"{int(np.sum(count > 1))} of {frequency.size} frequencies come {times} times and are averaged: "
        f"they are up to {8.686 * float(apart.max()):.2g} dB off their mean"
    )
    middle, turned = (np.exp(mean.real), None) if phase is None else (np.abs(mean), phase[first] + np.angle(mean))
    return frequency, middle, turned, np.maximum(np.bincount(place, deviation) / count, apart)
