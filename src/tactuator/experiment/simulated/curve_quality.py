"""Quality of the whole-curve procedure with many simulated observers, whose curves are given or drawn.

The loop of the display is not simulated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.experiment.procedure.curve_belief import CurveBelief
from tactuator.experiment.procedure.curve_prior import CurveKind
from tactuator.experiment.procedure.whole_curve import Trials, WholeCurveRule, curve_flags
from tactuator.experiment.simulated.procedure_quality import Setting, shares, with_loud_trials
from tactuator.perception.curve import RelativeCurve
from tactuator.perception.psychometric import Psychometric, Weibull, weibull_rise

NORMAL_PEOPLE = CurveKind("normal people", offset_db=4.0, tilt_db_per_decade=2.5, wave_db=2.0, wave_decades=0.35)
"""People whose curves are drawn where none is given. Near the procedure's prior, they show it at its best."""

_BATCH_RUNS = 50
_GRID_POINTS = 100


@dataclass(frozen=True)
class CurveQuality:
    """Quality of the procedure over the band, even in log frequency.

    rms_error_db, bias_db: over observers and frequencies together. rms_error_median_db: median over observers.
    coverage95: share of the curve inside its 95 % band. flagged: share of runs with any flag. flags: share of runs with
    each flag. trials: of every run. people: origin of the observers' curves.
    """

    rms_error_db: float
    bias_db: float
    rms_error_median_db: float
    coverage95: float
    flagged: float
    flags: dict[str, float]
    trials: int
    people: str


def simulate_curve(
    rule: WholeCurveRule,
    setting: Setting,
    truth: RelativeCurve | None = None,
    told: Callable[[float], None] = lambda share: None,
) -> CurveQuality:
    """Run the procedure on setting.runs observers and judge its curves.

    truth: everybody's curve; None: drawn from NORMAL_PEOPLE. setting.start_db has no meaning here. told: called with
    the share that is done.
    """
    rng = np.random.default_rng(setting.seed)
    errors, inside, names = [], [], list[tuple[str, ...]]()
    for first in range(0, setting.runs, _BATCH_RUNS):
        count = min(_BATCH_RUNS, setting.runs - first)
        part = _Batch(rule, setting, truth, count, rng)
        names += part.run(lambda share, done=first, more=count: told((done + share * more) / setting.runs))  # type: ignore[misc]
        error, within = part.judged()
        errors.append(error)
        inside.append(within)
    error, within = np.concatenate(errors), np.concatenate(inside)
    return CurveQuality(
        rms_error_db=float(np.sqrt(np.mean(error**2))),
        bias_db=float(error.mean()),
        rms_error_median_db=float(np.median(np.sqrt(np.mean(error**2, axis=1)))),
        coverage95=float(within.mean()),
        **shares(names),
        trials=rule.trials,
        people="drawn: normal people near the procedure's own prior" if truth is None else truth.name,
    )


class _Batch:
    """Several runs that are computed together."""

    def __init__(
        self, rule: WholeCurveRule, setting: Setting, truth: RelativeCurve | None, runs: int, rng: np.random.Generator
    ) -> None:
        self._rule, self._setting, self._rng = rule, setting, rng
        self._fine_hz = np.geomspace(*rule.prior.band_hz, _GRID_POINTS)
        both = np.concatenate([rule.prior.frequency_hz, self._fine_hz])
        if truth is None:
            level = NORMAL_PEOPLE.draw(both, rule.prior.middle_hz, runs, rng)
        else:
            level = np.broadcast_to(truth.level_db_sl_at(both), (runs, both.size))
        self._at_points, self._at_fine = level[:, : rule.prior.points], level[:, rule.prior.points :]
        self._slope = rng.uniform(*setting.slope, runs)
        answering = rule.answering
        self._model = Psychometric(Weibull(1.0), answering.guess, setting.lapse, answering.target)
        self._beliefs = [CurveBelief(rule.prior, answering, runs)]

    def run(self, told: Callable[[float], None]) -> list[tuple[str, ...]]:
        """Run all trials and return the flags that each run earns. told: called with the share that is done."""
        rule, kept, belief = self._rule, [], self._beliefs[0]
        for trial in range(rule.trials):
            point, level = belief.choose(rule.floor_db_sl, rule.ceiling_db_sl)
            correct = self._answers(point[:, None], level[:, None], np.array([[trial]]))[:, 0]
            belief.learn(point, level, correct)
            kept.append((point, level, correct))
            told((trial + 1) / rule.trials)
        trials = Trials(*(np.array(column).T for column in zip(*kept, strict=True)))
        if self._setting.loud_share:
            return self._with_loud(trials)
        found = curve_flags(belief, trials)
        return [found.names(run) for run in range(self._slope.size)]

    def _with_loud(self, own: Trials) -> list[tuple[str, ...]]:
        """Learn every run anew with loud trials among the procedure's, as `thresholds` does, and return its flags."""
        order = with_loud_trials(
            np.full(self._slope.size, own.level_db_sl.shape[1]), self._setting.loud_share, self._rng
        )
        points, levels = np.take_along_axis(own.point, order.own, axis=1), order.levels(own.level_db_sl)
        correct = order.outcomes(own.correct, self._answers(points, np.nan_to_num(levels), order.own))
        self._beliefs, names = [], []
        for run, there in enumerate(order.there):
            belief = CurveBelief(self._rule.prior, self._rule.answering)
            mine = Trials(points[[run]][:, there], levels[[run]][:, there], correct[[run]][:, there])
            for point, level, right in zip(mine.point.T, mine.level_db_sl.T, mine.correct.T, strict=True):
                belief.learn(point, level, right)
            self._beliefs.append(belief)
            names.append((*curve_flags(belief, mine).names(), *order.attention(run, correct)))
        return names

    def _answers(self, point: NDArray[np.intp], level_db: FloatArray, trial: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return whether trials are answered rightly; arguments (runs, trials)."""
        model, setting = self._model, self._setting
        threshold = np.take_along_axis(self._at_points, point, axis=1)
        above = level_db - threshold - setting.drifted_db(trial, self._rule.trials)
        rise = weibull_rise(above, self._slope[:, None], model.at_threshold)
        chance = setting.chance(model.guess, model.guess + (1.0 - model.guess - model.lapse) * rise)
        return np.asarray(self._rng.random(level_db.shape) < chance)

    def judged(self) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return errors and whether the band holds the truth, (runs, _GRID_POINTS) each, over the band."""
        found = [belief.curve(self._fine_hz) for belief in self._beliefs]
        mean, sd = (np.concatenate(column) for column in zip(*found, strict=True))
        error = mean - self._at_fine
        return error, np.abs(error) <= 1.96 * sd
