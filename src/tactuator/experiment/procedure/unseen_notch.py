"""Where the trials of a curve cannot exclude a notch: how likely one is by the answers, and how many trials would tell.

A run of few trials may pass over a narrow notch: a trial at the threshold is answered rightly by luck once in three
times even where the threshold is far higher. So the answers at and beside each frequency are held against a notch of
UNSEEN_NOTCH_DB below the curve as told, as narrow as the distance of the points lets one be seen. It is excluded where
the answers are EXCLUDED_ODDS times likelier without it. The number of trials follows from what one trial tells on
average, at the level that parts the two best: the Kullback-Leibler divergence of its outcomes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.experiment.procedure.curve_belief import UNSEEN_NOTCH_DB, CurveBelief
from tactuator.experiment.procedure.curve_refinement import log_ratio

EXCLUDED_ODDS = 20.0
_NARROWEST_DECADES = 0.05
"""Standard deviation of the narrowest notch that is asked about, where the points are near enough."""
_TRIED_DB = np.arange(-2.0, 20.0, 0.5)


@dataclass(frozen=True)
class UnseenNotch:
    """What the trials say against a notch at each point, each (runs, points).

    log_odds: log likelihood of the answers with a notch of UNSEEN_NOTCH_DB there over that without; where a notch
    between two points is likelier than at either, both have its odds. trials: how many more about the point would
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
    log_odds = at_points.copy()
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
    """Return the most that one trial tells against the notch on average, (runs,)."""
    slope, lapse = (np.array(column)[:, None] for column in belief.answering.pairs)
    without, with_notch = (
        share @ belief.answering.psi(_TRIED_DB - depth_db, slope, lapse) for depth_db in (0.0, UNSEEN_NOTCH_DB)
    )
    divergence = without * np.log(without / with_notch) + (1.0 - without) * np.log((1.0 - without) / (1.0 - with_notch))
    return np.asarray(divergence.max(axis=1))
