"""Columns of numbers in text files: CSV and its relatives, read piece by piece."""

from __future__ import annotations

import csv
import io
import itertools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

import numpy as np
from pydantic_core import from_json

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.formats.text import check_commas, decimal_point, encoding_of

_PIECE_CHARACTERS, _LONGEST_LINE = 2_000_000, 1_000_000
_MOST_REMARKS = 100_000
_OF_NUMBERS = b"0123456789.eE+- "


def read_table(path: Path, most_rows: int, most_values: int) -> tuple[list[str], FloatArray, bool]:
    """Return the names of a text's columns, their values (rows, columns), and True where rows were left unread.

    Beyond most_rows, or most_values of all columns together, nothing is read. What is no number is NaN. Raises
    BadInput, with the reason alone, for a text without rows of numbers or with rows of several lengths.
    """
    with path.open("rb") as file:
        encoding = encoding_of(file.read(64))
    with path.open(encoding=encoding, errors="replace") as stream:
        rows = (line for line in itertools.islice(_lines(stream), _MOST_REMARKS) if _is_row(line))
        head = list(itertools.islice(rows, 200))
        if not head:
            raise BadInput(f"it is empty, or remarks fill its first {_MOST_REMARKS} lines", "columns of numbers")
        delimiter = _delimiter(head[min(1, len(head) - 1)])
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
            width = max(len(row) for row in rows)
            for number, row in enumerate(rows):
                if len(row) != width:
                    raise BadInput(
                        f"row {before + number + 1} has {len(row)} of {width} columns", "all of them"
                    ) from None
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
    """Return the cells of a line, those in quotation marks without them."""
    if '"' not in line:
        return [cell.strip() for cell in line.strip().split(delimiter)]
    return [cell.strip() for cell in next(csv.reader([line.strip()], delimiter=delimiter or " "), [])]


def _cells(line: str, delimiter: str | None) -> list[float]:
    made = []
    for cell in line.strip().split(delimiter):
        try:
            made.append(float(cell))
        except ValueError:
            made.append(float("nan"))
    return made
