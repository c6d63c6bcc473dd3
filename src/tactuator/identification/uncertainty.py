"""The reach of the response's error: noise, forms that the record does not exclude, and what the form cannot follow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.form import (
    Form,
    denominator_polynomial,
    monic_values,
    numerator_polynomial,
    numerator_values,
    numerator_weights,
    section_list,
    sections_of,
    stages_of,
)
from tactuator.identification.hold import Grid, Hold, response_columns
from tactuator.identification.likelihood import SpectralFit, nonlinear_slopes
from tactuator.identification.lines import POOLED, LocalResponse, Spectrum
from tactuator.identification.search import SHOWN_LATE, Choice
from tactuator.model.plant_model import Z95, Excess, PlantModel
from tactuator.signals.spectra import mean_over_frequency

FLOOR = 5e-4
"""Deviation that no band goes below, 0.0085 dB at 95 %: two channels' converters and filters are not more alike."""
_FEWEST = 7
"""Points of a mean over frequency at least."""


def log_slopes(fit: SpectralFit, frequency_hz: FloatArray) -> ComplexArray:
    """Return the derivatives of the response's logarithm by (numerator, theta, dead time), (m, k)."""
    s: ComplexArray = np.asarray(2j * np.pi * frequency_hz / fit.grid.scale_rad_s)
    stages = numerator_values(fit.stages, s, fit.form)
    top = stages @ fit.numerator
    columns: list[ComplexArray] = [stage / top for stage in stages.T]
    for section in section_list(fit.theta, fit.form):
        under = monic_values(section, s)
        columns += [-s / under] * (section.size == 3) + [-1.0 / under]
    return np.stack([*columns, *[-s] * fit.form.dead_time], axis=1)


def other_forms(choice: Choice, frequency_hz: FloatArray) -> Excess:
    """Return what the forms that the record does not exclude add: their mean squared departure, weighted by Bayes."""
    best = choice.fit
    value = best.response(frequency_hz)
    slopes = log_slopes(best, frequency_hz)
    spread = choice.problem.covariance_of(best)
    lowest = min(choice.problem.criterion(fit) for fit in choice.fits.values())
    total, magnitude, phase = 0.0, np.zeros(frequency_hz.size), np.zeros(frequency_hz.size)
    own_variance = variances(slopes, spread)
    for fit in choice.fits.values():
        behind = choice.problem.criterion(fit) - lowest
        # difference of the criterion beyond which a form does not count (odds of 1 : 1100)
        if behind > 14.0:
            continue
        weight = float(np.exp(-0.5 * behind))
        total += weight
        if fit is best:
            continue
        away = np.log(fit.response(frequency_hz) / value)
        variance = variances(log_slopes(fit, frequency_hz), choice.problem.covariance_of(fit))
        magnitude += weight * np.maximum(away.real**2 + variance[0] - own_variance[0], 0.0)
        phase += weight * np.maximum(away.imag**2 + variance[1] - own_variance[1], 0.0)
    return Excess(frequency_hz, np.sqrt(magnitude / max(total, 1e-300)), np.sqrt(phase / max(total, 1e-300)))


def variances(slopes: ComplexArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the variances of a logarithm's real and imaginary part, (m,) each, by those of parameters."""
    both = [np.einsum("ij,jk,ik->i", part, covariance, part) for part in (slopes.real, slopes.imag)]
    return np.maximum(both[0], 0.0), np.maximum(both[1], 0.0)


def indistinct(choice: Choice, local: LocalResponse, shifts: FloatArray | None = None) -> Callable[[SpectralFit], bool]:
    """Return the test whether a fit's response lies within the band of the chosen one wherever the record shows its
    own response, and below where it shows that late: the noise, other forms, and what the form does not follow; no
    band is narrower than `FLOOR`.

    shifts: further deviations of (numerator, theta, dead time), (k, parameters).
    """
    best, seen_hz = choice.fit, local.frequency_hz
    lowest_hz = float(choice.problem.grid.frequency_hz.min())
    # frequencies below those at which the record shows its own response, at which forms are held against each other
    below = np.geomspace(lowest_hz, seen_hz[0], 20 if seen_hz[0] > SHOWN_LATE * lowest_hz else 0, endpoint=False)
    hertz = np.concatenate([below, seen_hz])
    wanted, beyond = best.response(hertz), other_forms(choice, hertz)
    rest = np.hypot(FLOOR, left_over(best, local, response_of_rows(best, seen_hz), hertz))
    covariance = choice.problem.covariance_of(best) + (0.0 if shifts is None else shifts.T @ shifts)
    of_best = variances(log_slopes(best, hertz), covariance)
    pairs = zip(of_best, (beyond.magnitude, beyond.phase_rad), strict=True)
    reach = [Z95 * np.sqrt(variance + rest**2 + excess**2) for variance, excess in pairs]

    def is_within(fit: SpectralFit) -> bool:
        away = np.log(fit.response(hertz) / wanted)
        return bool(np.all(np.abs(away.real) <= reach[0]) and np.all(np.abs(away.imag) <= reach[1]))

    return is_within


def left_over(fit: SpectralFit, local: LocalResponse, seen: ComplexArray, frequency_hz: FloatArray) -> FloatArray:
    """Return the relative error, (m,), by which the record's own response departs from the model beyond its noise.

    seen: the model's response at the local points, hold included. Means over 15 % of frequency; what feedback of the
    noise may have turned in the local estimate is allowed for.
    """
    off = np.abs(local.value - seen) ** 2
    fed_back = (local.noise / np.maximum(local.excitation * np.abs(seen), 1e-300)) ** 2
    allowed = local.variance + np.minimum(fed_back, np.abs(seen) ** 2)
    place = local.frequency_hz
    values = np.stack([off / allowed, (off - allowed) / np.abs(seen) ** 2])
    beyond, relative = mean_over_frequency(values, place, place, 0.5 * POOLED, _FEWEST)
    low, high = (np.searchsorted(place, (1.0 + half) * place) for half in (-0.5 * POOLED, 0.5 * POOLED))
    count = np.maximum(high - low, min(_FEWEST, place.size))
    relative_error = np.where(beyond > 1.0 + 4.0 / np.sqrt(count), np.sqrt(np.maximum(relative, 0.0)), 0.0)
    return np.interp(np.log(frequency_hz), np.log(place), relative_error)


def fed_back(choice: Choice, spectra: Sequence[Spectrum]) -> FloatArray | None:
    """Return the bias (numerator, theta, dead time) that noise in an analogue loop may leave; None for a held command.

    The noise that a loop feeds back drops out of the likelihood over all frequencies; a band-limited record ends below
    half the rate, and what lies above is missing. It follows from the model beyond and from the noise's share in the
    command, seen in the upper part of the record and taken as constant from there.
    """
    fit, problem = choice.fit, choice.problem
    if choice.hold != "band-limited":
        return None
    top = choice.problem.given.of_hz[choice.problem.weight > 0.0].max()
    power = by_chance = 0.0
    shared = 0.0 + 0.0j
    for taken in spectra:
        hertz = taken.frequency_hz
        upper = np.flatnonzero((hertz > 0.6 * top) & (hertz < 0.95 * top))
        seen = fit.response(hertz[upper]) * np.exp(2j * np.pi * hertz[upper] * taken.shift / taken.rate_hz)
        rest = taken.position[upper] - seen * taken.command[upper]
        power += float(np.sum(np.abs(rest) ** 2))
        shared += complex(np.sum(taken.command[upper] * np.conj(rest)))
        by_chance += float(np.sum(np.abs(taken.command[upper] * rest) ** 2))
    share, chance = shared / max(power, 1e-300), float(np.sqrt(by_chance)) / max(power, 1e-300)
    share = share * max(1.0, chance / max(abs(share), 1e-300))
    beyond = np.geomspace(top, 50.0 * top, 400)
    grid = replace(problem.grid, frequency_hz=beyond, shift=0)
    linear = response_columns(grid, fit.theta, fit.delay, fit.form, fit.stages)
    bent = nonlinear_slopes(grid, fit.form, fit.theta, fit.delay, fit.numerator, fit.stages)
    slopes = np.hstack([linear, bent])
    lines_per_hz = sum(1.0 / taken.spacing_hz for taken in spectra)
    missing = -np.trapezoid((slopes * share).real, beyond, axis=0) * lines_per_hz
    return np.asarray(2.0 * problem.covariance_of(fit) @ missing)


def moved(fit: SpectralFit, change: FloatArray) -> SpectralFit:
    """Return the fit with (numerator, theta, dead time) changed, its stages as they were."""
    first, last = fit.numerator.size, fit.numerator.size + fit.theta.size
    delay = fit.delay + float(change[-1]) if fit.form.dead_time else fit.delay
    return replace(fit, numerator=fit.numerator + change[:first], theta=fit.theta + change[first:last], delay=delay)


def physical(fit: SpectralFit, covariance: FloatArray, gain: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return num, den (descending powers of s in rad/s, den monic) and the covariance of (num, den[1:], delay_s).

    gain: position's unit over command's, as the lines were scaled.
    """
    num, den = _polynomials(fit, gain)
    size = num.size + den.size
    slopes = np.zeros((size, covariance.shape[0]))
    for j in range(covariance.shape[0]):
        step = np.zeros(covariance.shape[0])
        step[j] = 1e-5 * max(float(np.sqrt(covariance[j, j])), 1e-12)
        high, low = moved(fit, step), moved(fit, -step)
        above, below = _polynomials(high, gain), _polynomials(low, gain)
        late = (high.delay_s - low.delay_s) if fit.form.dead_time else 0.0
        change = np.concatenate([above[0] - below[0], (above[1] - below[1])[1:], [late]])
        slopes[:, j] = change / (2.0 * step[j])
    return num, den, slopes @ covariance @ slopes.T


def _polynomials(fit: SpectralFit, gain: float) -> tuple[FloatArray, FloatArray]:
    form: Form = fit.form
    scale = fit.grid.scale_rad_s
    num = numerator_polynomial(fit.stages, fit.numerator, form)
    den = denominator_polynomial(fit.theta, form)
    top, under = np.arange(num.size - 1, -1, -1.0), np.arange(den.size - 1, -1, -1.0)
    n = den.size - 1
    return gain * num * scale ** (n - top), den * scale ** (n - under)


def response_of_rows(fit: SpectralFit, rows: FloatArray) -> ComplexArray:
    """Return the sampled response (hold included) at frequencies `rows` (m,) of the unshifted record."""
    return response_on(fit, replace(fit.grid, frequency_hz=rows, shift=0))


def response_on(fit: SpectralFit, grid: Grid) -> ComplexArray:
    """Return the sampled response (hold included) on the lines of a grid in the fit's scale, (m,)."""
    return np.asarray(response_columns(grid, fit.theta, fit.delay, fit.form, fit.stages) @ fit.numerator)


def fit_of_model(model: PlantModel, rate_hz: float, hold: Hold, gain: float) -> SpectralFit:
    """Return the model as a fit whose command and position are scaled: gain is position's unit over command's."""
    poles, zeros = np.roots(model.den), model.num.size - 1
    size = np.abs(poles[poles != 0.0])
    scale = float(np.exp(np.mean(np.log(size)))) if size.size else rate_hz
    form = Form(poles.size, zeros, dead_time=True)
    theta = sections_of(poles / scale)
    stages = stages_of(theta, form)
    powers = poles.size - np.arange(zeros, -1, -1.0)
    numerator = numerator_weights(stages, model.num / gain / scale**powers, form)
    grid, late_s = Grid(np.zeros(0), rate_hz, scale, hold), model.delay_s - model.record.get("skew_s", 0.0)
    return SpectralFit(form, theta, late_s * scale, numerator, stages, grid, 0.0)
