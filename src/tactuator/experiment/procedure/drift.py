"""Score test of a threshold that moved during a run at one frequency, with the power that the run's trials gave it.

Trials are linearised about the fitted threshold g, whose prior is normal with precision p. For a threshold that moves
by `drift` from the first trial to the last, the score is sum w (psi - y) t, with t from -1/2 to 1/2. With g free its
information is sum I t^2 - (sum I t)^2 / (p + sum I), where I is the information of each trial. The score divided by the
root of that is standard normal where nothing moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from tactuator.arrays import FloatArray
from tactuator.experiment.procedure.answering import Answering

POWER_DRIFT_DB = 6.0
"""Drift over a run for which the power is stated."""
CRITICAL_Z = 2.0
"""|z| above which drift is flagged: two to four runs in a hundred without any."""

_NEWTON_STEPS = 8
_SLOPE_STEP_DB = 0.05
_PRECISION = 1.0 / 30.0**2


@dataclass(frozen=True)
class Drift:
    """Outcome of the test for every run, each (runs,).

    z: positive where the threshold rose. power: probability that a drift of POWER_DRIFT_DB would be flagged.
    """

    z: FloatArray
    power: FloatArray


@dataclass(frozen=True)
class Answers:
    """Answers of several runs: level_db_sl, NaN where a run was over, and correct, (runs, trials) each.

    slope, lapse: of each run's psychometric function, (runs,), taken as known.
    """

    level_db_sl: FloatArray
    correct: NDArray[np.bool_]
    slope: FloatArray
    lapse: FloatArray


def drift_test(answers: Answers, start_db: FloatArray, answering: Answering) -> Drift:
    """Test every run for drift. start_db: prior mean of the threshold and first guess at it, (runs,)."""
    lengths = np.isfinite(answers.level_db_sl).sum(axis=1)
    time = np.arange(answers.level_db_sl.shape[1]) / np.maximum(lengths - 1, 1)[:, None] - 0.5
    threshold = start_db.copy()
    for _ in range(_NEWTON_STEPS):
        weight, information = _linearised(answers, threshold, answering)
        slack = -weight.sum(axis=1) - (threshold - start_db) * _PRECISION
        threshold = threshold + np.clip(slack / (information.sum(axis=1) + _PRECISION), -4.0, 4.0)
    weight, information = _linearised(answers, threshold, answering)
    held = (information * time).sum(axis=1) ** 2 / (information.sum(axis=1) + _PRECISION)
    left = np.maximum((information * time**2).sum(axis=1) - held, 1e-12)
    z = -(weight * time).sum(axis=1) / np.sqrt(left)
    reach = POWER_DRIFT_DB * np.sqrt(left)
    return Drift(z, np.asarray(ndtr(reach - CRITICAL_Z) + ndtr(-reach - CRITICAL_Z)))


def _linearised(answers: Answers, threshold: FloatArray, answering: Answering) -> tuple[FloatArray, FloatArray]:
    """Return the score with respect to level, and the information, of every trial; both zero where a run was over."""
    there = np.isfinite(answers.level_db_sl)
    level = np.where(there, answers.level_db_sl - threshold[:, None], 0.0)
    bend, miss = answers.slope[:, None], answers.lapse[:, None]
    psi = answering.psi(level, bend, miss)
    steep = answering.psi(level + _SLOPE_STEP_DB, bend, miss) - answering.psi(level - _SLOPE_STEP_DB, bend, miss)
    steep = np.where(there, steep / (2.0 * _SLOPE_STEP_DB), 0.0)
    spread = psi * (1.0 - psi)
    return steep * (answers.correct - psi) / spread, steep**2 / spread
