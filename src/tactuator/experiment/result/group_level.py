"""The mean level of a group of people, and norms by age that a person is held against.

Of some people of a group the thresholds are known to lie beyond what was played, and no more.
Such a level is censored (Tobin 1958, "Estimation of relationships for limited dependent variables"). People are taken
for normally distributed with mean m and standard deviation s. Who was measured contributes the density at the level,
who was not the probability of lying beyond it. Mean and spread are where the product of these and s is greatest: the
factor s undoes the fall of s in small groups, as a division by n - 1 does where nobody is censored.

Norms come from a file that the clinic gives with its source: none is shipped, since none was found free.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, within
from tactuator.io.text import read_text

_LEAST_SPREAD_DB, _MOST_SPREAD_DB = 0.1, 60.0
_REACH_DB = 200.0
_STEP = 1e-3


@dataclass(frozen=True)
class GroupLevel:
    """Mean level of a group, dB. bound: ">=" or "<=" where so many are censored that the mean is known from one side
    alone. spread_db: standard deviation between people as measured, NaN of one person or of a bound. people, censored:
    their numbers, the censored among them.
    """

    level_db: float
    standard_error_db: float
    spread_db: float
    bound: str
    people: int
    censored: int


def group_level(level_db: FloatArray, sd_db: FloatArray, bound: Sequence[str]) -> GroupLevel:
    """Return the mean of people's levels (people,), each with the standard deviation of its measurement, by their
    bounds: "", or ">=" and "<=" of those who lie beyond their level. The standard error is that between people, and
    not below what the single levels are known to.

    With fewer than two people measured and some censored, the mean of all is a bound.
    """
    side = np.array([{"": 0.0, ">=": 1.0, "<=": -1.0}[each] for each in bound])
    censored, people = int(np.count_nonzero(side)), side.size
    known = float(np.sqrt(np.sum(sd_db**2)) / people)
    if censored and people - censored < 2:
        beyond = ">=" if np.any(side > 0.0) else "<="
        return GroupLevel(float(level_db.mean()), known, float("nan"), beyond, people, censored)
    if censored:
        mean, spread, error = _censored_normal(level_db, side)
    else:
        mean, spread = float(level_db.mean()), float(np.std(level_db, ddof=1)) if people > 1 else float("nan")
        error = spread / np.sqrt(people)
    return GroupLevel(mean, float(np.fmax(known, error)), spread, "", people, censored)


def _censored_normal(level_db: FloatArray, side: FloatArray) -> tuple[float, float, float]:
    """Return mean, spread, and the standard error of the mean by the observed information."""
    measured = side == 0.0

    def cost(at: FloatArray) -> float:
        mean, log_spread = at
        z = (level_db - mean) / np.exp(log_spread)
        beyond = scipy.special.log_ndtr(-side[~measured] * z[~measured])
        return float(0.5 * np.sum(z[measured] ** 2) + (measured.sum() - 1) * log_spread - beyond.sum())

    first = level_db[measured]
    start = np.array([level_db.mean(), np.log(np.clip(np.std(level_db) + 1.0, 1.0, _MOST_SPREAD_DB))])
    limits = [
        (first.mean() - _REACH_DB, first.mean() + _REACH_DB), (np.log(_LEAST_SPREAD_DB), np.log(_MOST_SPREAD_DB))
    ]  # fmt: skip
    best = scipy.optimize.minimize(cost, start, method="L-BFGS-B", bounds=limits, options={"ftol": 1e-13}).x
    steps = _STEP * np.diag([np.exp(best[1]), 1.0])
    bend = [
        [(cost(best + a + b) - cost(best + a - b) - cost(best - a + b) + cost(best - a - b)) / 4.0 for b in steps]
        for a in steps
    ]
    scale = _STEP * np.array([np.exp(best[1]), 1.0])
    variance = np.linalg.inv(np.array(bend) / np.outer(scale, scale))[0, 0]
    return float(best[0]), float(np.exp(best[1])), float(np.sqrt(max(variance, 0.0)))


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
    with within(f"norm {path}"):
        if not source:
            raise BadInput("no source", "a first line `# source: where the values are from`")
        table = csv.DictReader(line for line in lines if not line.startswith("#"))
        if tuple(table.fieldnames or ()) != _COLUMNS:
            raise BadInput(f"columns {', '.join(table.fieldnames or ()) or 'none'}", ", ".join(_COLUMNS))
        return Norm(source, tuple(_row(row) for row in table))


def _row(cells: dict[str, str]) -> NormRow:
    try:
        numbers = [float(cells[name]) for name in _COLUMNS[1:]]
    except (TypeError, ValueError):
        raise BadInput(f"row {', '.join(map(str, cells.values()))}", "a finger, and a number in each column") from None
    return NormRow(cells["finger"], *numbers)
