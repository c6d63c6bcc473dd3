"""Norms by age, from a file that the clinic gives with its source: none is shipped, since none was found free."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

from tactuator.errors import BadInput
from tactuator.io.text import read_text

_COLUMNS = ("finger", "age_low", "age_high", "frequency_hz", "mean_db_re_1um", "sd_db")
_SAME_FREQUENCY = 1e-3


@dataclass(frozen=True)
class NormRow:
    """Thresholds of healthy people of age_low to age_high (years, both included) at a frequency, on a finger ("any"
    for every one): mean and standard deviation of levels, dB re 1 µm peak.
    """

    finger: str
    age_low: float
    age_high: float
    frequency_hz: float
    mean_db_re_1um: float
    sd_db: float

    def __post_init__(self) -> None:
        numbers = (self.age_low, self.age_high, self.frequency_hz, self.mean_db_re_1um, self.sd_db)
        if not all(map(math.isfinite, numbers)) or not (self.sd_db > 0.0 and self.frequency_hz > 0.0):
            raise BadInput(
                f"norm at {self.frequency_hz:g} Hz with sd_db {self.sd_db:g}", "finite numbers, both above 0"
            )
        if not 0.0 <= self.age_low <= self.age_high:
            raise BadInput(f"ages {self.age_low:g} to {self.age_high:g}", "a low age up to the high one")

    def z(self, level_db_re_1um: float) -> float:
        """Return how many standard deviations a level lies above the mean; positive is less sensitive."""
        return (level_db_re_1um - self.mean_db_re_1um) / self.sd_db

    def is_for(self, finger: str, age: float, frequency_hz: float) -> bool:
        """Return whether the row is of that finger, age and frequency."""
        same = abs(frequency_hz / self.frequency_hz - 1.0) < _SAME_FREQUENCY
        return self.finger in (finger, "any") and self.age_low <= age <= self.age_high and same


@dataclass(frozen=True)
class Norm:
    """Rows of a norm, and the source that its file names. Raises BadInput where two rows are for the same person."""

    source: str
    rows: tuple[NormRow, ...]

    def __post_init__(self) -> None:
        for index, row in enumerate(self.rows):
            for other in self.rows[:index]:
                if other.is_for(row.finger, max(row.age_low, other.age_low), row.frequency_hz) and (
                    row.age_low <= other.age_high and other.age_low <= row.age_high
                ):
                    raise BadInput(f"two rows for {row.finger} at {row.frequency_hz:g} Hz, age {row.age_low:g}", "one")

    def row(self, finger: str, age: float | None, frequency_hz: float) -> NormRow | None:
        """Return the row for a person, or None where there is none, or no age."""
        return None if age is None else next((row for row in self.rows if row.is_for(finger, age, frequency_hz)), None)


def read_norm(path: str | Path) -> Norm:
    """Return the norm of a CSV: a first line `# source: ...`, and the columns finger, age_low, age_high, frequency_hz,
    mean_db_re_1um, sd_db. Raises BadInput for anything else, and without a source.
    """
    lines = [line for line in read_text(Path(path)).splitlines() if line.strip()]
    source = lines[0].partition("source:")[2].strip() if lines and lines[0].startswith("#") else ""
    try:
        if not source:
            raise BadInput("no source", "a first line `# source: where the values are from`")
        table = csv.DictReader(line for line in lines if not line.startswith("#"))
        if tuple(table.fieldnames or ()) != _COLUMNS:
            raise BadInput(f"columns {', '.join(table.fieldnames or ()) or 'none'}", ", ".join(_COLUMNS))
        return Norm(source, tuple(_row(row) for row in table))
    except BadInput as error:
        raise error.within(f"norm {path}") from None


def _row(cells: dict[str, str]) -> NormRow:
    try:
        numbers = [float(cells[name]) for name in _COLUMNS[1:]]
    except (TypeError, ValueError):
        raise BadInput(f"row {', '.join(map(str, cells.values()))}", "a finger, and a number in each column") from None
    return NormRow(cells["finger"], *numbers)
