"""Choice of the model's structure: as few poles and zeros as leave nothing of the command in the residual."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactuator.identify.empirical import EmpiricalResponse
from tactuator.identify.refined import Fit, Samples, colour, fit_model, fit_tests, fit_with_disturbance
from tactuator.identify.residuals import ResidualTests
from tactuator.identify.start import rational_start
from tactuator.identify.structure import RationalModel, Structure

Array = NDArray[np.float64]
_WORTHWHILE = 0.004
"""Drop of the squared error, in parts, for which one more parameter is taken."""


_SLACK = 20.0
"""Error of the empirical fit, in squared standard errors, that is not worth another pole before the record is asked."""


@dataclass(frozen=True)
class Candidate:
    """One structure that was tried: squared innovation over the best, chance that nothing is left (score test)."""

    poles: int
    zeros: int
    dead_time: bool
    cost: float
    uncorrelated_p: float


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
    """From the simplest structure that fits the empirical response, add a zero, a pole or a dead time as long as the
    residual still depends on the command and the addition pays for itself (Bayes' criterion, and 0.4 % of the error).

    order: number of poles, if given. delay_s: dead time known beforehand; estimated from there if estimate_delay.
    """
    first, model = _first(samples, response, order, most_poles, integrated, delay_s)
    fit = fit_with_disturbance(samples, first, model, friction=friction)
    tried = []
    while True:
        tests = fit_tests(samples, fit)
        p_value = tests.uncorrelated_p
        tried.append(_candidate(fit, p_value))
        note(f"{fit.structure.poles} poles, {fit.structure.zeros} zeros")
        if p_value > 0.01 or samples.position.size < 400:
            break
        better = _best_extension(samples, response, fit, order or most_poles, order is not None, estimate_delay)
        if better is None:
            break
        fit = colour(samples, better, rounds=1)
    settled = _settle_delay(samples, fit)
    if settled is not fit:
        fit, tests = settled, fit_tests(samples, settled)
    return Selection(fit, tests, tuple(tried))


def _first(
    samples: Samples,
    response: EmpiricalResponse,
    order: int | None,
    most_poles: int,
    integrated: int,
    delay_s: float,
) -> tuple[Structure, RationalModel]:
    """By the empirical response: fewest poles whose error is near the best, then fewest zeros."""
    response = response.trusted()
    if order is not None:
        chosen, error = order, _start_error(response, order, integrated, samples.rate_hz, delay_s)
    else:
        chosen, error = _fewest_poles(response, most_poles, integrated, samples.rate_hz, delay_s)
    limit = 1.3 * error + _SLACK
    for zeros in range(integrated, max(chosen - 1, integrated) + 1):
        structure = Structure(chosen, zeros, integrated=integrated)
        model, cost = rational_start(response, structure, samples.rate_hz, delay_s)
        if cost <= limit:
            return structure, model
    return structure, model


def _start_error(response: EmpiricalResponse, poles: int, integrated: int, rate_hz: float, delay_s: float) -> float:
    """Error of the empirical fit with all the zeros that a falling response can have."""
    structure = Structure(poles, max(poles - 1, integrated), integrated=integrated)
    return rational_start(response, structure, rate_hz, delay_s)[1]


def _fewest_poles(
    response: EmpiricalResponse, most_poles: int, integrated: int, rate_hz: float, delay_s: float
) -> tuple[int, float]:
    """The fewest poles that one more does not improve on, and their error."""
    poles = max(1, integrated)
    error = _start_error(response, poles, integrated, rate_hz, delay_s)
    while poles < min(most_poles, 4):
        ahead = [_start_error(response, poles + 1, integrated, rate_hz, delay_s)]
        if error > 1.3 * ahead[0] + _SLACK:
            poles, error = poles + 1, ahead[0]
            continue
        if poles + 2 <= min(most_poles, 4):
            # a resonance takes two poles at once
            ahead.append(_start_error(response, poles + 2, integrated, rate_hz, delay_s))
        if error > 1.5 * ahead[-1] + _SLACK:
            poles, error = poles + len(ahead), ahead[-1]
            continue
        break
    return poles, error


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
            trial = fit_model(samples, structure, start, fit.disturbance, fit.coulomb, most=10)
            if not trial.cost <= (1.0 - _WORTHWHILE) * fit.cost:
                continue
            score = count * np.log(trial.cost) + np.log(count) * (structure.count - fit.structure.count)
            if score < best_score:
                best, best_score = trial, score
    return best


def _starts(samples: Samples, response: EmpiricalResponse, fit: Fit, structure: Structure) -> Iterator[RationalModel]:
    """The present model, extended; where poles are added, the empirical fit as well."""
    model = fit.model
    if structure.poles == fit.structure.poles:
        yield model
        return
    made, _ = rational_start(response.trusted(), structure, samples.rate_hz, model.delay_s)
    yield made


def _settle_delay(samples: Samples, fit: Fit) -> Fit:
    """A dead time that cannot be told from a whole number of samples is that number."""
    if not fit.structure.dead_time:
        return fit
    jacobian = fit.minimum.prediction.jacobian
    index = fit.structure.count - 1
    gram = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-14)
    error_s = np.sqrt(max(gram[index, index], 0.0) * fit.cost / jacobian.shape[0]) / fit.model.scale_rad_s
    whole = round(fit.model.delay_s * samples.rate_hz) / samples.rate_hz
    if abs(fit.model.delay_s - whole) > max(3.0 * error_s, 0.02 / samples.rate_hz):
        return fit
    structure = replace(fit.structure, dead_time=False)
    start = replace(fit.model, delay_s=whole)
    settled = fit_model(samples, structure, start, fit.disturbance, fit.coulomb)
    return settled if settled.cost <= fit.cost * (1.0 + 20.0 / jacobian.shape[0]) else fit
