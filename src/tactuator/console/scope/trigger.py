"""Trigger of the scope: the newest place at which a signal passes a level."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tactuator.console.scope.samples import ScopeSamples

_HYSTERESIS = 0.02
"""Share of the signal's range by which it has to leave the level before it can pass it again."""


@dataclass(frozen=True)
class Trigger:
    """Condition of a trigger: series (column of ScopeSamples), level in its unit, direction."""

    series: int
    level: float
    edge: Literal["rising", "falling"] = "rising"


def newest_crossing(samples: ScopeSamples, trigger: Trigger, start: int, stop: int) -> int | None:
    """Return the number of the newest row, from `start` up to `stop`, at which the signal has passed the level; None
    where there is none.
    """
    start = max(start, samples.oldest)
    values = samples.rows(start, stop)[:, trigger.series].astype(np.float64)
    sign = 1.0 if trigger.edge == "rising" else -1.0
    values, level = sign * values, sign * trigger.level
    if values.size < 2 or not np.any(np.isfinite(values)):
        return None
    low_enough = level - _HYSTERESIS * float(np.nanmax(values) - np.nanmin(values))
    # -1: below, ready; 1: at or above the level; between them the last of the two counts
    sides = np.where(values >= level, 1, np.where(values < low_enough, -1, 0))
    settled = np.flatnonzero(sides)
    passed = settled[1:][np.diff(sides[settled]) == 2]
    return None if passed.size == 0 else start + int(passed[-1])
