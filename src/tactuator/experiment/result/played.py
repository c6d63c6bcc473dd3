"""Intervals of a stored run as arrays: levels played and levels at the sensor, and faults of the playing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.experiment.store.stored_runs import StoredRun
from tactuator.experiment.trial.timing import Timing
from tactuator.signals.decibels import from_db

_MAINS_HZ = (50.0, 60.0)
_FELT_RE_THRESHOLD_DB = -10.0
_STEADY_VARIATION_MAX = 0.5
"""Largest standard deviation over mean of a hum's power from interval to interval; that of noise is 1."""
_SIMULATED_RIGS = ("simulated", "in-process", "emulated")


@dataclass(frozen=True)
class PlayedIntervals:
    """Intervals of a run as they were played; arrays (intervals,).

    trial: index in the run. commanded_db_sl: NaN where blank. measured_db_sl: at the sensor. saturated: True where a
    converter was.
    """

    trial: NDArray[np.intp]
    commanded_db_sl: FloatArray
    measured_db_sl: FloatArray
    saturated: NDArray[np.bool_]


def played(run: StoredRun) -> PlayedIntervals:
    """Return the intervals of all the run's trials."""
    seen = run.intervals
    each = max(seen.saturated.size // max(run.correct.size, 1), 1)
    trial = np.arange(seen.saturated.size) // each
    return PlayedIntervals(trial, seen.commanded_db_sl, seen.measured_db_sl, seen.saturated)


def hum_is_felt(seen: PlayedIntervals, frequency_hz: float, timing: Timing, threshold_db_sl: float) -> bool:
    """Return whether hum was felt with the stimulus.

    That is a line of 50 or 60 Hz mains within the bandwidth of the stimulus, and blank intervals with a steady tenth or
    more of the power of a stimulus at threshold.
    """
    clearance = timing.clearance_hz(frequency_hz)
    lines = [max(round(frequency_hz / mains), 1) * mains for mains in _MAINS_HZ]
    if min(abs(frequency_hz - line) for line in lines) >= clearance:
        return False
    blank = seen.measured_db_sl[np.isnan(seen.commanded_db_sl) & np.isfinite(seen.measured_db_sl)]
    if blank.size == 0:
        return True
    powers = from_db(blank) ** 2
    power = float(np.mean(powers))
    steady = float(np.std(powers)) < _STEADY_VARIATION_MAX * power
    return steady and bool(10.0 * np.log10(max(power, 1e-30)) >= threshold_db_sl + _FELT_RE_THRESHOLD_DB)


def is_simulated(run: StoredRun) -> bool:
    """Return whether nobody felt the run, because the rig's display or the subject was simulated."""
    nobody = run.run.respondent in ("simulated", "script") or run.session.subject_group == "simulated"
    return nobody or bool(run.run.rig_simulated) or str(run.run.rig).partition(":")[0] in _SIMULATED_RIGS
