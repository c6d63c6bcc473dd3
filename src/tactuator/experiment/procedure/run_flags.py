"""Flags of runs at one frequency: guessing, frequent lapses and drift, with the power of each test."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.experiment.procedure.answering import Answering
from tactuator.experiment.procedure.drift import CRITICAL_Z, Answers, Drift, drift_test
from tactuator.experiment.procedure.refit import Refit, RefitPrior

LEAST_LOG_EVIDENCE = 3.0
"""Log Bayes factor against guessing below which a run is flagged `chance`: odds of twenty to one."""
LAPSE_LOG_ODDS = 0.8
"""Log likelihood ratio of frequent over rare lapses above which a run is flagged `lapses`."""
LAPSE_LOG_ODDS_OF_FEW = 1.4
"""That limit for runs of fewer than _FEW_ANSWERS: two lapses among few loud trials look like many. With 0.8, five in a
hundred normal runs of 60 answers would be flagged."""
_FEW_ANSWERS = 75
POWER_LAPSE_RATE = 0.15
"""Lapse rate for which the power is stated."""
_EASY_ABOVE_DB = 8.0


@dataclass(frozen=True)
class RunFlags:
    """Results of the tests on several runs, each (runs,).

    log_bayes_factor, lapse_log_odds: as in Refit. lapse_limit: of those odds. lapse_power: probability that a lapse
    rate of POWER_LAPSE_RATE would be flagged.
    """

    log_bayes_factor: FloatArray
    lapse_log_odds: FloatArray
    lapse_limit: FloatArray
    lapse_power: FloatArray
    drift: Drift

    def names(self, run: int) -> tuple[str, ...]:
        """Return the names of the flags of one run, sorted."""
        found = {
            "chance": self.log_bayes_factor[run] < LEAST_LOG_EVIDENCE,
            "lapses": self.lapse_log_odds[run] > self.lapse_limit[run],
            "drift": abs(self.drift.z[run]) > CRITICAL_Z,
        }
        return tuple(sorted(name for name, true in found.items() if true))


def run_flags(levels_db: FloatArray, correct: NDArray[np.bool_], fitted: Refit, prior: RefitPrior) -> RunFlags:
    """Test runs for guessing, lapses and drift.

    levels_db, correct: (runs, trials), NaN where a run was over. fitted: the refit of the same runs, with that prior.
    """
    answering = Answering(slopes=(1.0,), lapses=(0.0,), lapse_shares=(1.0,), guess=prior.guess, target=prior.target)
    answers = Answers(levels_db, correct, fitted.slope, fitted.lapse)
    drift = drift_test(answers, fitted.threshold_db, answering)
    few = np.isfinite(levels_db).sum(axis=1) < _FEW_ANSWERS
    limit = np.where(few, LAPSE_LOG_ODDS_OF_FEW, LAPSE_LOG_ODDS)
    return RunFlags(fitted.log_bayes_factor, fitted.lapse_log_odds, limit, _lapse_power(levels_db, fitted), drift)


def _lapse_power(levels_db: FloatArray, fitted: Refit) -> FloatArray:
    """Return the probability of two or more lapses where only a lapse explains an error.

    Those are the trials that lie _EASY_ABOVE_DB or more above threshold.
    """
    with np.errstate(invalid="ignore"):
        loud = np.sum(levels_db >= fitted.threshold_db[:, None] + _EASY_ABOVE_DB, axis=1)
    none = (1.0 - POWER_LAPSE_RATE) ** loud
    one = loud * POWER_LAPSE_RATE * (1.0 - POWER_LAPSE_RATE) ** np.maximum(loud - 1, 0)
    return np.asarray(1.0 - none - one)
