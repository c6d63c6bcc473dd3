"""Tables in texts: the one reader of CSV and its like, for records, responses, curves, pairs and matrices."""

from __future__ import annotations

import codecs
import csv
import io
import itertools
import re
import statistics
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from pydantic_core import from_json

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.text import encoding_of

_PIECE_CHARACTERS, _LONGEST_LINE = 2_000_000, 1_000_000
_MOST_REMARKS = _MOST_LINES = 100_000
_FIRST_ROWS = 200
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(,\d{3})+")
_OF_NUMBERS = b"0123456789.eE+- "


def _windows(error: Any) -> tuple[str, int]:
    """Return what no UTF-8 is as Windows writes it, and where to go on."""
    return error.object[error.start : error.end].decode("cp1252", "replace"), error.end


codecs.register_error("tactuator-windows", _windows)


def read_table(path: Path, most_rows: int, most_values: int) -> tuple[list[str], FloatArray, bool]:
    """Return the names of a text's columns, their values (rows, columns), and True where rows were left unread.

    The limits are those of `TextTable.numbers`. Raises BadInput, with the reason alone, for a text without rows of
    numbers.
    """
    with path.open("rb") as file:
        encoding = encoding_of(start := file.read(64))
    if encoding == "utf-8" and b"\0" in start:
        raise BadInput("it is no text", "columns of numbers, as CSV has them")
    with path.open(encoding=encoding, errors="tactuator-windows") as stream:
        text = TextTable(stream)
        if text.is_empty:
            raise BadInput(f"it is empty, or remarks fill its first {_MOST_REMARKS} lines", "columns of numbers")
        blocks, cut = text.numbers(most_rows, most_values)
    table = np.concatenate(blocks) if blocks else np.zeros((0, 0))
    if table.shape[0] == 0:
        raise BadInput("there are no rows of numbers in it", "columns of numbers")
    names = text.names
    if names is not None and table.shape[1] == len(names) + 1 and not np.any(np.isfinite(table[:, -1])):
        table = table[:, :-1]
    names = names or [f"column{k + 1}" for k in range(table.shape[1])]
    if len(names) != table.shape[1]:
        raise BadInput(f"{len(names)} names over {table.shape[1]} columns", "a name for each")
    return names, table, cut


class TextTable:
    """A table in a text: remarks, then perhaps a row of names, then rows of cells.

    Lines that begin with # or % are remarks. Cells are parted by tabs, semicolons or commas, whichever half of the
    first rows have, or by blanks; a decimal comma becomes a point. Raises BadInput where the commas may as well
    part thousands.

    Parameters
    ----------
    stream: the text, which can be read again from its beginning.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        rows = (line for line in itertools.islice(_lines(stream), _MOST_REMARKS) if _is_row(line))
        first = list(itertools.islice(rows, _FIRST_ROWS))
        self._delimiter = _delimiter(first)
        check_commas([cell for line in first for cell in _parts(line, self._delimiter)])
        self.is_empty = not first
        self.names = _header(first[0], self._delimiter) if first else None
        self._comma = self._delimiter != "," and "," in "".join(first[1:])

    def rows(self) -> list[list[str]]:
        """Return the cells of all rows, that of the names first. Raises BadInput for more than 100,000 lines."""
        self._stream.seek(0)
        lines = list(itertools.islice(_lines(self._stream), _MOST_LINES + 1))
        if len(lines) > _MOST_LINES:
            raise BadInput(f"it has more than {_MOST_LINES} lines", f"up to {_MOST_LINES}")
        rows = [_parts(line.replace("\0", ""), self._delimiter) for line in lines if _is_row(line)]
        check_commas([cell for row in rows for cell in row])
        return [[decimal_point(cell) for cell in row] for row in rows if any(row)]

    def remarks(self) -> list[str]:
        """Return the lines that begin with #, without it."""
        self._stream.seek(0)
        return [line.lstrip("# ").rstrip() for line in _lines(self._stream) if line.startswith("#")]

    def numbers(self, most_rows: int, most_values: int) -> tuple[list[FloatArray], bool]:
        """Return the rows below the names in blocks, and True where some were left unread.

        Beyond most_rows, or most_values of all columns together, nothing is read. What is no number is NaN. Raises
        BadInput for rows of several lengths.
        """
        self._stream.seek(0)
        if self.names is not None:
            next(line for line in _lines(self._stream) if _is_row(line))
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


def _is_row(line: str) -> bool:
    return not line.lstrip().startswith(("#", "%")) and not line.isspace()


def _delimiter(lines: list[str]) -> str | None:
    """Return the mark between cells that at least half of the lines have, None for blanks; of several, one that the
    first line has: a cell may list words with another, as the fingers of a curve.
    """
    marks = [mark for mark in ("\t", ";", ",") if lines and 2 * sum(mark in line for line in lines) >= len(lines)]
    return next((mark for mark in marks if mark in lines[0]), next(iter(marks), None))


def _header(line: str, delimiter: str | None) -> list[str] | None:
    cells = [cell.strip("'") for cell in _parts(line, delimiter)]
    if cells and not cells[-1]:
        cells.pop()
    if all(re.fullmatch(r"[-+]?[\d.,]+([eE][-+]?\d+)?|nan|NaN|", cell) for cell in cells):
        return None
    return cells


def check_commas(cells: list[str]) -> None:
    """Raise BadInput where the commas within numbers could as well part thousands as decimals."""
    numbers = [cell for cell in cells if re.fullmatch(r"[-+]?[\d,]*,\d+([eE][-+]?\d+)?", cell)]
    if numbers and all(_THOUSANDS.fullmatch(cell) for cell in numbers):
        raise BadInput(f"{numbers[0]!r} may be thousands or a decimal comma", "decimal points")


def decimal_point(cell: str) -> str:
    """Return the cell with a point for the decimal comma of a number; anything else as it is."""
    return cell.replace(",", ".") if re.fullmatch(r"[-+]?\d*,\d+([eE][-+]?\d+)?", cell) else cell


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
    try:
        return [cell.strip() for cell in next(csv.reader([line.strip()], delimiter=delimiter or " "), [])]
    except csv.Error as error:
        raise BadInput(f"{error}", "cells of a table") from None


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
