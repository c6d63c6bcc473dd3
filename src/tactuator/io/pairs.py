"""Pairs of a calibration: displacement by a dial gauge, voltage of the sensor."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.formats.text import read_text, table_rows


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
