"""Choice of the model's structure: as few poles and zeros as leave nothing of the command in the residual."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from tactuator.identification.estimate.friction_start import friction_fit
from tactuator.identification.estimate.rational_start import rational_start
from tactuator.identification.estimate.refined import (
    Fit,
    Samples,
    colour,
    fit_model,
    fit_tests,
    fit_with_disturbance,
    plain_prediction,
)
from tactuator.identification.estimate.structure import RationalModel, Structure
from tactuator.identification.evidence.empirical import EmpiricalResponse
from tactuator.identification.evidence.residuals import ResidualTests

_WORTHWHILE = 0.004
"""Drop of the squared error, in parts, for which one more parameter is taken."""


_SLACK = 20.0
"""Error of the empirical fit, in squared standard errors, that is not worth another pole before the record is asked."""


_MISSPECIFIED = 0.02
"""Share of the residual that follows the command from which on no noise model is trusted."""
_UNDETERMINED = 1e11
"""Condition of the information matrix beyond which parameters cannot be told apart."""
_POOR = 0.02
"""Share of the position's power that a first fit may leave before friction is suspected to rule the record."""


@dataclass(frozen=True)
class Candidate:
    """One structure that was tried: squared innovation, chance that nothing is left (score test; nan: not tested), the
    hold it was tried under and how far its criterion is behind the best (Bayes; nan: not known)."""

    poles: int
    zeros: int
    dead_time: bool
    cost: float
    uncorrelated_p: float
    hold: str = "zero-order"
    behind: float = float("nan")


@dataclass(frozen=True, eq=False)
class Selection:
    """The fit chosen and all that were tried."""

    fit: Fit
    tests: ResidualTests
    tried: tuple[Candidate, ...]


def choose_structure(
    samples: Samples,
    response: EmpiricalResponse,
    *,
    order: int | None = None,
    most_poles: int = 6,
    integrated: int = 0,
    delay_s: float = 0.0,
    estimate_delay: bool = True,
    friction: bool = True,
    note: Callable[[str], None] = lambda _: None,
) -> Selection:
    """Add to the simplest structure that fits the empirical response a zero, a pole or a dead time as long as the
    residual still depends on the command and the addition pays for itself (Bayes' criterion, and 0.4 % of the error).

    order: number of poles, if given. delay_s: dead time known beforehand; estimated from there if estimate_delay.
    """
    first, model = _first(samples, response, order, most_poles, integrated, delay_s, estimate_delay)
    fit = fit_with_disturbance(samples, first, model, friction=friction)
    left = plain_prediction(samples, fit)[0].cost / (samples.position.size * float(np.var(samples.position)))
    if friction and left > _POOR:
        fit = _or_friction_fit(samples, fit, order, most_poles, integrated)
    tried = []
    while True:
        tests = fit_tests(samples, fit)
        p_value = tests.uncorrelated_p
        tried.append(_candidate(fit, p_value))
        note(f"{fit.structure.poles} poles, {fit.structure.zeros} zeros")
        if p_value > 0.01 or tests.unexplained < _WORTHWHILE or samples.position.size < 400:
            break
        better = _best_extension(samples, response, fit, order or most_poles, order is not None, estimate_delay)
        if better is None:
            break
        fit = colour(samples, better, rounds=1)
    settled = _settle_delay(samples, _simplified(samples, fit, order is not None))
    if settled is not fit:
        fit, tests = settled, fit_tests(samples, settled)
    if not tests.uncorrelated_with_input and tests.unexplained > _MISSPECIFIED and fit.disturbance.whitener is not None:
        # the structure cannot say it all: the smallest error of the simulated position is then worth more than the
        # smallest of the one-step prediction
        white = replace(fit.disturbance, whitener=None)
        fit = fit_model(samples, fit.structure, fit.model, white, fit.coulomb)
        tests = fit_tests(samples, fit)
    return Selection(fit, tests, tuple(tried))


def _first(
    samples: Samples,
    response: EmpiricalResponse,
    order: int | None,
    most_poles: int,
    integrated: int,
    delay_s: float,
    estimate_delay: bool,
) -> tuple[Structure, RationalModel]:
    """Return the structure of fewest parameters that fits the empirical response about as well as a rich one."""
    response = response.trusted()
    richest = order or min(most_poles, 4)
    rich = Structure(richest, max(richest - 1, integrated), integrated=integrated)
    best = (rich, *rational_start(response, rich, samples.rate_hz, delay_s))
    limit = 1.3 * best[2] + _SLACK
    for structure in _by_size(order, min(most_poles, 4), integrated, estimate_delay):
        model, error = rational_start(response, structure, samples.rate_hz, delay_s)
        if error <= limit:
            return structure, model
        if error < best[2]:
            best = (structure, model, error)
    return best[0], best[1]


def _by_size(order: int | None, most_poles: int, integrated: int, estimate_delay: bool) -> list[Structure]:
    """Return the structures up to 3 parameters beside the poles, those of fewer parameters first, no dead time before
    one.
    """
    poles = [order] if order is not None else list(range(max(1, integrated), most_poles + 1))
    made = [
        Structure(n, m, late, integrated)
        for n in poles
        for late in ((False, True) if estimate_delay else (False,))
        for m in range(integrated, max(n, integrated + 1))
    ]
    return sorted(made, key=lambda one: (one.count, one.dead_time, one.poles))


def _candidate(fit: Fit, p_value: float) -> Candidate:
    structure = fit.structure
    return Candidate(structure.poles, structure.zeros, structure.dead_time, fit.cost, p_value)


def _extensions(structure: Structure, most_poles: int, estimate_delay: bool) -> Iterator[Structure]:
    if estimate_delay and not structure.dead_time and structure.zeros < structure.poles:
        yield replace(structure, dead_time=True)
    if structure.zeros < structure.poles - (1 if structure.dead_time else 0):
        yield replace(structure, zeros=structure.zeros + 1)
    if structure.poles < most_poles:
        yield replace(structure, poles=structure.poles + 1, zeros=structure.zeros)
        yield replace(structure, poles=structure.poles + 1, zeros=structure.zeros + 1)


def _best_extension(
    samples: Samples, response: EmpiricalResponse, fit: Fit, most_poles: int, fixed: bool, estimate_delay: bool
) -> Fit | None:
    limit = fit.structure.poles if fixed else most_poles
    count = fit.minimum.prediction.residual.size
    best: Fit | None = None
    best_score = count * np.log(fit.cost)
    for structure in _extensions(fit.structure, limit, estimate_delay):
        for start in _starts(samples, response, fit, structure):
            candidate = fit_model(samples, structure, start, fit.disturbance, fit.coulomb, most=10)
            if not candidate.cost <= (1.0 - _WORTHWHILE) * fit.cost or _condition(candidate) > _UNDETERMINED:
                continue
            score = count * np.log(candidate.cost) + np.log(count) * (structure.count - fit.structure.count)
            if score < best_score:
                best, best_score = candidate, score
    return best


def _starts(samples: Samples, response: EmpiricalResponse, fit: Fit, structure: Structure) -> Iterator[RationalModel]:
    """Return the present model, extended; where poles are added, the empirical fit as well."""
    model = fit.model
    if structure.poles == fit.structure.poles:
        yield model
        return
    made, _ = rational_start(response.trusted(), structure, samples.rate_hz, model.delay_s)
    yield made


def _or_friction_fit(samples: Samples, fit: Fit, order: int | None, most_poles: int, integrated: int) -> Fit:
    """Return the fit, or one that starts from friction among the regressors if that explains clearly more."""
    plain = plain_prediction(samples, fit)[0].cost
    for poles in [order] if order is not None else range(max(1, integrated), min(most_poles, 3) + 1):
        resisted = friction_fit(samples, poles, integrated)
        if resisted is not None and resisted.cost < 0.8 * plain:
            fit, plain = colour(samples, resisted), resisted.cost
    return fit


def _simplified(samples: Samples, fit: Fit, keep_poles: bool) -> Fit:
    """Return the fit without a pole, a zero, or both, as long as the fit is no worse than the parameter was worth."""
    while fit.structure.zeros > fit.structure.integrated or _condition(fit) > _UNDETERMINED:
        count = fit.minimum.prediction.residual.size
        smaller = [_fitted_smaller(samples, fit, one) for one in _reductions(fit.structure, keep_poles)]
        fitting = [
            one
            for one in smaller
            if count * np.log(one.cost / fit.cost)
            < max(np.log(count), _WORTHWHILE * count) * (fit.structure.count - one.structure.count)
        ]
        if not fitting:
            break
        fit = min(fitting, key=lambda one: (one.structure.count, one.cost))
    return fit


def _reductions(structure: Structure, keep_poles: bool) -> Iterator[Structure]:
    n, m, least = structure.poles, structure.zeros, structure.integrated
    if not keep_poles and n > max(1, least):
        if m > least:
            yield replace(structure, poles=n - 1, zeros=m - 1)
        elif m <= n - 1:
            yield replace(structure, poles=n - 1, zeros=m)
    if m > least:
        yield replace(structure, zeros=m - 1)


def _fitted_smaller(samples: Samples, fit: Fit, structure: Structure) -> Fit:
    """Return the smaller structure, fitted to the response of the larger one first, then to the record."""
    frequency = np.geomspace(2.0 / samples.position.size, 0.4, 120) * samples.rate_hz
    value = fit.model.response(frequency)
    omega = 2.0 * np.pi * frequency
    hold = -np.expm1(-1j * omega / samples.rate_hz) / (1j * omega / samples.rate_hz)
    weight = np.full(frequency.size, 0.05) + 0.3 * np.abs(value) / np.max(np.abs(value))
    like = EmpiricalResponse(frequency, value * hold, 0.1 / weight, np.ones(frequency.size), weight)
    start, _ = rational_start(like, structure, samples.rate_hz, fit.model.delay_s)
    return fit_model(samples, structure, start, fit.disturbance, fit.coulomb)


def _condition(fit: Fit) -> float:
    jacobian = fit.minimum.prediction.jacobian[:, : fit.structure.count]
    if jacobian.size == 0:
        return np.inf
    size = np.linalg.norm(jacobian, axis=0)
    size[size == 0.0] = 1.0
    return float(np.linalg.cond(jacobian.T @ jacobian / np.outer(size, size)))


def _settle_delay(samples: Samples, fit: Fit) -> Fit:
    """Set a dead time that cannot be told from a whole number of samples to that number."""
    if not fit.structure.dead_time:
        return fit
    jacobian = fit.minimum.prediction.jacobian
    index = fit.structure.count - 1
    gram = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-14)
    error_s = np.sqrt(max(gram[index, index], 0.0) * fit.cost / jacobian.shape[0]) / fit.model.scale_rad_s
    whole = round(fit.model.delay_s * samples.rate_hz) / samples.rate_hz
    if 3.0 * error_s > 0.3 / samples.rate_hz and whole > 0.0:
        return fit
    if abs(fit.model.delay_s - whole) > max(3.0 * error_s, 0.02 / samples.rate_hz):
        return fit
    structure = replace(fit.structure, dead_time=False)
    start = replace(fit.model, delay_s=whole)
    settled = fit_model(samples, structure, start, fit.disturbance, fit.coulomb)
    return settled if settled.cost <= fit.cost * (1.0 + 20.0 / jacobian.shape[0]) else fit
