"""A whole-curve run as it is stored: what its trials say of the curve, and what its reader must know."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.experiment.procedure.curve_belief import CurveBelief
from tactuator.experiment.procedure.curve_flags import CurveFlags, curve_flags
from tactuator.experiment.procedure.curve_prior import clear_of_mains
from tactuator.experiment.procedure.drift import Trials
from tactuator.experiment.procedure.whole_curve import WholeCurveRule

Floats = NDArray[np.float64]

_POINTS = 12


@dataclass(frozen=True)
class CurveRun:
    """frequency_hz: twelve over the band; level_db_sl, sd_db: of the curve there; flags: of the run."""

    frequency_hz: Floats
    level_db_sl: Floats
    sd_db: Floats
    flags: CurveFlags


def curve_run(rule: WholeCurveRule, frequency_hz: Floats, levels_db_sl: Floats, correct: NDArray[np.bool_]) -> CurveRun:
    """The curve after trials (trials,), as they were played and whatever placed them."""
    prior = rule.prior
    belief = CurveBelief(prior, rule.answering)
    points = np.argmin(np.abs(np.log(frequency_hz[:, None] / prior.frequency_hz)), axis=1)
    for point, level, right in zip(points, levels_db_sl, correct, strict=True):
        belief.learn(np.array([point]), np.array([level]), np.array([right]))
    flags = curve_flags(belief, Trials(points[None, :], levels_db_sl[None, :], correct[None, :]))
    asked = clear_of_mains(np.geomspace(*prior.band_hz, _POINTS), prior.mains_hz, prior.clearance_hz, prior.band_hz)
    mean, sd = belief.curve(asked)
    return CurveRun(asked, mean[0], sd[0], flags)
