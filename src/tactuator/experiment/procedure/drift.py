"""Whether a threshold moved during a run: a score test, with the power that the run's trials had.

Trials are linearised about the fitted curve g (thresholds at one or more points, Gaussian prior of covariance K): a
threshold that moves by `drift` from the first trial to the last has the score sum w (psi - y) t, t from -1/2 to 1/2,
and, with g free, the information t'It - t'IZ (1/K + Z'IZ)^-1 Z'It (I: of each trial; Z: which point it was at). Divided
by its root the score is standard normal where nothing moves. A run at one frequency is a curve of one point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from tactuator.experiment.procedure.answering import Answering

Floats = NDArray[np.float64]

DRIFT_DB = 6.0
"""The drift over a run that the stated power is for."""
CRITICAL_Z = 2.0
"""|z| above which drift is flagged: two to four runs in a hundred without any."""

_STEPS = 8
_SMALL_DB = 0.05


@dataclass(frozen=True)
class Trials:
    """Trials of runs: point (index), level_db_sl, correct, all (runs, trials); level NaN where a run was over."""

    point: NDArray[np.intp]
    level_db_sl: Floats
    correct: NDArray[np.bool_]


@dataclass(frozen=True)
class Drift:
    """z: positive where thresholds rose; power: probability that a drift of DRIFT_DB is flagged; both (runs,)."""

    z: Floats
    power: Floats


def drift_test(
    trials: Trials, covariance: Floats, start_db: Floats, slope: Floats, lapse: Floats, answering: Answering
) -> Drift:
    """The test on every run. covariance: K, (points, points); start_db: a guess at g and the prior's mean, (runs,
    points);

    slope, lapse: (runs,), taken as known.
    """
    points = start_db.shape[1]
    precision = np.linalg.inv(covariance + 1e-6 * np.eye(points))
    lengths = np.isfinite(trials.level_db_sl).sum(axis=1)
    time = np.arange(trials.level_db_sl.shape[1]) / np.maximum(lengths - 1, 1)[:, None] - 0.5
    curve = start_db.copy()
    for _ in range(_STEPS):
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
    reach = DRIFT_DB * np.sqrt(left)
    return Drift(z, np.asarray(ndtr(reach - CRITICAL_Z) + ndtr(-reach - CRITICAL_Z)))


def _linearised(
    trials: Trials, curve: Floats, slope: Floats, lapse: Floats, answering: Answering
) -> tuple[Floats, Floats]:
    """Score with respect to level, and information, of every trial; zero where a run was over."""
    there = np.isfinite(trials.level_db_sl)
    at = np.take_along_axis(curve, trials.point, axis=1)
    level = np.where(there, trials.level_db_sl - at, 0.0)
    bend, miss = slope[:, None], lapse[:, None]
    psi = answering.psi(level, bend, miss)
    steep = answering.psi(level + _SMALL_DB, bend, miss) - answering.psi(level - _SMALL_DB, bend, miss)
    steep = np.where(there, steep / (2.0 * _SMALL_DB), 0.0)
    spread = psi * (1.0 - psi)
    return steep * (trials.correct - psi) / spread, steep**2 / spread


def _by_point(trials: Trials, values: Floats, points: int) -> Floats:
    """Sums over the trials at each point, (runs, points)."""
    found = np.zeros((values.shape[0], points))
    np.add.at(found, (np.arange(values.shape[0])[:, None], trials.point), values)
    return found


def _diagonal(values: Floats) -> Floats:
    return np.asarray(values[..., None] * np.eye(values.shape[-1]))
