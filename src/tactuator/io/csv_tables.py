"""Small tables as CSV: threshold curves, pairs of a calibration, confusion matrices."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.atomic import write_text
from tactuator.io.text import read_text, table_rows
from tactuator.perception.curve import (
    Provenance,
    RelativeCurve,
    ThresholdCurve,
    curve,
    curve_names,
    level_from_acceleration,
)


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of a calibration. displacement_mm, voltage_v: (n,); names: how each pair is called (its own name column, or
    its row).
    """

    displacement_mm: FloatArray
    voltage_v: FloatArray
    names: list[str]


def read_pairs(path: str | Path) -> Pairs:
    """Read a CSV with columns displacement_mm, voltage_v and, if there is one, name. BadInput, one line, otherwise."""
    path = Path(path)
    try:
        rows = table_rows([line for line in read_text(path).split("\n") if not line.startswith("#")])
    except BadInput as error:
        raise BadInput(f"pairs {path}: {error}", "a CSV file that can be read") from None
    header = [cell.strip().lower() for cell in rows[0]] if rows else []
    for needed in ("displacement_mm", "voltage_v"):
        if needed not in header:
            raise BadInput(f"pairs {path}: there is no column {needed!r}", "displacement_mm,voltage_v[,name]")
    x, v = header.index("displacement_mm"), header.index("voltage_v")
    label = header.index("name") if "name" in header else None
    numbers = [[_number(row, k, path, line) for k in (x, v)] for line, row in enumerate(rows[1:], start=2)]
    table = np.array(numbers, dtype=np.float64).reshape(-1, 2)
    names = [
        row[label].strip() if label is not None and label < len(row) and row[label].strip() else f"row {line}"
        for line, row in enumerate(rows[1:], start=2)
    ]
    return Pairs(table[:, 0], table[:, 1], names)


def _number(row: list[str], column: int, path: Path, line: int) -> float:
    cell = row[column].strip() if column < len(row) else ""
    try:
        value = float(cell)
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise BadInput(f"pairs {path}: row {line} has {cell!r}", "a finite number")
    return value


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


_LEVEL, _ACCELERATION, _ERROR = "level_db_re_1um", "acceleration_m_s2_rms", "standard_error_db"
_NUMBERS = ("frequency_hz", _LEVEL, _ACCELERATION, _ERROR)


def resolve_curve(name_or_path: str, beside: Path = Path()) -> ThresholdCurve:
    """Return the library's curve of that name, or the CSV of that path (relative to the folder `beside`)."""
    if name_or_path in curve_names():
        return curve(name_or_path)
    path = beside / name_or_path
    if path.suffix.lower() != ".csv" and not path.exists():
        raise BadInput(
            f"threshold curve {name_or_path!r} is not in the library", f"{', '.join(curve_names())}, or a CSV file"
        )
    return read_curve(path)


def read_curve(path: str | Path) -> ThresholdCurve:
    """Read a curve; lines `# key: value` of the head give name, provenance and source.

    Raises BadInput for a file that is missing, not a table, or not a curve.
    """
    path = Path(path)
    lines = _lines(path)
    head = _head(lines)
    columns = _columns(path, [line for line in lines if line.strip() and not line.lstrip().startswith("#")])
    frequency = columns["frequency_hz"]
    if _LEVEL in columns:
        level = columns[_LEVEL]
    else:
        positive = np.where(columns[_ACCELERATION] > 0.0, columns[_ACCELERATION], np.nan)
        level = level_from_acceleration(frequency, positive)
    provenance = cast(Provenance, head.get("provenance", "digitised"))
    source = head.get("source", path.name)
    return ThresholdCurve(head.get("name", path.stem), frequency, level, provenance, source, columns.get(_ERROR))


def read_relative_curve(path: str | Path) -> RelativeCurve:
    """Read a curve in dB SL: columns frequency_hz and level_db_sl, others left alone.

    Raises BadInput for a file that is missing, not a table, or not a curve.
    """
    path = Path(path)
    rows = _table(path, [line for line in _lines(path) if not line.lstrip().startswith("#")])
    header = [cell.strip() for cell in rows[0]] if rows else []
    if not {"frequency_hz", "level_db_sl"} <= set(header) or len(rows) < 2:
        raise BadInput(
            f"curve {path}: columns {', '.join(header) or 'nothing'}, {max(len(rows) - 1, 0)} rows",
            "frequency_hz and level_db_sl, one row or more",
        )
    places = [header.index(name) for name in ("frequency_hz", "level_db_sl")]
    try:
        values = np.array([[float(row[place]) for place in places] for row in rows[1:]])
    except (ValueError, IndexError):
        raise BadInput(f"curve {path}: a cell is missing or not a number", "numbers") from None
    return RelativeCurve(values[:, 0], values[:, 1], path.stem)


def _lines(path: Path) -> list[str]:
    try:
        return read_text(path).split("\n")
    except BadInput as error:
        raise BadInput(f"threshold curve {path}: {error}", "a CSV file that can be read") from None


def _table(path: Path, lines: list[str]) -> list[list[str]]:
    try:
        return table_rows(lines)
    except BadInput as error:
        raise error.within(f"threshold curve {path}") from None


def _head(lines: list[str]) -> dict[str, str]:
    pairs = (line.lstrip("# ").split(":", 1) for line in lines if line.startswith("#") and ":" in line)
    found = {key.strip().lower(): value.strip() for key, value in pairs}
    return (
        {key: value for key, value in found.items() if key in ("name", "provenance", "source")}
        if ("name" in found)
        else {}
    )


def _columns(path: Path, rows: list[str]) -> dict[str, np.ndarray[tuple[int], np.dtype[np.float64]]]:
    table = _table(path, rows)
    header = [cell.strip() for cell in table[0]] if table else []
    if "frequency_hz" not in header or not {_LEVEL, _ACCELERATION} & set(header):
        got = ", ".join(header) or "nothing"
        raise BadInput(f"threshold curve {path}: columns {got}", f"frequency_hz and {_LEVEL} (or {_ACCELERATION})")
    if any(len(row) < len(header) for row in table[1:]) or len(table) < 2:
        raise BadInput(f"threshold curve {path}: rows of unequal length", f"{len(header)} cells a row")
    own = [index for index, name in enumerate(header) if name in _NUMBERS]  # others tell how it was measured
    try:
        values = np.array([[float(row[index]) for index in own] for row in table[1:]])
    except ValueError as error:
        raise BadInput(f"threshold curve {path}: {error}", "numbers") from None
    return {header[index]: values[:, place] for place, index in enumerate(own)}


def write_curve(
    path: str | Path, threshold: ThresholdCurve, circumstances: Mapping[str, Sequence[object]] | None = None
) -> None:
    """Write a curve so that `read_curve` gives it back; circumstances as `curve_text` has them."""
    write_text(path, curve_text(threshold, circumstances))


def curve_text(threshold: ThresholdCurve, circumstances: Mapping[str, Sequence[object]] | None = None) -> str:
    """Return the text of a curve's file.

    circumstances: further columns by name, one cell for each point, which tell how the curve was measured.
    """
    errors = threshold.standard_error_db
    columns: dict[str, Sequence[object]] = {
        "frequency_hz": threshold.frequency_hz.tolist(),
        _LEVEL: threshold.level_db_re_1um.tolist(),
        **({} if errors is None else {_ERROR: errors.tolist()}),
        **(circumstances or {}),
    }
    stream = io.StringIO()
    stream.write(f"# name: {threshold.name}\n# provenance: {threshold.provenance}\n# source: {threshold.source}\n")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    return stream.getvalue()
