"""Columns of numbers out of foreign files: CSV, MATLAB, WAV, HDF5, in pieces where the format allows it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy
import soundfile

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, agreed
from tactuator.io.column_name import changes_values, rate_said, unit_of
from tactuator.io.hdf5 import opened_hdf5, require_survivable
from tactuator.io.sound import length_remarks, require_whole, without_remarks
from tactuator.io.text import encoding_of
from tactuator.io.text_table import last_number_cut_off, read_table

MOST_SAMPLES = 4_000_000
"""Rows read of one file: 100 MB in memory, whatever the file's length."""
MOST_VALUES = 32_000_000
"""Numbers read of one file, all columns together: 256 MB in memory, whatever the file claims to hold."""
_LONGEST_TEXT = 1000


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of a file. values: column name to (n,), all of one length unless the format allows others. stated_hz: its
    rates, by who states them. head_hz: those of the head over its columns. changed: what a column's values lack.

    attributes: plain text that the file carries. cut: rows beyond MOST_SAMPLES were left unread. remarks: on what is
    amiss and was left out.
    """

    values: Mapping[str, FloatArray]
    stated_hz: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    attributes: Mapping[str, str] = field(default_factory=dict)
    cut: bool = False
    remarks: tuple[str, ...] = ()
    head_hz: Mapping[str, float] = field(default_factory=dict)
    changed: Mapping[str, str] = field(default_factory=dict)

    def require_values(self, names: Iterable[str]) -> None:
        """Raise BadInput for a column whose numbers are not its values, as the file states."""
        for name in names:
            if name in self.changed:
                raise BadInput(f"{name!r} has {self.changed[name]}", "values that are already scaled, without it")


def read_columns(path: Path) -> Columns:
    """Read a file: text by its content, .mat, .wav .flac, .h5 .hdf5 by its ending. BadInput, one line, otherwise."""
    readers = {
        ".csv": _read_text, ".txt": _read_text, ".tsv": _read_text, ".dat": _read_text, ".mat": _read_matlab,
        ".wav": _read_sound, ".flac": _read_sound, ".h5": _read_hdf5, ".hdf5": _read_hdf5,
    }  # fmt: skip
    reader = readers.get(path.suffix.lower(), _read_text if _is_text(path) else None)
    if not path.is_file():
        raise BadInput(f"record {path}: {'it is a folder' if path.is_dir() else 'file not found'}")
    if reader is None:
        raise BadInput(f"record {path}: ending {path.suffix!r}", f"{', '.join(readers)}")
    try:
        columns = reader(path)
    except BadInput as error:
        raise error.within(f"record {path}") from None
    except MemoryError:
        raise BadInput(f"record {path}: it claims more than memory holds", "a shorter one") from None
    except Exception as error:  # a library that reads a broken file of others may raise anything at all
        reason = str(error).splitlines()[0].rstrip(".") if str(error) else "cannot be read"
        raise BadInput(f"record {path}: it is cut short or spoilt ({reason})", "a whole file") from None
    if not columns.values:
        raise BadInput(f"record {path}: there are no numbers in it", "columns of numbers")
    return columns


def _is_text(path: Path) -> bool:
    """Return whether a file of any ending begins with text."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        start = file.read(4096)
    return start != b"" and (b"\0" not in start or encoding_of(start) != "utf-8")


def _read_text(path: Path) -> Columns:
    table = read_table(path, MOST_SAMPLES, MOST_VALUES)
    last = None if table.cut else last_number_cut_off(path)
    values, remarks = table.values, tuple[str, ...]()
    if last is not None:
        values = values[:-1]
        remarks = (f"the file ends within its last number ({last}, of too few digits): its row is left out",)
    if table.footer:
        remarks += (f"lines of text below the rows are left out: {table.footer!r}",)
    remarks += tuple(f"not applied: {each}" for each in table.changes)
    columns = {name: values[:, k] for k, name in enumerate(table.names)}
    return Columns(columns, units=table.units, cut=table.cut, remarks=remarks, head_hz=table.head_hz)


def _read_matlab(path: Path) -> Columns:
    if h5py.is_hdf5(path):
        return _read_hdf5(path)
    _require_room(sum(math.prod(shape) for _, shape, _ in scipy.io.whosmat(path)))
    require_survivable(lambda: scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False))
    content = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)
    columns: dict[str, FloatArray] = {}
    texts: dict[str, str] = {}
    for name, value in content.items():
        if not name.startswith("__"):
            _gather(name, value, columns, texts)
    return _with_statements(Columns(columns), texts)


_OF_UNIT = re.compile(r"(?i)^(.*?)[._]?units?$")


def _with_statements(columns: Columns, texts: Mapping[str, str]) -> Columns:
    """Return columns with what other variables state of them: y_unit, y.scale, fs, dt."""
    single = {name: f"{values[0]:.9g}" for name, values in columns.values.items() if values.size == 1} | dict(texts)
    owners: dict[str, list[str]] = {}
    for name, values in columns.values.items():
        for owner in {name, name.rpartition(".")[0]} if values.size > 1 else ():
            owners.setdefault(owner, []).append(name)
    units, changed, rates, spare = dict(columns.units), dict(columns.changed), dict(columns.stated_hz), list[str]()
    for name, value in single.items():
        rates |= rate_said(name, value)
        if found := _OF_UNIT.match(name):
            units |= dict.fromkeys(owners.get(found[1], [])[:1], value)
        elif changes_values(name.rpartition(".")[2], value):
            stem = re.split(r"[._](?=[^._]*$)", name)[0]
            mine = owners.get(stem, []) if stem != name else []
            changed |= {column: f"{name} {value}" for column in mine if column == stem or len(mine) == 1}
            spare += [] if mine else [f"{name} {value}"]
    remarks = (*columns.remarks, *(f"not applied: {each}" for each in spare))
    return replace(columns, units=units, changed=changed, stated_hz=rates, remarks=remarks)


def _gather(name: str, value: Any, columns: dict[str, FloatArray], texts: dict[str, str]) -> None:
    """Gather the numbers, rows and columns of a variable, and texts; fields of a struct as name.field."""
    if hasattr(value, "_fieldnames"):
        for field_name in value._fieldnames:
            _gather(f"{name}.{field_name}", getattr(value, field_name), columns, texts)
        return
    if isinstance(value, str):
        texts[name] = value
    array = np.asarray(value)
    if array.dtype.kind == "c":
        _gather(f"{name} (real)", array.real, columns, texts)
        _gather(f"{name} (imag)", array.imag, columns, texts)
    if array.dtype.kind not in "fiub":
        return
    array = np.asarray(array, dtype=np.float64)
    if array.ndim <= 1:
        columns[name] = np.atleast_1d(array)[:MOST_SAMPLES]
    elif array.ndim == 2:
        tall = array if array.shape[0] >= array.shape[1] else array.T
        for k in range(min(tall.shape[1], 64)):
            columns[f"{name}.{k + 1}"] = tall[:MOST_SAMPLES, k]


def _read_sound(path: Path) -> Columns:
    require_whole(path)
    if remarks := length_remarks(path):
        raise BadInput(remarks[0], "a file whose head is right")
    with without_remarks(path), soundfile.SoundFile(path) as sound:
        if sound.channels < 2:
            raise BadInput("it has one channel", "two or more, command and position")
        most = min(sound.frames, MOST_SAMPLES, MOST_VALUES // sound.channels)
        data = sound.read(most, dtype="float64", always_2d=True)
        if len(data) < most:
            raise BadInput(f"truncated, {len(data)} of {sound.frames} frames are there", "a whole file")
        cut = sound.frames > most
        rate, comment = float(sound.samplerate), sound.comment or ""
    remarks = (f"not applied: its comment {comment[:80]!r}",) if changes_values(comment, comment) else ()
    values = {f"channel{k + 1}": data[:, k] for k in range(data.shape[1])}
    return Columns(values, {"the sound's head (Hz)": rate}, cut=cut, remarks=remarks)


def _read_hdf5(path: Path) -> Columns:
    columns: dict[str, FloatArray] = {}
    units: dict[str, str] = {}
    changed: dict[str, str] = {}
    rates: dict[str, float] = {}
    with opened_hdf5(path) as file:
        attributes = {key: _text(value) for key, value in file.attrs.items()}
        remarks = _rates_and_remarks(file, rates)
        signals, texts = _signals(file)
        _require_room(
            sum(min(max(signal.shape, default=1), MOST_SAMPLES) * _width(signal) for signal in signals.values())
        )
        _require_room(max((math.prod(signal.chunks or ()) for signal in signals.values()), default=0))
        for name, item in signals.items():
            if _width(item) == 1:
                part = item[tuple(slice(MOST_SAMPLES) for _ in item.shape)]
                columns[name] = np.atleast_1d(_filled(part, item).squeeze())
            else:
                tall = item[:MOST_SAMPLES] if item.shape[0] >= item.shape[1] else item[:, :MOST_SAMPLES].T
                for k in range(tall.shape[1]):
                    columns[f"{name}.{k + 1}"] = _filled(tall[:, k], item)
            said = {key: _text(value) for key, value in item.attrs.items()}
            changes = [f"{key} {value}" for key, value in said.items() if changes_values(key, value)]
            for column in (name, *(f"{name}.{k + 1}" for k in range(_width(item)))):
                changed |= dict.fromkeys([column] * bool(changes), ", ".join(changes))
                units |= dict.fromkeys([column] * bool(unit := _one_unit(name, said)), unit)
        cut = any(max(signal.shape, default=1) > MOST_SAMPLES for signal in signals.values())
    read = Columns(columns, rates, units, attributes, cut, remarks, changed=changed)
    return _with_statements(read, texts)


def _rates_and_remarks(file: h5py.File, rates: dict[str, float]) -> tuple[str, ...]:
    """Gather the rates that attributes state, and return what else of groups may change values, and is left out."""
    spare: list[str] = []

    def visit(name: str, item: Any) -> None:
        for key, value in item.attrs.items():
            place = f"{name}.{key}".replace("/", ".").lstrip(".")
            rates.update(rate_said(place, _text(value)))
            if isinstance(item, h5py.Group) and changes_values(key, _text(value)):
                spare.append(f"not applied: {place} {_text(value)}")

    visit("", file)
    file.visititems(visit)
    return () if str(file.attrs.get("format", "")).startswith("tactuator-") else tuple(spare)


def _one_unit(name: str, said: Mapping[str, str]) -> str:
    """Return the unit that the attributes of a data set state. Raises BadInput for two."""
    units = {
        f"{key} of {name!r}": re.split(r"\s+since\s", value)[0]
        for key, value in said.items()
        if _OF_UNIT.fullmatch(key) and value.strip()
    }
    return agreed(units, lambda one, other: (unit_of(one) or one) == (unit_of(other) or other), repr, "one unit") or ""


def _filled(values: Any, item: h5py.Dataset) -> FloatArray:
    """Return numbers with NaN for those that the data set's attributes state to be missing."""
    read = np.array(values, dtype=np.float64, ndmin=1)
    for key in {"_FillValue", "missing_value"} & set(item.attrs):
        kind = item.dtype if item.dtype.kind == "f" else np.float64
        read[np.isin(values, np.atleast_1d(item.attrs[key]).astype(kind))] = np.nan
    return read


def _signals(file: h5py.File) -> tuple[dict[str, h5py.Dataset], dict[str, str]]:
    """Return the file's datasets of numbers in one column, or up to 64, by their names with points for strokes; and its
    short texts, as MATLAB writes them.
    """
    signals: dict[str, h5py.Dataset] = {}
    texts: dict[str, str] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and _text(item.attrs.get("MATLAB_class", "")) == "char":
            if item.dtype.kind == "u" and item.size < _LONGEST_TEXT:
                texts[name.replace("/", ".")] = "".join(map(chr, np.ravel(item[()])))
            return
        if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "fiu" or name.startswith("#"):
            return
        if item.ndim <= 1 or (item.ndim == 2 and min(item.shape) <= 64):
            signals[name.replace("/", ".")] = item

    file.visititems(visit)
    return signals, texts


def _width(item: h5py.Dataset) -> int:
    return min(item.shape) if item.ndim == 2 else 1


def _require_room(values: int) -> None:
    if values > MOST_VALUES:
        raise BadInput(f"it claims to hold {values} numbers", f"up to {MOST_VALUES}")


def _text(value: Any) -> str:
    if isinstance(value, h5py.Empty):
        return ""
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)
