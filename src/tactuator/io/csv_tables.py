"""Small tables as CSV: threshold curves, equal-strength contours, pairs of a calibration, confusion matrices."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, within
from tactuator.io.atomic import write_text
from tactuator.io.kinds import require_kind
from tactuator.io.text import read_text, table_rows
from tactuator.parameters import from_table, parameters
from tactuator.perception.contours import REFERENCE_HZ, Contours
from tactuator.perception.curve import (
    Contact,
    Provenance,
    RelativeCurve,
    ThresholdCurve,
    curve,
    curve_names,
    level_from_acceleration,
)

_LEVEL, _ACCELERATION, _ERROR = "level_db_re_1um", "acceleration_m_s2_rms", "standard_error_db"
_NUMBERS = ("frequency_hz", _LEVEL, _ACCELERATION, _ERROR)


@contextmanager
def _read(kind: str, path: Path) -> Iterator[tuple[list[str], list[list[str]]]]:
    """Yield the lines and the rows of a CSV; what is refused within tells the kind and the file."""
    with within(f"{kind} {path}"):
        try:
            lines = read_text(path).split("\n")
        except BadInput as error:
            raise BadInput(f"{error}", "a CSV file that can be read") from None
        yield lines, table_rows([line for line in lines if line.strip() and not line.lstrip().startswith("#")])


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def _columns(rows: list[list[str]], names: Sequence[str]) -> dict[str, FloatArray]:
    """Return the columns of those names that are there, (n,) each. Raises BadInput for rows that have not all."""
    places = {name: rows[0].index(name) for name in names if name in rows[0]}
    columns: dict[str, list[float]] = {name: [] for name in places}
    for row in rows[1:]:
        for name, place in places.items():
            value = _number(row[place]) if place < len(row) else None
            if value is None:
                got = repr(row[place]) if place < len(row) else "missing"
                raise BadInput(f"{name} is {got} in a row", "a number in each")
            columns[name].append(value)
    return {name: np.array(column) for name, column in columns.items()}


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
    require_kind(path, "curve")
    with _read("threshold curve", path) as (lines, rows):
        header = rows[0] if rows else []
        if "frequency_hz" not in header or not {_LEVEL, _ACCELERATION} & set(header):
            allowed = f"frequency_hz and {_LEVEL} (or {_ACCELERATION})"
            raise BadInput(f"columns {', '.join(header) or 'nothing'}", allowed)
        if any(len(row) < len(header) for row in rows[1:]) or len(rows) < 2:
            raise BadInput("rows of unequal length", f"{len(header)} cells a row")
        columns = _columns(rows, _NUMBERS)
    level = columns.get(_LEVEL)
    if level is None:
        positive = np.where(columns[_ACCELERATION] > 0.0, columns[_ACCELERATION], np.nan)
        level = level_from_acceleration(columns["frequency_hz"], positive)
    head = _head(lines)
    return ThresholdCurve(
        head.get("name", path.stem),
        columns["frequency_hz"],
        level,
        cast(Provenance, head.get("provenance", ThresholdCurve.provenance)),
        head.get("source", path.name),
        columns.get(_ERROR),
        _contact(head, path),
    )


def _head(lines: Sequence[str]) -> dict[str, str]:
    """Return the lines `# key: value` of a head that tells a name, by key; nothing of another head."""
    pairs = (line.lstrip("# ").split(":", 1) for line in lines if line.startswith("#") and ":" in line)
    head = {key.strip().lower(): value.strip() for key, value in pairs}
    return head if "name" in head else {}


def _contact(head: Mapping[str, str], path: Path) -> Contact:
    """Return where a file's head says that it was felt. Raises BadInput for what is no number."""
    stated: dict[str, object] = {key: head[key] for key in parameters(Contact) if head.get(key)}
    for key in {"area_mm2", "preload_n"} & set(stated):
        number = _number(head[key])
        stated[key] = head[key] if number is None else number
    if "age_years" in stated:
        stated["age_years"] = tuple(_number(word) for word in head["age_years"].split(" to "))
    return from_table(Contact, stated, f"{path}")


def _head_text(noun: ThresholdCurve | Contours) -> str:
    stated = {"name": noun.name, "provenance": noun.provenance, "source": noun.source}
    for key in parameters(Contact):
        value = getattr(noun.contact, key)
        if isinstance(value, tuple):
            stated[key] = f"{value[0]:g} to {value[1]:g}"
        elif value not in (None, ""):
            stated[key] = f"{value}"
    return "".join(f"# {key}: {value}\n" for key, value in stated.items())


def read_relative_curve(path: str | Path) -> RelativeCurve:
    """Read a curve in dB SL: columns frequency_hz and level_db_sl, others left alone.

    Raises BadInput for a file that is missing, not a table, or not a curve.
    """
    path, names = Path(path), ("frequency_hz", "level_db_sl")
    require_kind(path, "loss")
    with _read("curve", path) as (_, rows):
        if not rows or not set(names) <= set(rows[0]) or len(rows) < 2:
            got = f"columns {', '.join(rows[0]) if rows else 'nothing'}, {max(len(rows) - 1, 0)} rows"
            raise BadInput(got, f"{' and '.join(names)}, one row or more")
        columns = _columns(rows, names)
    return RelativeCurve(columns["frequency_hz"], columns["level_db_sl"], path.stem)


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
    stream.write(_head_text(threshold))
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    return stream.getvalue()


_CONTOUR_COLUMNS = ("level_db_sl", "frequency_hz", "db_sl", "low_db_sl", "high_db_sl")


def read_contours(path: str | Path) -> Contours:
    """Read equal-strength contours, a row for each contour and frequency.

    Columns: level_db_sl (at the reference frequency), frequency_hz, db_sl, and perhaps low_db_sl and high_db_sl. Lines
    `# key: value` of the head give name, provenance, source, reference_hz, and where it was felt.

    Raises BadInput for a file that is missing, not a table, without a level for each contour and frequency, or none.
    """
    path = Path(path)
    require_kind(path, "contours")
    with _read("contours", path) as (lines, rows):
        header = rows[0] if rows else []
        if not set(_CONTOUR_COLUMNS[:3]) <= set(header) or len(rows) < 2:
            got = f"columns {', '.join(header) or 'nothing'}, {max(len(rows) - 1, 0)} rows"
            raise BadInput(got, f"{', '.join(_CONTOUR_COLUMNS[:3])}, a row for each contour and frequency")
        columns = _columns(rows, _CONTOUR_COLUMNS)
        level, row = np.unique(columns["level_db_sl"], return_inverse=True)
        frequency, column = np.unique(columns["frequency_hz"], return_inverse=True)
        cells = level.size * frequency.size
        if row.size != cells or np.unique(row * frequency.size + column).size != cells:
            got = f"{row.size} rows for {level.size} contours and {frequency.size} frequencies"
            raise BadInput(got, "each contour at each frequency, once")
        tables = {name: np.zeros((level.size, frequency.size)) for name in columns if name in _CONTOUR_COLUMNS[2:]}
        for name, values in tables.items():
            values[row, column] = columns[name]
        head = _head(lines)
        reference_hz = _number(head.get("reference_hz", f"{REFERENCE_HZ}"))
        if reference_hz is None:
            raise BadInput(head["reference_hz"], "a frequency", key="reference_hz")
    return Contours(
        head.get("name", path.stem),
        frequency,
        level,
        tables["db_sl"],
        tables.get("low_db_sl"),
        tables.get("high_db_sl"),
        reference_hz,
        cast(Provenance, head.get("provenance", Contours.provenance)),
        head.get("source", path.name),
        _contact(head, path),
    )


def write_contours(path: str | Path, contours: Contours) -> None:
    """Write contours so that `read_contours` gives them back, whole or not at all."""
    tables = {key: getattr(contours, key) for key in _CONTOUR_COLUMNS[2:] if getattr(contours, key) is not None}
    stream = io.StringIO()
    stream.write(f"{_head_text(contours)}# reference_hz: {contours.reference_hz!r}\n")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow((*_CONTOUR_COLUMNS[:2], *tables))
    for row, level in enumerate(contours.level_db_sl.tolist()):
        for column, frequency in enumerate(contours.frequency_hz.tolist()):
            writer.writerow((level, frequency, *(float(values[row, column]) for values in tables.values())))
    write_text(path, stream.getvalue())


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of a calibration. displacement_mm, voltage_v: (n,); names: each pair's own, or its row."""

    displacement_mm: FloatArray
    voltage_v: FloatArray
    names: list[str]


def read_pairs(path: str | Path) -> Pairs:
    """Read a CSV with columns displacement_mm, voltage_v and, if there is one, name. BadInput, one line, otherwise."""
    needed = ("displacement_mm", "voltage_v")
    require_kind(Path(path), "pairs")
    with _read("pairs", Path(path)) as (_, rows):
        header = [cell.lower() for cell in rows[0]] if rows else []
        for column in needed:
            if column not in header:
                raise BadInput(f"there is no column {column!r}", "displacement_mm,voltage_v[,name]")
        places = [header.index(column) for column in (*needed, "name") if column in header]
        values, names = [], []
        for line, row in enumerate(rows[1:], start=2):
            cells = [row[place] if place < len(row) else "" for place in places]
            numbers = [_number(cell) for cell in cells[:2]]
            for cell, number in zip(cells, numbers, strict=False):
                if number is None or not np.isfinite(number):
                    raise BadInput(f"row {line} has {cell!r}", "a finite number")
            values.append(numbers)
            names.append(cells[2] if len(cells) > 2 and cells[2] else f"row {line}")
    table = np.array(values, dtype=np.float64).reshape(-1, 2)
    return Pairs(table[:, 0], table[:, 1], names)


@dataclass(frozen=True, eq=False)
class NamedMatrix:
    """A confusion matrix with names. counts: (stimuli, responses). Names are the file's, or 1, 2, 3, ..."""

    counts: FloatArray
    stimuli: tuple[str, ...]
    responses: tuple[str, ...]


def read_matrix(path: str | Path) -> NamedMatrix:
    """Read a matrix: a row a stimulus, a column a response; a header row and a first column of names may be.

    Raises BadInput, one line, where the file cannot be read, is empty, ragged, or holds words for counts.
    """
    require_kind(Path(path), "matrix")
    with _read("matrix", Path(path)) as (_, rows):
        if not rows:
            raise BadInput("no rows", "a row of counts for each stimulus")
        # A corner that is not a number, over rows that all begin with one or with a name, heads a column of names.
        corner = not rows[0][0] or (_number(rows[0][0]) is None and len(rows) == len(rows[0]))
        names_across = corner or any(_number(cell) is None for cell in rows[0][1:])
        header, body = (rows[0], rows[1:]) if names_across else (None, rows)
        first = 1 if corner or any(_number(row[0]) is None for row in body) else 0
        if len({len(row) for row in rows}) != 1 or not body:
            raise BadInput(f"rows of {sorted({len(row) for row in rows})} cells", "rows of equal length")
        words = [cell for row in body for cell in row[first:] if _number(cell) is None]
        if words:
            raise BadInput(f"{words[0]!r} is not a number", "counts")
        counts = np.array([row[first:] for row in body], dtype=np.float64)
    numbered = [tuple(str(number + 1) for number in range(count)) for count in counts.shape]
    stimuli = tuple(row[0] for row in body) if first else numbered[0]
    return NamedMatrix(counts, stimuli, tuple(header[first:]) if header is not None else numbered[1])
