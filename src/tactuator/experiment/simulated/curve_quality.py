"""How good the whole-curve procedure is: many observers with curves of their own, loop not simulated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactuator.experiment.procedure.curve_belief import CurveBelief
from tactuator.experiment.procedure.whole_curve import WholeCurveRule
from tactuator.experiment.simulated.procedure_quality import Setting
from tactuator.perception.psychometric import Psychometric, Weibull, weibull_rise

_BATCH = 64
_FINE = 100


@dataclass(frozen=True)
class CurveQuality:
    """Over the band, even in log frequency. rms_error_db: over observers and frequencies together.

    coverage95: share of the curve inside its 95 % band; trials: of every run.
    """

    rms_error_db: float
    bias_db: float
    rms_error_median_db: float
    coverage95: float
    trials: int


def simulate_curve(rule: WholeCurveRule, setting: Setting) -> CurveQuality:
    """Observers are drawn from the rule's own prior (offset, tilt, wave); setting.start_db is of no meaning here."""
    rng = np.random.default_rng(setting.seed)
    counts = [min(_BATCH, setting.runs - first) for first in range(0, setting.runs, _BATCH)]
    parts = [_batch(rule, setting, count, rng) for count in counts]
    error, inside = (np.concatenate(column) for column in zip(*parts, strict=True))
    each = np.sqrt(np.mean(error**2, axis=1))
    return CurveQuality(
        float(np.sqrt(np.mean(error**2))),
        float(error.mean()),
        float(np.median(each)),
        float(inside.mean()),
        rule.trials,
    )


def _batch(
    rule: WholeCurveRule, setting: Setting, runs: int, rng: np.random.Generator
) -> tuple[np.ndarray[tuple[int, int], np.dtype[np.float64]], np.ndarray[tuple[int, int], np.dtype[np.bool_]]]:
    """Errors at _FINE frequencies and whether the band holds the truth, (runs, _FINE) each."""
    prior = rule.prior
    fine_hz = np.geomspace(*prior.band_hz, _FINE)
    truth = prior.draw(np.concatenate([prior.frequency_hz, fine_hz]), runs, rng)
    at_points, at_fine = truth[:, : prior.points], truth[:, prior.points :]
    slopes = rng.uniform(*setting.slope, runs)
    model = Psychometric(Weibull(1.0), lapse=setting.lapse)
    belief = CurveBelief(prior, rule.answering, runs)
    for _ in range(rule.trials):
        point, level = belief.choose(rule.floor_db_sl, rule.ceiling_db_sl)
        rise = weibull_rise(level - at_points[np.arange(runs), point], slopes, model.at_threshold)
        chance = model.guess + (1.0 - model.guess - model.lapse) * rise
        belief.learn(point, level, rng.random(runs) < chance)
    mean, covariance = belief.curve()
    weights = prior.weights(fine_hz)
    error = mean @ weights.T - at_fine
    sd = np.sqrt(np.einsum("fg,rgh,fh->rf", weights, covariance, weights))
    return error, np.abs(error) <= 1.96 * sd
