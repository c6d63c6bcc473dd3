"""Flags of runs: guessing, frequent lapses and drift, with the power of each test; a notch that trials cannot exclude.

Drift is found by a score test. Trials are linearised about the fitted threshold g, whose prior is normal with precision
p. For a threshold that moves by `drift` from the first trial to the last, the score is sum w (psi - y) t, with t from
-1/2 to 1/2. With g free its information is sum I t^2 - (sum I t)^2 / (p + sum I), where I is the information of each
trial. The score divided by the root of that is standard normal where nothing moves.

A run of few trials of a curve may pass over a narrow notch: a trial at the threshold is answered rightly by luck once
in three times even where the threshold is far higher. So the answers at and beside each frequency are held against a
notch of UNSEEN_NOTCH_DB below the reported curve, both one as wide as the distance of the points and one that spares
the neighbours: their answers alone must not exclude it. It is excluded where the answers are EXCLUDED_ODDS times
likelier without either. The number of trials follows from what one trial
gives on average, at the level that separates the two best: the Kullback-Leibler divergence of its outcomes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.experiment.procedure.curve_belief import UNSEEN_NOTCH_DB, CurveBelief
from tactuator.experiment.procedure.curve_refinement import log_ratio
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

    log_bayes_factor, lapse_log_odds: as in Refit. lapse_power: probability that POWER_LAPSE_RATE would be flagged.
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


EXCLUDED_ODDS = 20.0
_NARROWEST_DECADES = 0.05
"""Standard deviation of the narrowest notch that is asked about, where the points are near enough."""
_TRIED_DB = np.arange(-2.0, 20.0, 0.5)


@dataclass(frozen=True)
class UnseenNotch:
    """What the trials say against a notch at each point, each (runs, points).

    log_odds: log likelihood of the answers with a notch of UNSEEN_NOTCH_DB there over that without, of the likeliest
    notch: at the point alone, about it, or between it and a neighbour. trials: how many more about the point would
    exclude it; 0 where it is excluded.
    """

    log_odds: FloatArray
    trials: NDArray[np.intp]


def unseen_notch(belief: CurveBelief) -> UnseenNotch:
    """Return what the trials of a belief say against a notch at each of its points."""
    decades = np.log10(belief.prior.frequency_hz)
    curve, share = belief.curve(belief.prior.frequency_hz).mean, belief.answered()
    gaps = 0.5 * (decades[1:] + decades[:-1])
    width = max(_NARROWEST_DECADES, 0.5 * float(np.diff(decades).max()))
    at_points, at_gaps = (
        np.stack([_with_notch(belief, curve, share, (decades - place) / width) for place in places], axis=1)
        for places in (decades, gaps)
    )
    alone, without = belief.likelihoods.at(curve + UNSEEN_NOTCH_DB), belief.likelihoods.at(curve)
    log_odds = np.maximum(at_points, log_ratio(alone, without, share))
    log_odds[:, 1:] = np.maximum(log_odds[:, 1:], at_gaps)
    log_odds[:, :-1] = np.maximum(log_odds[:, :-1], at_gaps)
    missing = (log_odds + np.log(EXCLUDED_ODDS)) / _told_by_a_trial(belief, share)[:, None]
    return UnseenNotch(log_odds, np.ceil(np.maximum(missing, 0.0)).astype(np.intp))


def _with_notch(belief: CurveBelief, curve: FloatArray, share: FloatArray, away: FloatArray) -> FloatArray:
    """Return the log odds of one notch, (runs,), whose middle the points are `away` from, in its widths."""
    raised = curve + UNSEEN_NOTCH_DB * np.exp(-0.5 * away**2)
    there, not_there = (belief.likelihoods.at(level).sum(axis=2, keepdims=True) for level in (raised, curve))
    return log_ratio(there, not_there, share)[:, 0]


def _told_by_a_trial(belief: CurveBelief, share: FloatArray) -> FloatArray:
    """Return the greatest average evidence of one trial against the notch, (runs,)."""
    slope, lapse = (np.array(column)[:, None] for column in belief.answering.pairs)
    without, with_notch = (
        share @ belief.answering.psi(_TRIED_DB - depth_db, slope, lapse) for depth_db in (0.0, UNSEEN_NOTCH_DB)
    )
    divergence = without * np.log(without / with_notch) + (1.0 - without) * np.log((1.0 - without) / (1.0 - with_notch))
    return np.asarray(divergence.max(axis=1))
