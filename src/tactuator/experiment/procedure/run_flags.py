"""Flags of runs at one frequency: guessing, frequent lapses and drift, with the power of each test.

Drift is found by a score test. Trials are linearised about the fitted threshold g, whose prior is normal with precision
p. For a threshold that moves by `drift` from the first trial to the last, the score is sum w (psi - y) t, with t from
-1/2 to 1/2. With g free its information is sum I t^2 - (sum I t)^2 / (p + sum I), where I is the information of each
trial. The score divided by the root of that is standard normal where nothing moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.experiment.procedure.procedure import Answering
from tactuator.experiment.procedure.refit import Refit, RefitPrior

POWER_DRIFT_DB = 6.0
"""Drift over a run for which the power is stated."""
CRITICAL_Z = 2.33
"""|z| above which drift is flagged: one run in a hundred without any."""

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
    information_left = np.maximum((information * time**2).sum(axis=1) - held, 1e-12)
    z = -(weight * time).sum(axis=1) / np.sqrt(information_left)
    reach = POWER_DRIFT_DB * np.sqrt(information_left)
    return Drift(z, np.asarray(scipy.special.ndtr(reach - CRITICAL_Z) + scipy.special.ndtr(-reach - CRITICAL_Z)))


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


LEAST_LOG_EVIDENCE = 3.0
"""Log Bayes factor against guessing below which a run is flagged `chance`: odds of twenty to one."""
LAPSE_LOG_ODDS = 2.0
"""Log likelihood ratio of frequent over rare lapses above which a run is flagged `lapses`: one run in a hundred of
rough people whose lapse rates reach 4 %."""
POWER_LAPSE_RATE = 0.15
"""Lapse rate for which the power is stated."""
_EASY_ABOVE_DB = 8.0


@dataclass(frozen=True)
class RunFlags:
    """Results of the tests on several runs, each (runs,).

    log_bayes_factor, lapse_log_odds: as in Refit. lapse_power: probability that a lapse rate of POWER_LAPSE_RATE would
    be flagged.
    """

    log_bayes_factor: FloatArray
    lapse_log_odds: FloatArray
    lapse_power: FloatArray
    drift: Drift

    def names(self, run: int) -> tuple[str, ...]:
        """Return the names of the flags of one run, sorted."""
        flags = {
            "chance": self.log_bayes_factor[run] < LEAST_LOG_EVIDENCE,
            "lapses": self.lapse_log_odds[run] > LAPSE_LOG_ODDS,
            "drift": abs(self.drift.z[run]) > CRITICAL_Z,
        }
        return tuple(sorted(name for name, true in flags.items() if true))


def run_flags(levels_db: FloatArray, correct: NDArray[np.bool_], fitted: Refit, prior: RefitPrior) -> RunFlags:
    """Test runs for guessing, lapses and drift.

    levels_db, correct: (runs, trials), NaN where a run was over. fitted: the refit of the same runs, with that prior.
    """
    answering = Answering(slopes=(1.0,), lapses=(0.0,), lapse_shares=(1.0,), guess=prior.guess, target=prior.target)
    answers = Answers(levels_db, correct, fitted.slope, fitted.lapse)
    drift = drift_test(answers, fitted.threshold_db, answering)
    return RunFlags(fitted.log_bayes_factor, fitted.lapse_log_odds, _lapse_power(levels_db, fitted), drift)


def _lapse_power(levels_db: FloatArray, fitted: Refit) -> FloatArray:
    """Return the probability of two or more lapses where only a lapse explains an error.

    Those are the trials that lie _EASY_ABOVE_DB or more above threshold.
    """
    with np.errstate(invalid="ignore"):
        loud = np.sum(levels_db >= fitted.threshold_db[:, None] + _EASY_ABOVE_DB, axis=1)
    none = (1.0 - POWER_LAPSE_RATE) ** loud
    single = loud * POWER_LAPSE_RATE * (1.0 - POWER_LAPSE_RATE) ** np.maximum(loud - 1, 0)
    return np.asarray(1.0 - none - single)
