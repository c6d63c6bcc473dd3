"""A run's answers by level, and the psychometric function that was fitted to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.experiment.procedure.refit import Refit, RefitPrior, refit
from tactuator.experiment.result.catch import catch_kinds
from tactuator.experiment.result.thresholds import MeasuredThreshold, names_of_people
from tactuator.experiment.store.stored_runs import StoredRun
from tactuator.perception.psychometric import Psychometric, Weibull

_MARGIN_DB = 3.0
_CURVE_STEP_DB = 2.0
"""Width of the classes of level into which the trials of a whole-curve run are put: hardly two are at the same level
above their curve."""


@dataclass(frozen=True, eq=False)
class PsychometricTrials:
    """Shares of right answers at levels, dB SL, and the psychometric function fitted to them.

    level_db_sl, share, count: (levels,). grid_db_sl, psi: the function, (n,). threshold: the refit with its 95 %
    interval; its own_db_sl is the procedure's number, where it has one. whole_curve: True where levels are not in dB SL
    but relative to the run's own curve at the frequency of each trial.
    """

    level_db_sl: FloatArray
    share: FloatArray
    count: NDArray[np.int64]
    grid_db_sl: FloatArray
    psi: FloatArray
    threshold: MeasuredThreshold
    whole_curve: bool = False


def psychometric_trials(
    runs: Sequence[StoredRun], found: Sequence[MeasuredThreshold]
) -> dict[str, tuple[PsychometricTrials, ...]]:
    """Return every run by the name of its subject; found holds one threshold of a run, or those of a whole curve."""
    by_run: dict[int, list[MeasuredThreshold]] = {}
    for one in found:
        by_run.setdefault(one.run, []).append(one)
    people: dict[str, list[PsychometricTrials]] = {}
    names = names_of_people(found)
    for run in runs:
        mine = by_run.get(run.run.id, [])
        if mine:
            drawn = _of_curve(run, mine) if mine[0].procedure == "curve" else _of_run(run, mine[0])
            people.setdefault(names[mine[0].study_number, mine[0].subject], []).append(drawn)
    return {subject: tuple(trials) for subject, trials in people.items()}


def _of_run(run: StoredRun, threshold: MeasuredThreshold) -> PsychometricTrials:
    kept = catch_kinds(run) != "blank"
    levels, correct = run.levels_db_sl[kept], run.correct[kept]
    guess = run.protocol.forced_choice().guess
    fit = refit(levels, correct, RefitPrior(guess=guess, target=threshold.point))
    return _shares(np.round(levels, 3), correct, fit, guess, threshold)


def _of_curve(run: StoredRun, points: Sequence[MeasuredThreshold]) -> PsychometricTrials:
    """Return the trials of a whole-curve run by their level above its curve, which is linear between the points.

    A threshold of 0 dB says that the curve and one psychometric function explain all frequencies together.
    """
    kept = catch_kinds(run) != "blank"
    mine = sorted(points, key=lambda one: one.frequency_hz)
    at, level = np.array([(np.log(one.frequency_hz), one.refit_db_sl) for one in mine]).T
    above, correct = run.levels_db_sl[kept] - np.interp(np.log(run.frequency_hz[kept]), at, level), run.correct[kept]
    guess, point = run.protocol.forced_choice().guess, mine[0].point
    fit = refit(above, correct, RefitPrior(guess=guess, target=point))
    flags = tuple(sorted({flag for one in mine for flag in one.flags}))
    threshold = replace(
        mine[0], frequency_hz=float("nan"), refit_db_sl=float(fit.threshold_db[0]), refit_sd_db=float(fit.sd_db[0]),
        refit_low_db_sl=float(fit.low_db[0]), refit_high_db_sl=float(fit.high_db[0]), bound="", flags=flags,
    )  # fmt: skip
    classes = _CURVE_STEP_DB * np.round(above / _CURVE_STEP_DB) + 0.0  # no -0
    return replace(_shares(classes, correct, fit, guess, threshold), whole_curve=True)


def _shares(
    levels: FloatArray, correct: NDArray[np.bool_], fit: Refit, guess: float, threshold: MeasuredThreshold
) -> PsychometricTrials:
    distinct, place = np.unique(levels, return_inverse=True)
    count = np.bincount(place)
    share = np.bincount(place, weights=correct) / count
    grid = np.linspace(distinct[0] - _MARGIN_DB, distinct[-1] + _MARGIN_DB, 200)
    lapse = min(float(fit.lapse[0]), 0.99 * (1.0 - threshold.point))
    model = Psychometric(Weibull(float(fit.slope[0])), guess, lapse, threshold.point)
    return PsychometricTrials(
        distinct, share, count, grid, model.probability(grid - float(fit.threshold_db[0])), threshold
    )
