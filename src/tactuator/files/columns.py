"""Columns of numbers out of foreign files: CSV, MATLAB, WAV, HDF5, in pieces where the format allows it."""

from __future__ import annotations

import csv
import itertools
import math
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
from tactuator.files.formats.hdf5 import opened_hdf5, require_survivable
from tactuator.files.formats.sound import require_whole
from tactuator.files.formats.text import check_commas, decimal_point, encoding_of

MOST_SAMPLES = 4_000_000
"""Rows read of one file: 100 MB in memory, whatever the file's length."""
MOST_VALUES = 32_000_000
"""Numbers read of one file, all columns together: 256 MB in memory, whatever the file claims to hold."""
_PIECE_ROWS, _PIECE_CHARACTERS, _LONGEST_LINE = 200_000, 8_000_000, 1_000_000


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
    except MemoryError:
        raise BadInput(f"record {path}: it claims more than memory holds; allowed: a shorter one") from None
    except Exception as error:  # a library that reads a broken file of others may raise anything at all
        reason = str(error).splitlines()[0].rstrip(".") if str(error) else "cannot be read"
        raise BadInput(f"record {path}: {reason}; allowed: a sound file") from None
    if not columns.values:
        raise BadInput(f"record {path}: there are no numbers in it; allowed: columns of numbers")
    return columns


def _read_text(path: Path) -> Columns:
    with path.open("rb") as file:
        encoding = encoding_of(file.read(64))
    with path.open(encoding=encoding, errors="replace") as stream:
        head = [line for line in itertools.islice(_lines(stream), 200) if line.strip() and line[0] not in "#%"]
        if not head:
            raise BadInput("it is empty; allowed: columns of numbers")
        delimiter = _delimiter(head[min(1, len(head) - 1)])
        names = _header(head[0], delimiter)
        stream.seek(0)
        check_commas([cell for line in head for cell in _parts(line, delimiter)])
        blocks, cut = _blocks(stream, delimiter, names is not None, comma=delimiter != "," and "," in "".join(head[1:]))
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
    cells = [cell.strip("'") for cell in _parts(line, delimiter)]
    if cells and not cells[-1]:
        cells.pop()
    if all(re.fullmatch(r"[-+]?[\d.,]+([eE][-+]?\d+)?|nan|NaN|", cell) for cell in cells):
        return None
    return cells


def _blocks(stream: TextIO, delimiter: str | None, header: bool, comma: bool) -> tuple[list[FloatArray], bool]:
    def clean() -> Iterator[str]:
        skip = header
        for line in _lines(stream):
            if not line.strip() or line.startswith(("#", "%")):
                continue
            if skip:
                skip = False
                continue
            if '"' in line:
                yield (delimiter or " ").join(decimal_point(cell) for cell in _parts(line, delimiter)) + "\n"
            else:
                yield line.replace(",", ".") if comma else line

    lines, rows = clean(), 0
    blocks: list[FloatArray] = []
    most = MOST_SAMPLES
    while rows < most:
        piece = _piece(lines, min(_PIECE_ROWS, most - rows))
        if not piece:
            return blocks, False
        blocks.append(_parse(piece, delimiter, rows))
        rows += len(piece)
        if blocks[-1].shape[1] != blocks[0].shape[1]:
            raise BadInput(f"row {rows} has another number of columns than the first; allowed: as many in each")
        most = min(MOST_SAMPLES, MOST_VALUES // blocks[0].shape[1])
    return blocks, next(lines, None) is not None


def _lines(stream: TextIO) -> Iterator[str]:
    """Yield lines, none of which may fill the memory."""
    while line := stream.readline(_LONGEST_LINE):
        if len(line) == _LONGEST_LINE:
            raise BadInput(f"a line is longer than {_LONGEST_LINE} characters; allowed: rows of numbers")
        yield line


def _piece(lines: Iterator[str], most_rows: int) -> list[str]:
    made, characters = [], 0
    for line in itertools.islice(lines, most_rows):
        made.append(line)
        characters += len(line)
        if characters > _PIECE_CHARACTERS:
            break
    return made


def _parts(line: str, delimiter: str | None) -> list[str]:
    """Return the cells of a line, those in quotation marks without them."""
    if '"' not in line:
        return [cell.strip() for cell in line.strip().split(delimiter)]
    return [cell.strip() for cell in next(csv.reader([line.strip()], delimiter=delimiter or " "), [])]


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
    _require_room(sum(math.prod(shape) for _, shape, _ in scipy.io.whosmat(path)))
    require_survivable(lambda: scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False))
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
    require_whole(path)
    with soundfile.SoundFile(path) as sound:
        if sound.channels < 2:
            raise BadInput("it has one channel; allowed: two or more, command and position")
        most = min(sound.frames, MOST_SAMPLES, MOST_VALUES // sound.channels)
        data = sound.read(most, dtype="float64", always_2d=True)
        if len(data) < most:
            raise BadInput(f"truncated, {len(data)} of {sound.frames} frames are there; allowed: a whole file")
        cut = sound.frames > most
        rate = float(sound.samplerate)
    return Columns({f"channel{k + 1}": data[:, k] for k in range(data.shape[1])}, rate, cut=cut)


def _read_hdf5(path: Path) -> Columns:
    found: dict[str, FloatArray] = {}
    units: dict[str, str] = {}
    with opened_hdf5(path) as file:
        attributes = {key: _text(value) for key, value in file.attrs.items()}
        signals = _signals(file)
        _require_room(sum(min(max(one.shape, default=1), MOST_SAMPLES) * _width(one) for one in signals.values()))
        _require_room(max((math.prod(one.chunks or ()) for one in signals.values()), default=0))
        for name, item in signals.items():
            if _width(item) == 1:
                part = item[tuple(slice(MOST_SAMPLES) for _ in item.shape)]
                found[name] = np.atleast_1d(np.asarray(part, dtype=np.float64).squeeze())
            else:
                tall = item[:MOST_SAMPLES] if item.shape[0] >= item.shape[1] else item[:, :MOST_SAMPLES].T
                for k in range(tall.shape[1]):
                    found[f"{name}.{k + 1}"] = np.asarray(tall[:, k], dtype=np.float64)
            if "unit" in item.attrs:
                units[name] = _text(item.attrs["unit"])
        cut = any(max(one.shape, default=1) > MOST_SAMPLES for one in signals.values())
    rate = attributes.get("rate_hz")
    return Columns(found, float(rate) if rate is not None else None, units, attributes, cut)


def _signals(file: h5py.File) -> dict[str, h5py.Dataset]:
    """Return the file's datasets of numbers in one column, or up to 64, by their names with points for strokes."""
    found: dict[str, h5py.Dataset] = {}

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "fiu" or name.startswith("#"):
            return
        if item.ndim <= 1 or (item.ndim == 2 and min(item.shape) <= 64):
            found[name.replace("/", ".")] = item

    file.visititems(visit)
    return found


def _width(item: h5py.Dataset) -> int:
    return min(item.shape) if item.ndim == 2 else 1


def _require_room(values: int) -> None:
    if values > MOST_VALUES:
        raise BadInput(f"it claims to hold {values} numbers; allowed: up to {MOST_VALUES}")


def _text(value: Any) -> str:
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)
