"""Flags of a whole-curve run: guessing, frequent lapses and drift."""

from __future__ import annotations

from dataclasses import dataclass

from tactuator.arrays import FloatArray
from tactuator.experiment.procedure.run_flags import LEAST_LOG_EVIDENCE
from tactuator.experiment.procedure.whole_curve.curve_belief import CurveBelief
from tactuator.experiment.procedure.whole_curve.curve_drift import LEAST_LOG_ODDS, CurveDrift, Trials, curve_drift

_FLAGGED_LAPSE_RATE = 0.05
_LAPSE_PROBABILITY_MIN = 0.6


@dataclass(frozen=True)
class CurveFlags:
    """Results of the tests on whole-curve runs, each (runs,).

    log_bayes_factor: log evidence for the model against guessing. lapsing: probability of a lapse rate above 5 %.
    """

    log_bayes_factor: FloatArray
    lapsing: FloatArray
    drift: CurveDrift

    def names(self, run: int = 0) -> tuple[str, ...]:
        """Return the names of the flags of one run, sorted."""
        found = {
            "chance": self.log_bayes_factor[run] < LEAST_LOG_EVIDENCE,
            "lapses": self.lapsing[run] > _LAPSE_PROBABILITY_MIN,
            "drift": self.drift.log_odds[run] > LEAST_LOG_ODDS,
        }
        return tuple(sorted(name for name, true in found.items() if true))


def curve_flags(belief: CurveBelief, trials: Trials) -> CurveFlags:
    """Test every run of a belief that has learnt these trials."""
    return CurveFlags(belief.log_bayes_factor, belief.share_of_lapses(_FLAGGED_LAPSE_RATE), curve_drift(belief, trials))
