"""Score test of a threshold that moved during a run, with the power that the run's trials gave it.

Trials are linearised about the fitted curve g (thresholds at one or more points, Gaussian prior of covariance K). For a
threshold that moves by `drift` from the first trial to the last, the score is sum w (psi - y) t, with t from -1/2 to
1/2. With g free its information is t'It - t'IZ (1/K + Z'IZ)^-1 Z'It, where I holds the information of each trial and Z
says at which point it was. The score divided by the root of that is standard normal where nothing moves. A run at one
frequency is a curve of one point.
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


@dataclass(frozen=True)
class Trials:
    """Trials of several runs: point (index), level_db_sl and correct, each (runs, trials); level NaN where a run was
    over.
    """

    point: NDArray[np.intp]
    level_db_sl: FloatArray
    correct: NDArray[np.bool_]


@dataclass(frozen=True)
class Drift:
    """Outcome of the test for every run, each (runs,).

    z: positive where the threshold rose. power: probability that a drift of POWER_DRIFT_DB would be flagged.
    """

    z: FloatArray
    power: FloatArray


def drift_test(
    trials: Trials,
    covariance: FloatArray,
    start_db: FloatArray,
    slope: FloatArray,
    lapse: FloatArray,
    answering: Answering,
) -> Drift:
    """Test every run for drift.

    covariance: K, (points, points). start_db: prior mean of g and first guess at it, (runs, points). slope, lapse: of
    each run's psychometric function, (runs,), taken as known.
    """
    points = start_db.shape[1]
    precision = np.linalg.inv(covariance + 1e-6 * np.eye(points))
    lengths = np.isfinite(trials.level_db_sl).sum(axis=1)
    time = np.arange(trials.level_db_sl.shape[1]) / np.maximum(lengths - 1, 1)[:, None] - 0.5
    curve = start_db.copy()
    for _ in range(_NEWTON_STEPS):
        weight, information = _linearised(trials, curve, slope, lapse, answering)
        slack = -_by_point(trials, weight, points) - (curve - start_db) @ precision
        bend = _diagonal(_by_point(trials, information, points)) + precision
        curve = curve + np.clip(np.linalg.solve(bend, slack[..., None])[..., 0], -4.0, 4.0)
    weight, information = _linearised(trials, curve, slope, lapse, answering)
    bend = _diagonal(_by_point(trials, information, points)) + precision
    across = _by_point(trials, information * time, points)
    held = np.linalg.solve(bend, across[..., None])[..., 0]
    left = np.maximum((information * time**2).sum(axis=1) - (across * held).sum(axis=1), 1e-12)
    z = -(weight * time).sum(axis=1) / np.sqrt(left)
    reach = POWER_DRIFT_DB * np.sqrt(left)
    return Drift(z, np.asarray(ndtr(reach - CRITICAL_Z) + ndtr(-reach - CRITICAL_Z)))


def _linearised(
    trials: Trials, curve: FloatArray, slope: FloatArray, lapse: FloatArray, answering: Answering
) -> tuple[FloatArray, FloatArray]:
    """Return the score with respect to level, and the information, of every trial; both zero where a run was over."""
    there = np.isfinite(trials.level_db_sl)
    at = np.take_along_axis(curve, trials.point, axis=1)
    level = np.where(there, trials.level_db_sl - at, 0.0)
    bend, miss = slope[:, None], lapse[:, None]
    psi = answering.psi(level, bend, miss)
    steep = answering.psi(level + _SLOPE_STEP_DB, bend, miss) - answering.psi(level - _SLOPE_STEP_DB, bend, miss)
    steep = np.where(there, steep / (2.0 * _SLOPE_STEP_DB), 0.0)
    spread = psi * (1.0 - psi)
    return steep * (trials.correct - psi) / spread, steep**2 / spread


def _by_point(trials: Trials, values: FloatArray, points: int) -> FloatArray:
    """Sum values over the trials at each point; returns (runs, points)."""
    found = np.zeros((values.shape[0], points))
    np.add.at(found, (np.arange(values.shape[0])[:, None], trials.point), values)
    return found


def _diagonal(values: FloatArray) -> FloatArray:
    return np.asarray(values[..., None] * np.eye(values.shape[-1]))
