"""Columns of numbers out of foreign files: CSV, MATLAB, WAV, HDF5, in pieces where the format allows it."""

from __future__ import annotations

import codecs
import csv
import io
import itertools
import math
import re
import statistics
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

import h5py
import numpy as np
import scipy
import soundfile
from pydantic_core import from_json

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.hdf5 import opened_hdf5, require_survivable
from tactuator.io.sound import require_whole, without_remarks
from tactuator.io.text import check_commas, decimal_point, encoding_of

_PIECE_CHARACTERS, _LONGEST_LINE = 2_000_000, 1_000_000
_MOST_REMARKS = 100_000
_OF_NUMBERS = b"0123456789.eE+- "


def _windows(error: Any) -> tuple[str, int]:
    """Return what no UTF-8 is as Windows writes it, and where to go on."""
    return error.object[error.start : error.end].decode("cp1252", "replace"), error.end


codecs.register_error("tactuator-windows", _windows)


def read_table(path: Path, most_rows: int, most_values: int) -> tuple[list[str], FloatArray, bool]:
    """Return the names of a text's columns, their values (rows, columns), and True where rows were left unread.

    Beyond most_rows, or most_values of all columns together, nothing is read. What is no number is NaN. Raises
    BadInput, with the reason alone, for a text without rows of numbers or with rows of several lengths.
    """
    with path.open("rb") as file:
        encoding = encoding_of(start := file.read(64))
    if encoding == "utf-8" and b"\0" in start:
        raise BadInput("it is no text", "columns of numbers, as CSV has them")
    with path.open(encoding=encoding, errors="tactuator-windows") as stream:
        rows = (line for line in itertools.islice(_lines(stream), _MOST_REMARKS) if _is_row(line))
        head = list(itertools.islice(rows, 200))
        if not head:
            raise BadInput(f"it is empty, or remarks fill its first {_MOST_REMARKS} lines", "columns of numbers")
        delimiter = _delimiter(head[len(head) // 2])
        names = _header(head[0], delimiter)
        check_commas([cell for line in head for cell in _parts(line, delimiter)])
        stream.seek(0)
        if names is not None:
            next(line for line in _lines(stream) if _is_row(line))
        text = _Text(stream, delimiter, comma=delimiter != "," and "," in "".join(head[1:]))
        blocks, cut = text.blocks(most_rows, most_values)
    table = np.concatenate(blocks) if blocks else np.zeros((0, 0))
    if table.shape[0] == 0:
        raise BadInput("there are no rows of numbers in it", "columns of numbers")
    if names is not None and table.shape[1] == len(names) + 1 and not np.any(np.isfinite(table[:, -1])):
        table = table[:, :-1]
    names = names or [f"column{k + 1}" for k in range(table.shape[1])]
    if len(names) != table.shape[1]:
        raise BadInput(f"{len(names)} names over {table.shape[1]} columns", "a name for each")
    return names, table, cut


def _is_row(line: str) -> bool:
    return bool(line.strip()) and not line.startswith(("#", "%"))


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


class _Text:
    """The rows of a text, after its header. comma: points of its numbers are commas."""

    def __init__(self, stream: TextIO, delimiter: str | None, comma: bool) -> None:
        self._stream, self._delimiter, self._comma = stream, delimiter, comma

    def blocks(self, most_rows: int, most_values: int) -> tuple[list[FloatArray], bool]:
        """Return the rows in blocks, and True where some were left unread."""
        blocks: list[FloatArray] = []
        rows, most = 0, most_rows
        while (piece := self._piece()) and rows <= most:
            block = self._plain(piece)
            block = self._any(piece, rows) if block is None else block
            if block.shape[0] == 0:
                continue
            blocks.append(block)
            rows += block.shape[0]
            if block.shape[1] != blocks[0].shape[1]:
                raise BadInput(f"row {rows} has another number of columns than the first", "as many in each")
            most = min(most_rows, most_values // block.shape[1])
        if rows > most:
            blocks[-1] = blocks[-1][: blocks[-1].shape[0] - (rows - most)]
        return blocks, rows > most

    def _piece(self) -> str:
        """Return the next whole lines; none of them may fill the memory."""
        text = self._stream.read(_PIECE_CHARACTERS)
        rest = self._stream.readline(_LONGEST_LINE) if text and not text.endswith("\n") else ""
        return text + _checked(rest)

    def _plain(self, piece: str) -> FloatArray | None:
        """Return the numbers of a piece that is nothing but numbers and delimiters, as many in each row; else None.

        A reader of JSON takes such numbers, correctly rounded, several times as fast as one of text tables.
        """
        if self._delimiter is None or not piece.isascii():
            return None
        raw = piece.encode("ascii")
        if self._comma:
            raw = raw.replace(b",", b".")
        mark = self._delimiter.encode("ascii")
        raw = raw if raw.endswith(b"\n") else raw + b"\n"
        width = raw[: raw.index(b"\n")].count(mark) + 1
        marks = raw.translate(None, _OF_NUMBERS)
        rows = marks.count(b"\n")
        if marks != (mark * (width - 1) + b"\n") * rows:
            return None
        try:
            cells = from_json(b"[" + raw[:-1].replace(b"\n", b",").replace(mark, b",") + b"]")
            return np.fromiter(cells, np.float64, rows * width).reshape(rows, width)
        except (ValueError, OverflowError):
            return None

    def _any(self, piece: str, before: int) -> FloatArray:
        """Return the rows of any piece of text, after so many rows; what is no number is NaN."""
        lines = [self._clean(line) for line in _lines(io.StringIO(piece)) if _is_row(line)]
        if not lines:
            return np.zeros((0, 0))
        try:
            return np.loadtxt(lines, delimiter=self._delimiter, ndmin=2, comments=None)
        except ValueError:
            rows = [_cells(line, self._delimiter) for line in lines]
            width = statistics.mode(len(row) for row in rows)
            for number, row in enumerate(rows, start=before + 1):
                if len(row) != width:
                    allowed = "as many in each" if np.any(np.isfinite(row)) else "'#' before lines of text"
                    raise BadInput(f"row {number} has {len(row)} of {width} columns", allowed) from None
            return np.array(rows)

    def _clean(self, line: str) -> str:
        if '"' in line:
            return (self._delimiter or " ").join(decimal_point(cell) for cell in _parts(line, self._delimiter)) + "\n"
        return line.replace(",", ".") if self._comma else line


def _lines(stream: TextIO) -> Iterator[str]:
    """Yield lines, none of which may fill the memory."""
    while line := stream.readline(_LONGEST_LINE):
        yield _checked(line)


def _checked(line: str) -> str:
    if len(line) == _LONGEST_LINE:
        raise BadInput(f"a line is longer than {_LONGEST_LINE} characters", "rows of numbers")
    return line


def _parts(line: str, delimiter: str | None) -> list[str]:
    if '"' not in line:
        return [cell.strip() for cell in line.strip().split(delimiter)]
    return [cell.strip() for cell in next(csv.reader([line.strip()], delimiter=delimiter or " "), [])]


def _cells(line: str, delimiter: str | None) -> list[float]:
    cells = []
    for cell in line.strip().split(delimiter):
        try:
            cells.append(float(cell))
        except ValueError:
            cells.append(float("nan"))
    return cells


_LAST_BYTES = 8192
_ROWS_MIN = 40
_NUMBER = re.compile(r"[-+]?\d*[.,](\d+)([eE][-+]?\d+)?\"?")


def last_number_cut_off(path: Path) -> str | None:
    """Return the last number of a text that ends within it, as it stands there; None where nothing tells so.

    Many a whole file lacks the last line's end, and numbers of any length are common. So it takes both: no end of the
    last line, and fewer digits behind the point (and in the exponent) of the last column than in each of the 40 rows or
    more before, where all of those have as many; where they have not, less than half as many.
    """
    with path.open("rb") as file:
        encoding = encoding_of(file.read(64))
        size = file.seek(0, 2)
        file.seek(max(size - _LAST_BYTES, 0) // 4 * 4)  # at a whole character, also of four bytes
        text = file.read().decode(encoding, errors="replace")
    if not text or text[-1].isspace():
        return None
    *before, last = [re.split(r"[,;\t ]+", line.strip())[-1] for line in text.splitlines()[1:]] or [""]
    digits = sorted(map(_digits, before)) or [(0, 0)]
    least = digits[0] if digits[0] == digits[-1] else (digits[0][0] // 2, 0)
    return last if len(before) >= _ROWS_MIN and _digits(last) < least else None


def _digits(cell: str) -> tuple[int, int]:
    """Return the number of digits behind the point and of characters in the exponent; (0, 0) for another text."""
    match = _NUMBER.fullmatch(cell)
    return (0, 0) if match is None else (len(match[1]), len(match[2] or ""))


MOST_SAMPLES = 4_000_000
"""Rows read of one file: 100 MB in memory, whatever the file's length."""
MOST_VALUES = 32_000_000
"""Numbers read of one file, all columns together: 256 MB in memory, whatever the file claims to hold."""


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of a file. values: column name to (n,), all of one length unless the format allows others. rate_hz: of
    the file, if it says.

    attributes: plain text that the file carries. cut: rows beyond MOST_SAMPLES were left unread. remarks: on what is
    amiss and was left out.
    """

    values: Mapping[str, FloatArray]
    rate_hz: float | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    attributes: Mapping[str, str] = field(default_factory=dict)
    cut: bool = False
    remarks: tuple[str, ...] = ()


def read_columns(path: Path) -> Columns:
    """Read a file by its ending: .csv .txt .tsv .dat, .mat, .wav .flac, .h5 .hdf5. BadInput, one line, otherwise."""
    readers = {
        ".csv": _read_text, ".txt": _read_text, ".tsv": _read_text, ".dat": _read_text, ".mat": _read_matlab,
        ".wav": _read_sound, ".flac": _read_sound, ".h5": _read_hdf5, ".hdf5": _read_hdf5,
    }  # fmt: skip
    reader = readers.get(path.suffix.lower())
    if not path.is_file():
        what = "a folder" if path.is_dir() else "there is no such file"
        raise BadInput(f"record {path}: {what}", "one that can be read")
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


def _read_text(path: Path) -> Columns:
    names, table, cut = read_table(path, MOST_SAMPLES, MOST_VALUES)
    last = None if cut else last_number_cut_off(path)
    remarks: tuple[str, ...] = ()
    if last is not None:
        table = table[:-1]
        remarks = (f"the file ends within its last number ({last}, of too few digits): its row is left out",)
    return Columns({name: table[:, k] for k, name in enumerate(names)}, cut=cut, remarks=remarks)


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
