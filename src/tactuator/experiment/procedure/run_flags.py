"""What the reader of runs at one frequency must know: somebody who guessed, lapsed or drifted; each test's power."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.experiment.procedure.answering import Answering
from tactuator.experiment.procedure.drift import CRITICAL_Z, Drift, Trials, drift_test
from tactuator.experiment.procedure.refit import Refit, RefitPrior

Floats = NDArray[np.float64]

LEAST_LOG_EVIDENCE = 3.0
"""Log Bayes factor against guessing below which a run is flagged `chance`: odds of twenty to one."""
LAPSE_LOG_ODDS = 1.5
"""Log likelihood ratio of frequent over rare lapses above which a run is flagged `lapses`."""
LAPSES = 0.15
"""The lapse rate that the stated power is for."""
_FREE_DB = 30.0
_SURE_DB = 8.0


@dataclass(frozen=True)
class RunFlags:
    """Tests of runs. log_bayes_factor, lapse_log_odds: as in Refit; lapse_power: chance that LAPSES is flagged."""

    log_bayes_factor: Floats
    lapse_log_odds: Floats
    lapse_power: Floats
    drift: Drift

    def names(self, run: int) -> tuple[str, ...]:
        """The flags of one run."""
        found = {
            "chance": self.log_bayes_factor[run] < LEAST_LOG_EVIDENCE,
            "lapses": self.lapse_log_odds[run] > LAPSE_LOG_ODDS,
            "drift": abs(self.drift.z[run]) > CRITICAL_Z,
        }
        return tuple(sorted(name for name, true in found.items() if true))


def run_flags(levels_db: Floats, correct: NDArray[np.bool_], fitted: Refit, prior: RefitPrior) -> RunFlags:
    """The flags of runs. levels_db, correct: (runs, trials), NaN where a run was over; fitted: of the same runs."""
    answering = Answering(slopes=(1.0,), lapses=(0.0,), lapse_shares=(1.0,), guess=prior.guess, target=prior.target)
    trials = Trials(np.zeros(levels_db.shape, dtype=np.intp), levels_db, correct)
    start = fitted.threshold_db[:, None]
    drift = drift_test(trials, np.array([[_FREE_DB**2]]), start, fitted.slope, fitted.lapse, answering)
    return RunFlags(fitted.log_bayes_factor, fitted.lapse_log_odds, _lapse_power(levels_db, fitted), drift)


def _lapse_power(levels_db: Floats, fitted: Refit) -> Floats:
    """Probability of two or more lapses among the trials so far above threshold that nothing else explains an error."""
    with np.errstate(invalid="ignore"):
        loud = np.sum(levels_db >= fitted.threshold_db[:, None] + _SURE_DB, axis=1)
    none = (1.0 - LAPSES) ** loud
    one = loud * LAPSES * (1.0 - LAPSES) ** np.maximum(loud - 1, 0)
    return np.asarray(1.0 - none - one)
