"""Whole-curve runs from the store: the curve that their trials imply, and their flags."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.experiment.procedure.whole_curve.curve_belief import CurveBelief
from tactuator.experiment.procedure.whole_curve.curve_drift import Trials
from tactuator.experiment.procedure.whole_curve.curve_flags import CurveFlags, curve_flags
from tactuator.experiment.procedure.whole_curve.curve_prior import clear_of_mains
from tactuator.experiment.procedure.whole_curve.whole_curve import WholeCurveRule

_POINT_COUNT = 12


@dataclass(frozen=True)
class CurveRun:
    """The curve of a whole-curve run, each array (12,).

    frequency_hz: twelve frequencies over the band. level_db_sl, sd_db: of the curve there. flags: of the run.
    """

    frequency_hz: FloatArray
    level_db_sl: FloatArray
    sd_db: FloatArray
    flags: CurveFlags


def curve_run(
    rule: WholeCurveRule, frequency_hz: FloatArray, levels_db_sl: FloatArray, correct: NDArray[np.bool_]
) -> CurveRun:
    """Return the curve after trials, each array (trials,), as they were played, whatever placed them."""
    prior = rule.prior
    belief = CurveBelief(prior, rule.answering)
    points = np.argmin(np.abs(np.log(frequency_hz[:, None] / prior.frequency_hz)), axis=1)
    for point, level, right in zip(points, levels_db_sl, correct, strict=True):
        belief.learn(np.array([point]), np.array([level]), np.array([right]))
    flags = curve_flags(belief, Trials(points[None, :], levels_db_sl[None, :], correct[None, :]))
    asked = clear_of_mains(
        np.geomspace(*prior.band_hz, _POINT_COUNT), prior.mains_hz, prior.clearance_hz, prior.band_hz
    )
    mean, sd = belief.curve(asked)
    return CurveRun(asked, mean[0], sd[0], flags)
