"""A run's answers by level, and the psychometric function that was fitted to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.experiment.procedure.refit import RefitPrior, refit
from tactuator.experiment.result.catch import catch_kinds
from tactuator.experiment.result.thresholds import MeasuredThreshold
from tactuator.experiment.store.stored_runs import StoredRun
from tactuator.perception.psychometric import Psychometric, Weibull

_MARGIN_DB = 3.0


@dataclass(frozen=True, eq=False)
class PsychometricTrials:
    """Shares of right answers at levels, dB SL, and the psychometric function fitted to them.

    level_db_sl, share, count: (levels,). grid_db_sl, psi: the function, (n,). threshold: the refit with its 95 %
    interval; its own_db_sl is the procedure's number, where it has one.
    """

    level_db_sl: FloatArray
    share: FloatArray
    count: NDArray[np.int64]
    grid_db_sl: FloatArray
    psi: FloatArray
    threshold: MeasuredThreshold


def psychometric_trials(
    runs: Sequence[StoredRun], found: Sequence[MeasuredThreshold]
) -> dict[str, tuple[PsychometricTrials, ...]]:
    """Return every run at one frequency, by its subject; whole-curve runs have no one function and are left out."""
    by_run = {one.run: one for one in found if one.procedure != "curve"}
    people: dict[str, list[PsychometricTrials]] = {}
    for run in runs:
        if run.run.id in by_run:
            people.setdefault(run.session.subject_code, []).append(_of_run(run, by_run[run.run.id]))
    return {subject: tuple(trials) for subject, trials in people.items()}


def _of_run(run: StoredRun, threshold: MeasuredThreshold) -> PsychometricTrials:
    kept = catch_kinds(run) != "blank"
    levels, correct = run.levels_db_sl[kept], run.correct[kept]
    guess = run.protocol.forced_choice().guess
    fit = refit(levels, correct, RefitPrior(guess=guess, target=threshold.point))
    distinct, place = np.unique(np.round(levels, 3), return_inverse=True)
    count = np.bincount(place)
    share = np.bincount(place, weights=correct) / count
    grid = np.linspace(distinct[0] - _MARGIN_DB, distinct[-1] + _MARGIN_DB, 200)
    lapse = min(float(fit.lapse[0]), 0.99 * (1.0 - threshold.point))
    model = Psychometric(Weibull(float(fit.slope[0])), guess, lapse, threshold.point)
    return PsychometricTrials(
        distinct, share, count, grid, model.probability(grid - float(fit.threshold_db[0])), threshold
    )
