"""What the display delivered of what was commanded, by its sensor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactuator.experiment.trial.trial import IntervalRecord
from tactuator.signals.decibels import from_db

_NEAR_DB = 4.0


def delivered_offset_db(intervals: Sequence[IntervalRecord], level_db_sl: float, near_db: float = _NEAR_DB) -> float:
    """How far the sensor's amplitude lay above the commanded one, dB, over stimuli within near_db of level_db_sl.

    Powers are averaged, and what hum and noise leave in blank intervals is taken off: near threshold the amplitude
    alone reads too high. NaN where no stimulus was near, or noise hides them.
    """
    seen = [
        (float(from_db(one.measured_db_sl)) ** 2, one.commanded_db_sl)
        for one in intervals
        if one.measured_db_sl is not None
    ]
    blank = [power for power, commanded_db in seen if commanded_db is None]
    near = [
        (power, float(from_db(commanded_db)) ** 2)
        for power, commanded_db in seen
        if commanded_db is not None and abs(commanded_db - level_db_sl) <= near_db
    ]
    if not near:
        return float("nan")
    measured, commanded = np.mean(near, axis=0)
    signal = measured - (np.mean(blank) if blank else 0.0)
    return float(10.0 * np.log10(signal / commanded)) if signal > 0.0 else float("nan")
