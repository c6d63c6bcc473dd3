"""Evidence that a threshold curve moved during a run, against one that stayed.

A curve that rises by d from the first trial to the last, alike at all frequencies, answers as one that stays does to
levels that fall by d, both about the middle of the run. Every component of a belief is therefore refined from the moved
levels (curve_refinement), and the evidence of all components for a drift of +6 or -6 dB is divided by that for none:
the ratio of likelihoods, with curve, slope and lapse rate integrated out over the belief's own prior.

The log evidence is about s d - i d^2 / 2, where i is the information about d, read where the evidence is highest, and s
is normal with mean i times the drift and variance i. That gives the power of the test.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from tactuator.arrays import FloatArray
from tactuator.experiment.procedure.drift import POWER_DRIFT_DB
from tactuator.experiment.procedure.whole_curve.curve_belief import CurveBelief
from tactuator.experiment.procedure.whole_curve.curve_refinement import PointLikelihoods

LEAST_LOG_ODDS = 0.7
"""Log evidence ratio above which drift is flagged: two normal runs in a hundred of 150 trials."""
_TRIED_DB = (0.0, -2.0 * POWER_DRIFT_DB, -POWER_DRIFT_DB, POWER_DRIFT_DB, 2.0 * POWER_DRIFT_DB)
"""Drifts whose evidence is computed; the outermost are for the information alone."""
_LEAST_INFORMATION = 1e-6


@dataclass(frozen=True)
class Trials:
    """Trials of several runs: point (index), level_db_sl and correct, each (runs, trials)."""

    point: NDArray[np.intp]
    level_db_sl: FloatArray
    correct: NDArray[np.bool_]


@dataclass(frozen=True)
class CurveDrift:
    """Outcome of the test for every run, each (runs,).

    log_odds: log evidence for a drift of POWER_DRIFT_DB up or down (alike probable) against none. power: probability
    that a drift of POWER_DRIFT_DB would be flagged.
    """

    log_odds: FloatArray
    power: FloatArray


def curve_drift(belief: CurveBelief, trials: Trials) -> CurveDrift:
    """Test every run of a belief that has learnt these trials for drift.

    A run in which no component settles has odds of one to one and no power.
    """
    tried = belief.log_evidence([_likelihoods(belief, trials, drift_db) for drift_db in _TRIED_DB])
    none, _, down, up, _ = tried = np.nan_to_num(tried, neginf=0.0).T
    log_odds = np.logaddexp(up, down) - np.log(2.0) - none
    return CurveDrift(log_odds, _power(tried[np.argsort(_TRIED_DB)]))


def _power(evidence: FloatArray) -> FloatArray:
    """Return the power of the test in every run, (runs,), from the evidence of each drift in their order, (5, runs)."""
    bends = 2.0 * evidence[1:-1] - evidence[:-2] - evidence[2:]
    peak = np.argmax(evidence[1:-1], axis=0)[None]
    bend = np.take_along_axis(bends, peak, axis=0)[0]
    reach = np.sqrt(np.maximum(bend, _LEAST_INFORMATION))
    needed = (LEAST_LOG_ODDS + np.log(2.0)) / reach + 0.5 * reach
    return np.asarray(ndtr(reach - needed) + ndtr(-reach - needed))


def _likelihoods(belief: CurveBelief, trials: Trials, drift_db: float) -> PointLikelihoods:
    """Return the likelihoods of the trials for the curve in the middle of a run with that drift."""
    runs, count = trials.level_db_sl.shape
    found = PointLikelihoods(belief.answering, runs, belief.prior.points)
    fallen = trials.level_db_sl - drift_db * (np.arange(count) / max(count - 1, 1) - 0.5)
    for trial in range(count):
        found.learn(trials.point[:, trial], fallen[:, trial], trials.correct[:, trial])
    return found
