"""Threshold curves as CSV: `frequency_hz,level_db_re_1um` and, where measured, `standard_error_db`."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import cast

import numpy as np

from tactuator.errors import BadInput
from tactuator.io.atomic import write_text
from tactuator.io.formats.text import read_text, table_rows
from tactuator.perception.curve import (
    Provenance,
    RelativeCurve,
    ThresholdCurve,
    curve,
    curve_names,
    level_from_acceleration,
)

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
