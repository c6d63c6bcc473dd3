"""Confusion matrices as CSV: a row a stimulus, a column a response; a header row and a first column of names may be."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.formats.text import read_text, table_rows


@dataclass(frozen=True, eq=False)
class NamedMatrix:
    """A confusion matrix with names. counts: (stimuli, responses). Names are the file's, or 1, 2, 3, ..."""

    counts: FloatArray
    stimuli: tuple[str, ...]
    responses: tuple[str, ...]


def read_matrix(path: str | Path) -> NamedMatrix:
    """Read a matrix; BadInput, one line, where the file cannot be read, is empty, ragged, or holds words for counts."""
    path = Path(path)
    try:
        rows = table_rows([line for line in read_text(path).split("\n") if not line.startswith("#")])
    except BadInput as error:
        raise BadInput(f"matrix {path}: {error}", "a CSV file that can be read") from None
    if not rows:
        raise BadInput(f"matrix {path}: no rows", "a row of counts for each stimulus")
    # A corner that is not a number, over rows that all begin with one or with a name, heads a column of names.
    corner = not rows[0][0] or (not _is_number(rows[0][0]) and len(rows) == len(rows[0]))
    names_across = corner or not all(_is_number(cell) for cell in rows[0][1:])
    header, body = (rows[0], rows[1:]) if names_across else (None, rows)
    names_down = corner or any(not _is_number(row[0]) for row in body)
    if len({len(row) for row in rows}) != 1 or not body:
        raise BadInput(f"matrix {path}: rows of {sorted({len(row) for row in rows})} cells", "rows of equal length")
    first = 1 if names_down else 0
    cells = [row[first:] for row in body]
    for row in cells:
        for cell in row:
            if not _is_number(cell):
                raise BadInput(f"matrix {path}: {cell!r} is not a number", "counts")
    counts = np.array(cells, dtype=np.float64)
    stimuli = tuple(row[0] for row in body) if names_down else _numbered(counts.shape[0])
    responses = tuple(header[first:]) if header is not None else _numbered(counts.shape[1])
    return NamedMatrix(counts, stimuli, responses)


def _numbered(count: int) -> tuple[str, ...]:
    return tuple(str(number + 1) for number in range(count))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
