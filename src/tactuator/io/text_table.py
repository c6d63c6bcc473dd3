"""Tables in texts: the one reader of CSV and its like, for records, responses, curves, pairs and matrices."""

from __future__ import annotations

import codecs
import io
import itertools
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from pydantic_core import from_json

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.cells import cell_pair, cell_value, check_commas, decimal_point, is_comment, is_nearly_number, parts
from tactuator.io.table_layout import DELIMITERS, Layout, find_layout
from tactuator.io.text import encoding_of

LARGEST_BYTES = 2 << 30
"""Size of a text whose table is read: it takes minutes, and holds more rows than are kept."""
_PIECE_CHARACTERS, _LONGEST_LINE = 2_000_000, 1_000_000
_MOST_REMARKS = _MOST_LINES = 100_000
_FIRST_ROWS, _FIRST_LINES = 200, 600
_FEW_LINES, _FIRST_CHARACTERS = 20, 200_000
"""Lines in which the layout is sought at least, and the characters after which no more are."""
_OF_NUMBERS = b"0123456789.eE+- "


def _windows(error: Any) -> tuple[str, int]:
    """Return what no UTF-8 is as Windows writes it, and where to go on."""
    return error.object[error.start : error.end].decode("cp1252", "replace"), error.end


codecs.register_error("tactuator-windows", _windows)


@dataclass(frozen=True, eq=False)
class Table:
    """Numbers of a text. values: (rows, columns); names, units: of the columns; cut: rows were left unread; footer: the
    first line of text below the rows; head_hz, changes: what its head states, as a `Layout` has it.
    """

    names: tuple[str, ...]
    values: FloatArray
    units: Mapping[str, str]
    cut: bool
    footer: str = ""
    head_hz: Mapping[str, float] = field(default_factory=dict)
    changes: tuple[str, ...] = ()


def read_table(path: Path, most_rows: int, most_values: int) -> Table:
    """Return the table in a text, under whatever head.

    Beyond most_rows, or most_values of all columns together, nothing is read. Raises BadInput, with the reason alone,
    for a text without rows of numbers.
    """
    if (size := path.stat().st_size) > LARGEST_BYTES:
        raise BadInput(f"it has {size / 2**30:.1f} GiB", "up to 2 GiB (a part of it, or HDF5)")
    with path.open("rb") as file:
        encoding = encoding_of(start := file.read(64))
    if encoding == "utf-8" and b"\0" in start:
        raise BadInput("it is no text", "columns of numbers, as CSV has them")
    with path.open(encoding=encoding, errors="tactuator-windows") as stream:
        lines = _first_lines(stream)
        if all(line.isspace() or is_comment(line, ";") for line in lines):
            raise BadInput(f"it is empty, or remarks fill its first {_MOST_REMARKS} lines", "columns of numbers")
        layout = find_layout(lines, path.suffix.lower())
        if layout is None:
            raise BadInput(
                "there are no rows of numbers in it", "rows as 0.001,1.5,0.2 below time_s,command_v,position_v"
            )
        rows = _Rows(stream, layout)
        blocks, cut = rows.numbers(most_rows, most_values)
    table = np.concatenate(blocks)
    place_of = {name: k for k, name in reversed(list(enumerate(layout.names)))}
    kept = [k for k in range(len(layout.names)) if not _is_nothing_new(k, layout.names, place_of, table)]
    return Table(
        tuple(layout.names[k] for k in kept),
        table[:, kept],
        layout.units,
        cut,
        rows.footer,
        layout.head_hz,
        layout.changes,
    )


def _is_nothing_new(place: int, names: tuple[str, ...], place_of: Mapping[str, int], table: FloatArray) -> bool:
    """Return whether a column is without a name and empty, or the same as another of its name, as a second time is."""
    stem, _, number = names[place].rpartition(".")
    if number.isdigit() and place_of.get(stem, place) < place:
        return np.array_equal(table[:, place], table[:, place_of[stem]])
    return names[place] == f"column{place + 1}" and not np.isfinite(table[:, place]).any()


def _first_lines(stream: TextIO) -> list[str]:
    """Return the first lines, so many that some hundred of them are no remarks; fewer where they are long."""
    lines, rows, characters = [], 0, 0
    for line in itertools.islice(_lines(stream), _MOST_REMARKS):
        lines.append(line)
        if not line.isspace() and not is_comment(line, ";"):
            rows, characters = rows + 1, characters + len(line)
        if rows == _FIRST_LINES or (rows >= _FEW_LINES and characters > _FIRST_CHARACTERS):
            break
    return lines


class TextTable:
    """A small table in a text: remarks, a row of names, then rows of cells.

    Cells are parted by tabs, semicolons or commas, whichever half of the first rows have, or by blanks; a decimal comma
    becomes a point. Raises BadInput where the commas may as well part thousands.

    Parameters
    ----------
    stream: the text, which can be read again from its beginning.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        rows = (line for line in itertools.islice(_lines(stream), _MOST_REMARKS) if _is_row(line))
        first = list(itertools.islice(rows, _FIRST_ROWS))
        self._delimiter = _delimiter(first)
        check_commas([cell for line in first for cell in parts(line, self._delimiter)])

    def rows(self) -> list[list[str]]:
        """Return the cells of all rows, that of the names first. Raises BadInput for more than 100,000 lines."""
        self._stream.seek(0)
        lines = list(itertools.islice(_lines(self._stream), _MOST_LINES + 1))
        if len(lines) > _MOST_LINES:
            raise BadInput(f"it has more than {_MOST_LINES} lines", f"up to {_MOST_LINES}")
        rows = [parts(line.replace("\0", ""), self._delimiter) for line in lines if _is_row(line)]
        check_commas([cell for row in rows for cell in row])
        return [[decimal_point(cell) for cell in row] for row in rows if any(row)]

    def remarks(self) -> list[str]:
        """Return the lines that begin with #, without it."""
        self._stream.seek(0)
        return [line.lstrip("# ").rstrip() for line in _lines(self._stream) if line.startswith("#")]


def _is_row(line: str) -> bool:
    return not line.lstrip().startswith(("#", "%")) and not line.isspace()


def _delimiter(lines: list[str]) -> str | None:
    """Return the mark between cells that at least half of the lines have, None for blanks; of several, one that the
    first line has: a cell may list words with another, as the fingers of a curve.
    """
    marks = [mark for mark in DELIMITERS if mark and lines and 2 * sum(mark in line for line in lines) >= len(lines)]
    return next((mark for mark in marks if mark in lines[0]), next(iter(marks), None))


class _Rows:
    """The rows of numbers of a text, read in pieces."""

    def __init__(self, stream: TextIO, layout: Layout) -> None:
        self._stream = stream
        self._layout = layout
        self.footer = ""

    def numbers(self, most_rows: int, most_values: int) -> tuple[list[FloatArray], bool]:
        """Return the rows in blocks, and True where some were left unread. What is no number is NaN. Raises BadInput
        for rows of several lengths.
        """
        self._stream.seek(0)
        for _ in range(self._layout.head):
            self._stream.readline(_LONGEST_LINE)
        blocks: list[FloatArray] = []
        columns = len(self._layout.names)
        rows, most = 0, min(most_rows, most_values // columns)
        while rows <= most and (piece := self._piece()):
            block = self._plain(piece)
            block = self._any(piece, rows) if block is None else block
            if block.shape[0] == 0:
                continue
            if block.shape[1] != columns:
                got = f"row {rows + 1} has {block.shape[1]} of {columns} columns"
                raise BadInput(got, f"as many in each ({', '.join(self._layout.names[:6])})")
            blocks.append(block)
            rows += block.shape[0]
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
        delimiter = self._layout.delimiter
        if delimiter is None or self._layout.pairs or not piece.isascii():
            return None
        raw = piece.encode("ascii")
        if self._layout.has_decimal_commas:
            raw = raw.replace(b",", b".")
        mark = delimiter.encode("ascii")
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
        lines = [line for line in _lines(io.StringIO(piece)) if self._layout.is_row(line)]
        if not lines:
            return np.zeros((0, 0))
        if not self._layout.pairs and '"' not in piece:
            plain = [line.replace(",", ".") for line in lines] if self._layout.has_decimal_commas else lines
            with suppress(ValueError):
                return np.loadtxt(plain, delimiter=self._layout.delimiter, ndmin=2, comments=None)
        rows: list[list[float]] = []
        for place, line in enumerate(lines):
            if self._is_text(line) and all(map(self._is_text, lines[place:])) and not self._stream.read(1):
                self.footer = line.strip()[:40]
                break
            rows.append(self._row(line, before + place + 1))
        return np.array(rows) if rows else np.zeros((0, 0))

    def _is_text(self, line: str) -> bool:
        cells = self._layout.cells(line)
        return len(cells) != self._layout.width and all(cell_value(cell) is None for cell in cells)

    def _row(self, line: str, number: int) -> list[float]:
        """Return the numbers of a line. Raises BadInput for another number of cells than a row has, and for a cell of
        digits and marks that is no number.
        """
        cells, width = self._layout.cells(line), self._layout.width
        if len(cells) != width:
            is_text = all(cell_value(cell) is None for cell in cells)
            named = f"as many in each ({', '.join(self._layout.names[:6])}; a cell without a number stays empty)"
            allowed = "'#' before lines of text" if is_text else named
            raise BadInput(f"row {number} has {len(cells)} of {width} columns", allowed)
        values: list[float] = []
        for place, cell in enumerate(cells):
            if place in self._layout.pairs:
                values += cell_pair(cell) or (float("nan"), float("nan"))
                continue
            value = cell_value(cell)
            if value is None and is_nearly_number(cell):
                name = self._layout.names[len(values)]
                raise BadInput(f"{cell!r} in row {number} of {name} is no number", "digits with one decimal point")
            values.append(float("nan") if value is None else value)
        return values


def _lines(stream: TextIO) -> Iterator[str]:
    """Yield lines, none of which may fill the memory."""
    while line := stream.readline(_LONGEST_LINE):
        yield _checked(line)


def _checked(line: str) -> str:
    if len(line) == _LONGEST_LINE:
        raise BadInput(f"a line is longer than {_LONGEST_LINE} characters", "rows of numbers")
    return line


_LAST_BYTES = 8192
_ROWS_MIN = 40
_NUMBER = re.compile(r"[-+]?\d*[.,](\d+)([eE][-+]?\d+)?\"?")


def last_number_cut_off(path: Path) -> str | None:
    """Return the last number of a text that ends within it, as written there, or None.

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
