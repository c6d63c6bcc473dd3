"""Small tables as CSV: threshold curves, equal-strength contours, pairs of a calibration, confusion matrices."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, agreed, unknown, within
from tactuator.io.atomic import write_text
from tactuator.io.csv_text import csv_text
from tactuator.io.kinds import require_kind
from tactuator.io.text import read_text
from tactuator.io.text_table import TextTable
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

_ALIKE_DB = 0.2
"""Difference up to which two columns of a curve say the same: what rounding to two digits leaves."""
_LEVEL, _ACCELERATION, _ERROR = "level_db_re_1um", "acceleration_m_s2_rms", "standard_error_db"


@dataclass(frozen=True, eq=False)
class _Sheet:
    """A table of text. head: its lines `# key: value`, by key; names: of the columns; rows: of cells."""

    head: Mapping[str, str]
    names: Sequence[str]
    rows: Sequence[Sequence[str]]

    def cells(self, name: str) -> list[str | None]:
        """Return a column, None where a row has no such cell. Raises BadInput for several that differ."""
        several = {
            f"{name} in column {place + 1}": [row[place] if place < len(row) else None for row in self.rows]
            for place, each in enumerate(self.names)
            if each == name
        }
        return agreed(several, lambda one, other: one == other, lambda cells: f"{cells[0]}, ...", "one column") or []

    def numbers(self, name: str, spared: Sequence[bool] = ()) -> FloatArray:
        """Return a column of numbers, (n,). Raises BadInput with the row that has none; the names are row 1.

        spared: rows whose cell may be empty, which is 0 then.
        """
        values = []
        for row, cell in enumerate(self.cells(name), start=2):
            if not cell and spared and spared[row - 2]:
                cell = "0"
            value = None if cell is None else _number(cell)
            if value is None:
                raise BadInput(
                    f"{name} is {'missing' if cell is None else repr(cell)} in row {row}", "a number in each"
                )
            values.append(value)
        return np.array(values)

    def optional(self, name: str, spared: Sequence[bool] = ()) -> FloatArray | None:
        """Return a column of numbers, or None where the table has no such column; spared: as `numbers` takes it."""
        return self.numbers(name, spared) if name in self.names else None


@contextmanager
def _sheet(noun: str, kind: str, path: Path, *needed: str) -> Iterator[_Sheet]:
    """Yield the table in a CSV file of that kind, whose first row names the columns. What is refused within names the
    noun and the file; columns that are needed ("a or b": one of them) and not there, and a table without rows, are
    refused.
    """
    with _text_table(noun, kind, path) as table:
        rows = table.rows()
        names = [cell.lower() for cell in rows[0]] if rows else []
        lacks = [name for name in needed if set(name.split(" or ")).isdisjoint(names)]
        if lacks or len(rows) < 2:  # none of its words: it may be any file
            of = f"{len(names)} columns, {max(len(rows) - 1, 0)} rows"
            raise BadInput(
                f"no column {', '.join(lacks)} ({of})" if lacks else of, f"{', '.join(needed)}, a row or more"
            )
        for number, row in enumerate(rows[1:], start=2):
            if any(row[len(names) :]):  # a decimal comma, say, where commas part the cells
                raise BadInput(f"row {number} has {len(row)} cells under {len(names)} names", "a name for each cell")
        yield _Sheet(_head(table.remarks()), names, rows[1:])


@contextmanager
def _text_table(noun: str, kind: str, path: Path) -> Iterator[TextTable]:
    """Yield the table of a CSV file of that kind."""
    require_kind(path, kind)
    with within(f"{noun} {path}"):
        yield TextTable(io.StringIO(read_text(path)))


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def resolve_curve(name_or_path: str, beside: Path = Path()) -> ThresholdCurve:
    """Return the library's curve of that name, or the CSV of that path (relative to the folder `beside`)."""
    if name_or_path in curve_names():
        return curve(name_or_path)
    path = beside / name_or_path
    if path.suffix.lower() != ".csv" and not os.path.exists(path):  # noqa: PTH110  (False for any text)
        raise unknown("threshold curve", name_or_path, [*curve_names(), "a CSV file"])
    return read_curve(path)


def read_curve(path: str | Path) -> ThresholdCurve:
    """Read a curve; lines `# key: value` of the head give name, provenance and source.

    Raises BadInput for a file that is missing, not a table, or not a curve.
    """
    path = Path(path)
    with _sheet("threshold curve", "curve", path, "frequency_hz", f"{_LEVEL} or {_ACCELERATION}") as sheet:
        frequency = sheet.numbers("frequency_hz")
        level = _level(frequency, sheet)
        bound = [cell or "" for cell in sheet.cells("bound")] if "bound" in sheet.names else []
        error = sheet.optional(_ERROR, [bool(cell) for cell in bound])
        if others := set(bound) - {"", ">=", "<="}:
            raise BadInput(repr(min(others)), 'empty, ">=" or "<="', key="bound")
    head = sheet.head
    read = ThresholdCurve(
        head.get("name", path.stem),
        frequency,
        level,
        cast(Provenance, head.get("provenance", ThresholdCurve.provenance)),
        head.get("source", path.name),
        error,
        _contact(head, path),
        cast("Any", tuple(bound)) if any(bound) else None,
    )
    read.require_measured()
    return read


def _level(frequency_hz: FloatArray, sheet: _Sheet) -> FloatArray:
    """Return the level of a curve, (n,), dB re 1 um, in its columns. Raises BadInput where two say it differently."""
    stated: dict[str, FloatArray] = {}
    if _LEVEL in sheet.names:
        stated[_LEVEL] = sheet.numbers(_LEVEL)
    if _ACCELERATION in sheet.names:
        cells = [_number(cell or "") or np.nan for cell in sheet.cells(_ACCELERATION)]
        acceleration = np.array(cells) if stated else sheet.numbers(_ACCELERATION)
        known = np.where(acceleration > 0.0, acceleration, np.nan)
        stated[_ACCELERATION] = level_from_acceleration(frequency_hz, known)
    level = agreed(
        stated,
        lambda one, other: bool(np.all(~(np.abs(one - other) > _ALIKE_DB))),
        lambda levels: f"{', '.join(f'{each:.4g}' for each in levels[:3])}, ... dB re 1 µm",
        "columns that agree, or one of them",
    )
    return np.zeros(0) if level is None else level


def _head(remarks: Sequence[str]) -> dict[str, str]:
    """Return the remarks `key: value` of a head that gives a name, by key; nothing of another head."""
    pairs = (line.split(":", 1) for line in remarks if ":" in line)
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
    path = Path(path)
    with _sheet("curve", "loss", path, "frequency_hz", "level_db_sl") as sheet:
        return RelativeCurve(sheet.numbers("frequency_hz"), sheet.numbers("level_db_sl"), path.stem)


def write_curve(
    path: str | Path, threshold: ThresholdCurve, circumstances: Mapping[str, Sequence[object]] | None = None
) -> None:
    """Write a curve so that `read_curve` gives it back; circumstances as `curve_text` has them.

    Raises BadInput for a curve of bounds alone.
    """
    threshold.require_measured()
    write_text(path, curve_text(threshold, circumstances), "curve")


def curve_text(threshold: ThresholdCurve, circumstances: Mapping[str, Sequence[object]] | None = None) -> str:
    """Return the text of a curve's file.

    circumstances: further columns by name, one cell for each point, which say how the curve was measured.
    """
    bound = threshold.bound or ("",) * threshold.frequency_hz.size
    errors = [] if threshold.standard_error_db is None else threshold.standard_error_db.tolist()
    columns: dict[str, Sequence[object]] = {
        "frequency_hz": threshold.frequency_hz.tolist(),
        _LEVEL: threshold.level_db_re_1um.tolist(),
        **({_ERROR: ["" if sign else error for error, sign in zip(errors, bound, strict=True)]} if errors else {}),
        **({"bound": bound} if any(bound) else {}),
        **(circumstances or {}),
    }
    return csv_text(columns, zip(*columns.values(), strict=True), _head_text(threshold))


_CONTOUR_COLUMNS = ("level_db_sl", "frequency_hz", "db_sl", "low_db_sl", "high_db_sl")


def read_contours(path: str | Path) -> Contours:
    """Read equal-strength contours, a row for each contour and frequency.

    Columns: level_db_sl (at the reference frequency), frequency_hz, db_sl, and perhaps low_db_sl and high_db_sl. Lines
    `# key: value` of the head give name, provenance, source, reference_hz, and where it was felt.

    Raises BadInput for a file that is missing, not a table, without a level for each contour and frequency, or none.
    """
    path = Path(path)
    with _sheet("contours", "contours", path, *_CONTOUR_COLUMNS[:3]) as sheet:
        level, row = np.unique(sheet.numbers("level_db_sl"), return_inverse=True)
        frequency, column = np.unique(sheet.numbers("frequency_hz"), return_inverse=True)
        cells = level.size * frequency.size
        if row.size != cells or np.unique(row * frequency.size + column).size != cells:
            got = f"{row.size} rows for {level.size} contours and {frequency.size} frequencies"
            raise BadInput(got, "each contour at each frequency, once")
        tables = {name: np.zeros((level.size, frequency.size)) for name in _CONTOUR_COLUMNS[2:] if name in sheet.names}
        for name, values in tables.items():
            values[row, column] = sheet.numbers(name)
        head = sheet.head
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
    head = f"{_head_text(contours)}# reference_hz: {contours.reference_hz!r}\n"
    rows = (
        (level, frequency, *(float(values[row, column]) for values in tables.values()))
        for row, level in enumerate(contours.level_db_sl.tolist())
        for column, frequency in enumerate(contours.frequency_hz.tolist())
    )
    write_text(path, csv_text((*_CONTOUR_COLUMNS[:2], *tables), rows, head), "contours")


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of a calibration. displacement_mm, voltage_v: (n,); names: each pair's own, or its row."""

    displacement_mm: FloatArray
    voltage_v: FloatArray
    names: list[str]


def read_pairs(path: str | Path) -> Pairs:
    """Read a CSV with columns displacement_mm, voltage_v and, if there is one, name. BadInput, one line, otherwise."""
    path = Path(path)
    with _sheet("pairs", "pairs", path, "displacement_mm", "voltage_v") as sheet:
        displacement, voltage = sheet.numbers("displacement_mm"), sheet.numbers("voltage_v")
        for row, pair in enumerate(zip(displacement, voltage, strict=True), start=2):
            if not np.all(np.isfinite(pair)):
                raise BadInput(f"row {row} has {pair[0]:g} mm and {pair[1]:g} V", "finite numbers")
        given = sheet.cells("name") if "name" in sheet.names else [None] * displacement.size
    return Pairs(displacement, voltage, [name or f"row {line}" for line, name in enumerate(given, start=2)])


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
    with _text_table("matrix", "matrix", Path(path)) as table:
        rows = table.rows()
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
