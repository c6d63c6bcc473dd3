"""What in a run's trials its reader must know: drift of the threshold, lapses far above it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactuator.experiment.procedure.refit import Refit, RefitPrior
from tactuator.perception.psychometric import Psychometric, Weibull

Floats = NDArray[np.float64]

_DRIFT_Z = 3.0
_FAR_ABOVE_DB = 10.0
_LAPSES = 2


def drift_z(levels_db: Floats, correct: NDArray[np.bool_], fitted: Refit, prior: RefitPrior) -> float:
    """Score test for a threshold that moves linearly with the trial number: normal with unit variance without drift.

    Positive where the threshold rises. Arguments of one run; the fit stands for the parameters.
    """
    model = Psychometric(Weibull(float(fitted.slope[0])), prior.guess, float(fitted.lapse[0]), prior.target)
    level = levels_db - fitted.threshold_db[0]
    psi = model.probability(level)
    steepness = (model.probability(level + 0.05) - model.probability(level - 0.05)) / 0.1
    weight = steepness / (psi * (1.0 - psi))
    information = steepness * weight
    time = np.arange(levels_db.size, dtype=np.float64)
    time -= np.sum(information * time) / np.sum(information)
    score = -np.sum(weight * (correct - psi) * time)
    return float(score / np.sqrt(np.sum(information * time**2)))


def lapses(levels_db: Floats, correct: NDArray[np.bool_], fitted: Refit) -> int:
    """Wrong answers at 10 dB or more above the fitted threshold."""
    return int(np.sum(~correct & (levels_db >= fitted.threshold_db[0] + _FAR_ABOVE_DB)))


def diagnose(levels_db: Floats, correct: NDArray[np.bool_], fitted: Refit, prior: RefitPrior) -> tuple[str, ...]:
    """drift: |z| above 3; lapses: two or more."""
    found = []
    if abs(drift_z(levels_db, correct, fitted, prior)) > _DRIFT_Z:
        found.append("drift")
    if lapses(levels_db, correct, fitted) >= _LAPSES:
        found.append("lapses")
    return tuple(found)
