"""Columns of numbers out of foreign files: CSV, MATLAB, WAV, HDF5, in pieces where the format allows it."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

import h5py
import numpy as np
import scipy.io
import soundfile

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput

MOST_SAMPLES = 4_000_000
"""Rows read of one file: 100 MB in memory, whatever the file's length."""
_PIECE_ROWS = 200_000


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of a file. values: column name to (n,), all of one length unless the format allows others. rate_hz: of
    the file, if it says.

    attributes: plain text that the file carries. cut: rows beyond MOST_SAMPLES were left unread.
    """

    values: Mapping[str, FloatArray]
    rate_hz: float | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    attributes: Mapping[str, str] = field(default_factory=dict)
    cut: bool = False


def read_columns(path: Path) -> Columns:
    """Read a file by its ending: .csv .txt .tsv .dat, .mat, .wav .flac, .h5 .hdf5. BadInput, one line, otherwise."""
    readers = {
        ".csv": _read_text, ".txt": _read_text, ".tsv": _read_text, ".dat": _read_text, ".mat": _read_matlab,
        ".wav": _read_sound, ".flac": _read_sound, ".h5": _read_hdf5, ".hdf5": _read_hdf5,
    }  # fmt: skip
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise BadInput(f"record {path}: ending {path.suffix!r}; allowed: {', '.join(readers)}")
    if not path.is_file():
        raise BadInput(f"record {path}: there is no such file; allowed: one that can be read")
    try:
        columns = reader(path)
    except BadInput as error:
        raise BadInput(f"record {path}: {error}") from None
    except (OSError, ValueError, LookupError, TypeError, soundfile.LibsndfileError, NotImplementedError) as error:
        raise BadInput(f"record {path}: {str(error).splitlines()[0] if str(error) else 'cannot be read'}") from None
    if not columns.values:
        raise BadInput(f"record {path}: there are no numbers in it; allowed: columns of numbers")
    return columns


def _read_text(path: Path) -> Columns:
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        head = [line for line in itertools.islice(stream, 200) if line.strip() and not line.startswith(("#", "%"))]
        if not head:
            raise BadInput("it is empty; allowed: columns of numbers")
        delimiter = _delimiter(head[min(1, len(head) - 1)])
        names = _header(head[0], delimiter)
        stream.seek(0)
        blocks, cut = _blocks(stream, delimiter, names is not None, comma=delimiter == ";" and "," in "".join(head[1:]))
    table = np.concatenate(blocks) if blocks else np.zeros((0, 0))
    if table.shape[0] == 0:
        raise BadInput("there are no rows of numbers in it; allowed: columns of numbers")
    if names is not None and table.shape[1] == len(names) + 1 and not np.any(np.isfinite(table[:, -1])):
        table = table[:, :-1]
    names = names or [f"column{k + 1}" for k in range(table.shape[1])]
    if len(names) != table.shape[1]:
        raise BadInput(f"{len(names)} names over {table.shape[1]} columns; allowed: a name for each")
    return Columns({name: table[:, k] for k, name in enumerate(names)}, cut=cut)


def _delimiter(line: str) -> str | None:
    for mark in ("\t", ";", ","):
        if mark in line:
            return mark
    return None


def _header(line: str, delimiter: str | None) -> list[str] | None:
    cells = [cell.strip().strip('"').strip("'") for cell in line.strip().split(delimiter)]
    if cells and not cells[-1]:
        cells.pop()
    if all(re.fullmatch(r"[-+]?[\d.,]+([eE][-+]?\d+)?|nan|NaN|", cell) for cell in cells):
        return None
    return cells


def _blocks(stream: TextIO, delimiter: str | None, header: bool, comma: bool) -> tuple[list[FloatArray], bool]:
    def clean() -> Iterator[str]:
        skip = header
        for line in stream:
            if not line.strip() or line.startswith(("#", "%")):
                continue
            if skip:
                skip = False
                continue
            yield line.replace(",", ".") if comma else line

    lines, rows = clean(), 0
    blocks: list[FloatArray] = []
    while rows < MOST_SAMPLES:
        piece = list(itertools.islice(lines, _PIECE_ROWS))
        if not piece:
            return blocks, False
        blocks.append(_parse(piece, delimiter, rows))
        rows += len(piece)
    return blocks, next(lines, None) is not None


def _parse(lines: list[str], delimiter: str | None, before: int) -> FloatArray:
    try:
        return np.loadtxt(lines, delimiter=delimiter, ndmin=2, comments=None)
    except ValueError:
        rows = [_cells(line, delimiter) for line in lines]
        width = max(len(row) for row in rows)
        for number, row in enumerate(rows):
            if len(row) != width:
                raise BadInput(
                    f"row {before + number + 1} has {len(row)} of {width} columns; allowed: all of them"
                ) from None
        return np.array(rows)


def _cells(line: str, delimiter: str | None) -> list[float]:
    made = []
    for cell in line.strip().split(delimiter):
        try:
            made.append(float(cell))
        except ValueError:
            made.append(float("nan"))
    return made


def _read_matlab(path: Path) -> Columns:
    if h5py.is_hdf5(path):
        return _read_hdf5(path)
    content = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)
    found: dict[str, FloatArray] = {}
    for name, value in content.items():
        if not name.startswith("__"):
            _gather(name, value, found)
    return Columns(found)


def _gather(name: str, value: Any, found: dict[str, FloatArray]) -> None:
    """Gather the numbers, rows and columns of a variable; fields of a struct as name.field."""
    if hasattr(value, "_fieldnames"):
        for field_name in value._fieldnames:
            _gather(f"{name}.{field_name}", getattr(value, field_name), found)
        return
    array = np.asarray(value)
    if array.dtype.kind not in "fiub":
        return
    array = np.asarray(array, dtype=np.float64)
    if array.ndim <= 1:
        found[name] = np.atleast_1d(array)[:MOST_SAMPLES]
    elif array.ndim == 2:
        tall = array if array.shape[0] >= array.shape[1] else array.T
        for k in range(min(tall.shape[1], 64)):
            found[f"{name}.{k + 1}"] = tall[:MOST_SAMPLES, k]


def _read_sound(path: Path) -> Columns:
    with soundfile.SoundFile(path) as sound:
        if sound.channels < 2:
            raise BadInput("it has one channel; allowed: two or more, command and position")
        data = sound.read(MOST_SAMPLES, dtype="float64", always_2d=True)
        cut = sound.frames > MOST_SAMPLES
        rate = float(sound.samplerate)
    return Columns({f"channel{k + 1}": data[:, k] for k in range(data.shape[1])}, rate, cut=cut)


def _read_hdf5(path: Path) -> Columns:
    found: dict[str, FloatArray] = {}
    units: dict[str, str] = {}
    cut = False
    with h5py.File(path, "r") as file:
        attributes = {key: _text(value) for key, value in file.attrs.items()}

        def visit(name: str, item: Any) -> None:
            nonlocal cut
            if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "fiu" or name.startswith("#"):
                return
            longest = max(item.shape, default=1)
            cut = cut or longest > MOST_SAMPLES
            plain = name.replace("/", ".")
            if len(item.shape) <= 1:
                found[plain] = np.atleast_1d(
                    np.asarray(item[:MOST_SAMPLES] if item.shape else item[()], dtype=np.float64)
                )
            elif len(item.shape) == 2 and min(item.shape) == 1:
                found[plain] = np.asarray(item[...], dtype=np.float64).ravel()[:MOST_SAMPLES]
            elif len(item.shape) == 2 and min(item.shape) <= 64:
                tall = item[:MOST_SAMPLES] if item.shape[0] >= item.shape[1] else item[:, :MOST_SAMPLES].T
                for k in range(tall.shape[1]):
                    found[f"{plain}.{k + 1}"] = np.asarray(tall[:, k], dtype=np.float64)
            if "unit" in item.attrs:
                units[plain] = _text(item.attrs["unit"])

        file.visititems(visit)
    rate = attributes.get("rate_hz")
    return Columns(found, float(rate) if rate is not None else None, units, attributes, cut)


def _text(value: Any) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)
