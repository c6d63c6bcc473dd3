"""What a whole-curve run's reader must know: somebody who guessed, lapsed or drifted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.experiment.procedure.curve_belief import CurveBelief
from tactuator.experiment.procedure.curve_kind import CurveKind
from tactuator.experiment.procedure.drift import CRITICAL_Z, Drift, Trials, drift_test
from tactuator.experiment.procedure.run_flags import LEAST_LOG_EVIDENCE

Floats = NDArray[np.float64]

_LAPSING = 0.05
_LAPSE_SHARE = 0.6


@dataclass(frozen=True)
class CurveFlags:
    """log_bayes_factor: of the model against guessing; lapsing: probability of a lapse rate above 5 %; (runs,)."""

    log_bayes_factor: Floats
    lapsing: Floats
    drift: Drift

    def names(self, run: int = 0) -> tuple[str, ...]:
        """The flags of one run."""
        found = {
            "chance": self.log_bayes_factor[run] < LEAST_LOG_EVIDENCE,
            "lapses": self.lapsing[run] > _LAPSE_SHARE,
            "drift": abs(self.drift.z[run]) > CRITICAL_Z,
        }
        return tuple(sorted(name for name, true in found.items() if true))


def curve_flags(belief: CurveBelief, trials: Trials) -> CurveFlags:
    """The flags of every run of a belief that has learnt these trials."""
    prior = belief.prior
    mean, _ = belief.curve(prior.frequency_hz)
    free = CurveKind("free", 1.0, 0.0, 10.0, 4.0, 0.0, rough_db=7.0)
    weight = belief.weight
    slope, lapse = (weight * belief.slope).sum(axis=1), (weight * belief.lapse).sum(axis=1)
    covariance = free.covariance(prior.frequency_hz, prior.frequency_hz, prior.middle_hz)
    found = drift_test(trials, covariance, mean, slope, lapse, belief.answering)
    return CurveFlags(belief.log_bayes_factor, belief.share_of_lapses(_LAPSING), found)
