"""The mean level of a group of people.

Of some people of a group the thresholds are known to lie beyond what was played, and no more.
Such a level is censored (Tobin 1958, "Estimation of relationships for limited dependent variables"). People are taken
for normally distributed with mean m and standard deviation s. Who was measured contributes the density at the level,
who was not the probability of lying beyond it. Mean and spread are where the product of these and s is greatest: the
factor s undoes the fall of s in small groups, as a division by n - 1 does where nobody is censored.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from tactuator.arrays import FloatArray

BETWEEN = "between"
"""Bound of a mean that is not known from either side."""
_LEAST_SPREAD_DB, _MOST_SPREAD_DB = 0.1, 60.0
_REACH_DB = 200.0
_STEP = 1e-3


@dataclass(frozen=True)
class GroupLevel:
    """Mean level of a group, dB. bound: ">=" or "<=" where so many are censored that the mean is known from one side
    alone: it has no standard error then (NaN). BETWEEN: people lie beyond on both sides, and there is no level (NaN).
    people, censored: their numbers, the censored among them. low_db, high_db: the levels beyond which they lie.
    unknown: number of people beyond on both sides, from whom a mean with a level learns nothing: they are not counted.
    """

    level_db: float
    standard_error_db: float
    bound: str
    people: int
    censored: int
    low_db: float = float("nan")
    high_db: float = float("nan")
    unknown: int = 0


def group_level(level_db: FloatArray, sd_db: FloatArray, bound: Sequence[str]) -> GroupLevel:
    """Return the mean of people's levels (people,), each with the standard deviation of its measurement, by their
    bounds: "", or ">=" and "<=" of those who lie beyond their level, BETWEEN of those of whom both is known. The
    standard error is that between people, and not below what the measured levels are known to.

    With fewer than two people measured and some censored, the mean of all is a bound, or not known from either side.
    """
    unknown = np.array([each == BETWEEN for each in bound])
    side = np.array([{"": 0.0, ">=": 1.0, "<=": -1.0, BETWEEN: np.nan}[each] for each in bound])
    censored, people = int(np.count_nonzero(side)), side.size
    if unknown.any() and people - censored >= 2:
        others = [each for each in bound if each != BETWEEN]
        return replace(group_level(level_db[~unknown], sd_db[~unknown], others), unknown=int(unknown.sum()))
    known = float(np.sqrt(np.sum(sd_db[side == 0.0] ** 2)) / max(people - censored, 1))
    if censored and people - censored < 2:
        sides = {each for each in bound if each}
        if len(sides) > 1 or BETWEEN in sides:
            nan = float("nan")
            return GroupLevel(nan, nan, BETWEEN, people, censored, float(level_db.min()), float(level_db.max()))
        return GroupLevel(float(level_db.mean()), float("nan"), sides.pop(), people, censored)
    if censored:
        mean, error = _censored_normal(level_db, side)
    else:
        spread = float(np.std(level_db, ddof=1)) if people > 1 else float("nan")
        mean, error = float(level_db.mean()), spread / np.sqrt(people)
    return GroupLevel(mean, float(np.fmax(known, error)), "", people, censored)


def _censored_normal(level_db: FloatArray, side: FloatArray) -> tuple[float, float]:
    """Return the mean and its standard error by the observed information."""
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
    return float(best[0]), float(np.sqrt(max(variance, 0.0)))
