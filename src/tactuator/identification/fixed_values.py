"""Does the record agree with the values that are fixed? A wrong one bends the model, or hides behind far poles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from tactuator.identification.options import Fixed
from tactuator.identification.search import Choice
from tactuator.identification.trust import FIXED, FIXED_DB
from tactuator.model.plant_model import DB, PlantModel, QualityCheck

_CHANCE = 1e-4
"""Chance of a likelihood ratio below which the record speaks against a value."""
_FAR_OFF = FIXED.limit / 100.0  # as a share


@dataclass(frozen=True)
class FixedAgainstOwn:
    """A value that is fixed, beside the record's own (None: it has none) with its 95 % half-width (nan: not known)."""

    fixed: Fixed
    by_record: tuple[float, float] | None

    @property
    def half(self) -> float:
        """Return the half-width of the record's own value, infinite where it is not known."""
        return float("inf") if self.by_record is None or not np.isfinite(self.by_record[1]) else self.by_record[1]

    @property
    def off(self) -> float:
        """Return by what part of itself the value departs from the record's own; 0 within that one's confidence, 1
        where the record has no such thing.
        """
        if self.by_record is None:
            return 1.0
        apart = abs(self.by_record[0] - self.fixed.value)
        return 0.0 if apart < self.by_record[1] else apart / abs(self.fixed.value)

    @property
    def is_far(self) -> bool:
        """Return true where the record's own value departs by more than a tenth, and by more than its confidence."""
        return self.by_record is not None and self.off > _FAR_OFF

    @property
    def beside(self) -> str:
        """Return what the record shows by itself, empty if that has no such thing."""
        if self.by_record is None:
            return ""
        value, half = self.by_record
        return f"by itself it shows {value:.4g}" + (f" ± {half:.2g}" if np.isfinite(half) else "")

    def __str__(self) -> str:
        return f"{self.fixed} ({self.beside})" if self.beside else str(self.fixed)


def beside_free(fit: Any, alone: PlantModel, fixed: Sequence[Fixed], chosen: Choice, free: Sequence[Choice]) -> Any:
    """Return a fit (an Identification, a ResponseFit) of fixed values beside what the record shows without them, a
    model `alone` and its choices `free`; where that speaks against them, the band holds both, and what decides on trust
    is reported.
    """
    known = tuple(FixedAgainstOwn(value, value.of_model(alone)) for value in fixed)
    fit = replace(fit, fixed=known)
    if not (disagrees(chosen, free) or cancelled(known, fit.model)):
        return fit
    return replace(fit, model=fit.model.holding(alone).with_checks(*checks_against_own(known, fit.model, alone)))


def disagrees(chosen: Choice, free: Sequence[Choice]) -> bool:
    """Return true where the record speaks against what is fixed: by Bayes' criterion, or, where nothing else of the
    form differs, by the likelihood's ratio. free: the choices without it, the one of the same hold is compared.
    """
    beside = next((choice for choice in free if choice.hold == chosen.hold), free[0])
    problem, fit = beside.problem, chosen.fit
    again = problem.descend(fit.form, fit.theta, fit.delay, most=10)
    if again is None:
        return True
    lost, values = 2.0 * (again.cost - beside.fit.cost), beside.fit.form.count - fit.form.count
    # difference of Bayes' criterion from which on a model without the values is better: a known pole that a zero has
    # to cancel costs one parameter, and chance gives a part of that back
    if lost - float(np.log(problem.given.total)) * values > 3.0:
        return True
    alike = replace(fit.form, known=(), gain=None) == replace(beside.fit.form, known=(), gain=None)
    return bool(alike and scipy.special.chdtrc(max(values, 1), max(lost, 0.0)) < _CHANCE)


def cancelled(known: Sequence[FixedAgainstOwn], model: PlantModel) -> bool:
    """Return true where a value is obeyed by what nothing else asks for: the record's own departs by more than a tenth
    and three times its confidence, or a known pole, that the record itself does not show, has a zero beside it.
    """
    far = [value for value in known if value.is_far]
    if any(abs((value.by_record or (0.0, 0.0))[0] - value.fixed.value) > 3.0 * value.half for value in far):
        return True
    zeros = np.abs(np.roots(model.num)) / (2.0 * np.pi)
    return any(
        # distance of a zero from a known pole, over that, within which it takes most of it away
        value.fixed.name == "pole" and value.is_far and bool(np.any(np.abs(zeros / value.fixed.value - 1.0) < 0.25))
        for value in known
    )


def checks_against_own(known: Sequence[FixedAgainstOwn], model: PlantModel, free: PlantModel) -> list[QualityCheck]:
    """Return what decides on values that the record does not agree with: each value's distance from the record's own
    beyond its confidence (all of it where the record has no such thing), and that of the responses.
    """
    low, high = free.valid_hz or free.band_hz
    frequency = np.geomspace(low, high, 200)
    apart = DB * float(np.max(np.abs(np.log(np.abs(model.response(frequency) / free.response(frequency))))))
    rows = [FIXED.of(100.0 * value.off, str(value)) for value in known]
    alone = f"by itself it shows {free.den.size - 1} poles and {free.num.size - 1} zeros"
    return [*rows, FIXED_DB.of(apart, _evaded(model, free, low) if known else alone)]


def _evaded(model: PlantModel, free: PlantModel, low: float) -> str:
    """Return how a model evades a value at 0 Hz: by a pole far below the lowest frequency of the record (low, hertz),
    under which it has that value; empty where it has no such pole, or the record by itself has one, too.
    """
    slowest = (np.min(np.abs(np.roots(each.den)), initial=np.inf) for each in (model, free))
    slow, free_pole = (float(size) / (2.0 * np.pi) for size in slowest)
    return "" if slow > 0.1 * low or free_pole < 0.1 * low else f"a pole at {slow:.2g} Hz evades a value at 0 Hz"


def exact(model: PlantModel, fixed: Sequence[Fixed]) -> PlantModel:
    """Return the model with a fixed gain to the last digit, and no variance of it."""
    gain = next((value.value for value in fixed if value.name == "gain"), None)
    if gain is None:
        return model
    num, covariance = model.num.copy(), model.covariance.copy()
    last, under = num.size - 1, num.size + model.den.size - 2
    num[-1] = gain * model.den[-1]
    covariance[last, :] = gain * covariance[under, :]
    covariance[:, last] = covariance[last, :]
    covariance[last, last] = gain**2 * covariance[under, under]
    return replace(model, num=num, covariance=covariance)
