"""Quality of the whole-curve procedure with many simulated observers, whose curves are given or drawn.

The loop of the display is not simulated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.procedure.drift import Trials
from tactuator.experiment.procedure.whole_curve.curve_belief import CurveBelief
from tactuator.experiment.procedure.whole_curve.curve_flags import CurveFlags, curve_flags
from tactuator.experiment.procedure.whole_curve.curve_kind import CurveKind
from tactuator.experiment.procedure.whole_curve.whole_curve import WholeCurveRule
from tactuator.experiment.simulated.procedure_quality import Setting
from tactuator.perception.psychometric import Psychometric, Weibull, weibull_rise
from tactuator.perception.relative_curve import RelativeCurve

NORMAL_PEOPLE = CurveKind("normal people", offset_db=4.0, tilt_db_per_decade=2.5, wave_db=2.0, wave_decades=0.35)
"""People whose curves are drawn where none is given. Near the procedure's prior, they show it at its best."""

_BATCH_RUNS = 50
_GRID_POINTS = 100


@dataclass(frozen=True)
class CurvePeople:
    """Observers of a whole-curve simulation.

    truth: everybody's curve, or None for NORMAL_PEOPLE. guessed: share of trials that are guessed outright (1: all).
    drift_db: rise of thresholds from the first trial to the last, about their mean. Raises BadInput for values that
    cannot be.
    """

    truth: RelativeCurve | None = None
    guessed: float = 0.0
    drift_db: float = 0.0

    def __post_init__(self) -> None:
        if not (0.0 <= self.guessed <= 1.0 and abs(self.drift_db) <= 60.0):
            raise BadInput(
                f"simulated people: guess {self.guessed:g}, drift {self.drift_db:g} dB; allowed: 0 to 1, -60 to 60"
            )


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
    people: CurvePeople | None = None,
    told: Callable[[float], None] = lambda share: None,
) -> CurveQuality:
    """Run the procedure on setting.runs observers and judge its curves.

    setting.start_db has no meaning here. told: called with the share that is done.
    """
    people = CurvePeople() if people is None else people
    rng = np.random.default_rng(setting.seed)
    errors, inside, names = [], [], list[tuple[str, ...]]()
    for first in range(0, setting.runs, _BATCH_RUNS):
        count = min(_BATCH_RUNS, setting.runs - first)
        part = _Batch(rule, setting, people, count, rng)
        flags = part.run(lambda share, done=first, more=count: told((done + share * more) / setting.runs))  # type: ignore[misc]
        error, within = part.judged()
        errors.append(error)
        inside.append(within)
        names += [flags.names(run) for run in range(count)]
    error, within = np.concatenate(errors), np.concatenate(inside)
    each = sorted({name for found in names for name in found})
    return CurveQuality(
        rms_error_db=float(np.sqrt(np.mean(error**2))),
        bias_db=float(error.mean()),
        rms_error_median_db=float(np.median(np.sqrt(np.mean(error**2, axis=1)))),
        coverage95=float(within.mean()),
        flagged=float(np.mean([bool(found) for found in names])),
        flags={name: float(np.mean([name in found for found in names])) for name in each},
        trials=rule.trials,
        people="drawn: normal people near the procedure's own prior" if people.truth is None else people.truth.name,
    )


class _Batch:
    """Several runs that are computed together."""

    def __init__(
        self, rule: WholeCurveRule, setting: Setting, people: CurvePeople, runs: int, rng: np.random.Generator
    ) -> None:
        self._rule, self._people, self._rng = rule, people, rng
        self._fine_hz = np.geomspace(*rule.prior.band_hz, _GRID_POINTS)
        both = np.concatenate([rule.prior.frequency_hz, self._fine_hz])
        if people.truth is None:
            truth = NORMAL_PEOPLE.draw(both, rule.prior.middle_hz, runs, rng)
        else:
            truth = np.broadcast_to(people.truth.level_db_sl_at(both), (runs, both.size))
        self._at_points, self._at_fine = truth[:, : rule.prior.points], truth[:, rule.prior.points :]
        self._slope = rng.uniform(*setting.slope, runs)
        answering = rule.answering
        self._model = Psychometric(Weibull(1.0), answering.guess, setting.lapse, answering.target)
        self._belief = CurveBelief(rule.prior, answering, runs)

    def run(self, told: Callable[[float], None]) -> CurveFlags:
        """Run all trials and return the flags that they earn. told: called with the share that is done."""
        rule, rows, kept = self._rule, np.arange(self._slope.size), []
        for trial in range(rule.trials):
            point, level = self._belief.choose(rule.floor_db_sl, rule.ceiling_db_sl)
            moved = self._people.drift_db * (trial / max(rule.trials - 1, 1) - 0.5)
            correct = self._answers(level - self._at_points[rows, point] - moved)
            self._belief.learn(point, level, correct)
            kept.append((point, level, correct))
            told((trial + 1) / rule.trials)
        points, levels, outcomes = (np.array(column).T for column in zip(*kept, strict=True))
        return curve_flags(self._belief, Trials(points, levels, outcomes))

    def _answers(self, level_db: FloatArray) -> NDArray[np.bool_]:
        model, guessed = self._model, self._people.guessed
        rise = weibull_rise(level_db, self._slope, model.at_threshold)
        chance = model.guess + (1.0 - model.guess - model.lapse) * rise
        chance = guessed * model.guess + (1.0 - guessed) * chance
        return np.asarray(self._rng.random(level_db.size) < chance)

    def judged(self) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return errors and whether the band holds the truth, (runs, _GRID_POINTS) each, over the band."""
        mean, sd = self._belief.curve(self._fine_hz)
        error = mean - self._at_fine
        return error, np.abs(error) <= 1.96 * sd
