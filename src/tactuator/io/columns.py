"""Columns of numbers out of foreign files: CSV, MATLAB, WAV, HDF5, in pieces where the format allows it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy
import soundfile

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.hdf5 import opened_hdf5, require_survivable
from tactuator.io.sound import length_remarks, require_whole, without_remarks
from tactuator.io.text import encoding_of
from tactuator.io.text_table import last_number_cut_off, read_table

MOST_SAMPLES = 4_000_000
"""Rows read of one file: 100 MB in memory, whatever the file's length."""
MOST_VALUES = 32_000_000
"""Numbers read of one file, all columns together: 256 MB in memory, whatever the file claims to hold."""


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of a file. values: column name to (n,), all of one length unless the format allows others. rate_hz: of
    the file, if it says. head_hz: of the head over its columns, which may be another than that of what was written.

    attributes: plain text that the file carries. cut: rows beyond MOST_SAMPLES were left unread. remarks: on what is
    amiss and was left out.
    """

    values: Mapping[str, FloatArray]
    rate_hz: float | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    attributes: Mapping[str, str] = field(default_factory=dict)
    cut: bool = False
    remarks: tuple[str, ...] = ()
    head_hz: float | None = None


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
    columns = {name: values[:, k] for k, name in enumerate(table.names)}
    return Columns(columns, units=table.units, cut=table.cut, remarks=remarks, head_hz=table.rate_hz)


def _read_matlab(path: Path) -> Columns:
    if h5py.is_hdf5(path):
        return _read_hdf5(path)
    _require_room(sum(math.prod(shape) for _, shape, _ in scipy.io.whosmat(path)))
    require_survivable(lambda: scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False))
    content = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)
    columns: dict[str, FloatArray] = {}
    for name, value in content.items():
        if not name.startswith("__"):
            _gather(name, value, columns)
    return Columns(columns)


def _gather(name: str, value: Any, columns: dict[str, FloatArray]) -> None:
    """Gather the numbers, rows and columns of a variable; fields of a struct as name.field."""
    if hasattr(value, "_fieldnames"):
        for field_name in value._fieldnames:
            _gather(f"{name}.{field_name}", getattr(value, field_name), columns)
        return
    array = np.asarray(value)
    if array.dtype.kind == "c":
        _gather(f"{name} (real)", array.real, columns)
        _gather(f"{name} (imag)", array.imag, columns)
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
        rate = float(sound.samplerate)
    return Columns({f"channel{k + 1}": data[:, k] for k in range(data.shape[1])}, rate, cut=cut)


def _read_hdf5(path: Path) -> Columns:
    columns: dict[str, FloatArray] = {}
    units: dict[str, str] = {}
    with opened_hdf5(path) as file:
        attributes = {key: _text(value) for key, value in file.attrs.items()}
        signals = _signals(file)
        _require_room(
            sum(min(max(signal.shape, default=1), MOST_SAMPLES) * _width(signal) for signal in signals.values())
        )
        _require_room(max((math.prod(signal.chunks or ()) for signal in signals.values()), default=0))
        for name, item in signals.items():
            if _width(item) == 1:
                part = item[tuple(slice(MOST_SAMPLES) for _ in item.shape)]
                columns[name] = np.atleast_1d(np.asarray(part, dtype=np.float64).squeeze())
            else:
                tall = item[:MOST_SAMPLES] if item.shape[0] >= item.shape[1] else item[:, :MOST_SAMPLES].T
                for k in range(tall.shape[1]):
                    columns[f"{name}.{k + 1}"] = np.asarray(tall[:, k], dtype=np.float64)
            if "unit" in item.attrs:
                units[name] = _text(item.attrs["unit"])
        cut = any(max(signal.shape, default=1) > MOST_SAMPLES for signal in signals.values())
    rate = attributes.get("rate_hz")
    return Columns(columns, float(rate) if rate is not None else None, units, attributes, cut)


def _signals(file: h5py.File) -> dict[str, h5py.Dataset]:
    """Return the file's datasets of numbers in one column, or up to 64, by their names with points for strokes."""
    signals: dict[str, h5py.Dataset] = {}

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "fiu" or name.startswith("#"):
            return
        if item.ndim <= 1 or (item.ndim == 2 and min(item.shape) <= 64):
            signals[name.replace("/", ".")] = item

    file.visititems(visit)
    return signals


def _width(item: h5py.Dataset) -> int:
    return min(item.shape) if item.ndim == 2 else 1


def _require_room(values: int) -> None:
    if values > MOST_VALUES:
        raise BadInput(f"it claims to hold {values} numbers", f"up to {MOST_VALUES}")


def _text(value: Any) -> str:
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)
