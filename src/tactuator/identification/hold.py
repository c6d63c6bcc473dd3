"""The effect of a continuous model on the lines of a sampled command, by what the command does between its samples.

Held commands: the answer of 1/(s - p) to a command that is constant between samples, exact with any dead time.
Band-limited commands: the response itself (Pintelon and Schoukens, System Identification: A Frequency Domain Approach,
2012, chapter 6).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.form import (
    Form,
    Stages,
    all_poles,
    denominator_values,
    numerator_values,
    separated,
)

Hold = Literal["zero-order", "first-order", "band-limited"]
HOLDS: tuple[Hold, ...] = ("zero-order", "first-order", "band-limited")
_CLOSE = 0.02
"""Distance between poles, over their size, from which on both move smoothly with the coefficients."""
_EDGE = 10
"""Samples at either end of the record that are given up: what came before and comes after shows there."""


@dataclass(frozen=True, eq=False)
class Grid:
    """The lines of a record: frequency_hz (m,), of a record sampled at rate_hz whose position was shifted ahead by
    `shift` samples.
    """

    frequency_hz: FloatArray
    rate_hz: float
    scale_rad_s: float
    hold: Hold
    shift: int = 0

    @cached_property
    def s(self) -> ComplexArray:
        """Return i omega in scaled time, (m,)."""
        return np.asarray(2j * np.pi * self.frequency_hz / self.scale_rad_s)

    @property
    def period(self) -> float:
        """Return the sampling period in scaled time."""
        return self.scale_rad_s / self.rate_hz

    @cached_property
    def back(self) -> ComplexArray:
        """Return one sample back, 1/z, (m,)."""
        return np.asarray(np.exp(-2j * np.pi * self.frequency_hz / self.rate_hz))

    @cached_property
    def step(self) -> ComplexArray:
        """Return 1 - 1/z to full precision, (m,)."""
        return np.asarray(-np.expm1(-2j * np.pi * self.frequency_hz / self.rate_hz))

    def like(self, scale_rad_s: float, hold: Hold) -> Grid:
        """Return the same lines in another scale of time, under a hold; what depends on neither is not done again."""
        grid = replace(self, scale_rad_s=scale_rad_s, hold=hold)
        grid.__dict__.update(back=self.back, step=self.step)
        return grid

    @cached_property
    def _powers(self) -> dict[float, ComplexArray]:
        return {}

    def back_by(self, samples: float) -> ComplexArray:
        """Return a whole number of samples back, (m,)."""
        if samples == 1.0:
            return self.back
        if samples not in self._powers:
            self._powers[samples] = np.exp(-2j * np.pi * samples * self.frequency_hz / self.rate_hz)
        return self._powers[samples]

    def late(self, delay: float) -> ComplexArray:
        """Return the dead time's factor for a band-limited command, (m,)."""
        return np.asarray(np.exp(-self.s * (delay - self.shift * self.period)))

    @cached_property
    def _lags(self) -> dict[bytes, ComplexArray]:
        return {}

    def decays(self, poles: ComplexArray) -> ComplexArray:
        """Return the lines of a decay, 1/(1 - exp(p T)/z), of each pole (n,), shape (n, m), to full precision.

        Those of the last poles are kept: response, transient and slopes at one point ask for the same.
        """
        key = poles.tobytes()
        if key not in self._lags:
            fall = -np.expm1(_bounded(poles * self.period))[:, None]
            self._lags.clear()
            self._lags[key] = 1.0 / (self.step * (1.0 - fall) + fall)
        return self._lags[key]


def response_columns(grid: Grid, theta: FloatArray, delay: float, form: Form, stages: Stages) -> ComplexArray:
    """Return what each numerator stage makes of the command's lines, (m, numerators)."""
    if grid.hold == "band-limited":
        under = denominator_values(theta, form, grid.s)
        return np.asarray(numerator_values(stages, grid.s, form) * (grid.late(delay) / under)[:, None])
    poles = separated(all_poles(theta, form))
    slope = _slopes_at(poles)
    columns = _held(grid, poles, delay) @ (numerator_values(stages, poles, form) / slope[:, None])
    if form.zeros == form.poles:
        whole, part = divmod(delay / grid.period - grid.shift, 1.0)
        columns[:, -1] += grid.back_by(whole) * (1.0 - part + part * grid.back)
    return np.asarray(columns)


def _slopes_at(poles: ComplexArray) -> ComplexArray:
    """Return the derivative of the monic polynomial of those poles at each of them, (..., n)."""
    apart = poles[..., :, None] - poles[..., None, :]
    apart[..., range(poles.shape[-1]), range(poles.shape[-1])] = 1.0
    return np.asarray(np.prod(apart, axis=-1))


def _held(grid: Grid, poles: ComplexArray, delay: float) -> ComplexArray:
    """Return the answer of 1/(s - p), late by `delay`, to the lines of a held command, (m, n)."""
    whole, part = divmod(delay / grid.period - grid.shift, 1.0)
    period = grid.period
    if grid.hold == "first-order":
        return _ramped(grid, poles, whole, part)
    now = _integral(poles, (1.0 - part) * period)[:, None]
    before = np.exp(_bounded(poles * (1.0 - part) * period)) * _integral(poles, part * period)
    return _rows(grid.back_by(whole + 1.0) * (now + before[:, None] * grid.back) * grid.decays(poles))


def _rows(columns: ComplexArray) -> ComplexArray:
    """Return what was worked out pole by pole (n, m), since NumPy is quicker along long rows, line by line (m, n)."""
    return np.ascontiguousarray(columns.T)


def held_slopes(
    grid: Grid, theta: FloatArray, delay: float, form: Form, stages: Stages, numerator: FloatArray, steps: FloatArray
) -> ComplexArray | None:
    """Return the derivatives of the zero-order hold's response by theta and dead time, (m, k), over `steps` of each
    coefficient; None where poles lie so close together that they do not move smoothly.

    The response is a sum over poles, each with its weight and its own answer to the command: along a coefficient both
    change, which needs the answers and their slopes once for all coefficients.
    """
    poles = all_poles(theta, form)
    apart = np.abs(poles[:, None] - poles[None, :]) + np.diag(np.full(poles.size, np.inf))
    if np.any(apart < _CLOSE * np.abs(poles)[:, None]):
        return None

    places = np.stack([poles, *(all_poles(theta + step, form) for step in np.diag(steps))])
    tops = (numerator_values(stages, places.ravel(), form) @ numerator).reshape(places.shape)
    weights, by_step = tops / _slopes_at(places), steps[:, None]
    here = weights[0]
    turned, shifted = (weights[1:] - here) / by_step, here * (places[1:] - poles) / by_step
    whole, part = divmod(delay / grid.period - grid.shift, 1.0)
    period, back = grid.period, grid.back
    rest, first = (1.0 - part) * period, part * period
    fade = np.exp(_bounded(poles * rest))
    now, before = _integral(poles, rest), fade * _integral(poles, first)
    now_slope = _integral_slope(poles, rest)
    before_slope = rest * before + fade * _integral_slope(poles, first)
    decays, decay = grid.decays(poles), np.exp(_bounded(poles * period))
    answer = (now[:, None] + before[:, None] * back) * decays
    ahead = answer * ((period * decay)[:, None] * back)
    slope = (now_slope[:, None] + before_slope[:, None] * back + ahead) * decays
    slopes = _rows(answer) @ _rows(turned) + _rows(slope) @ _rows(shifted)
    if form.dead_time:
        later = ((decay - poles * before)[:, None] * back - fade[:, None]) * decays
        slopes = np.hstack([slopes, _rows(later) @ here[:, None]])
    slopes = slopes * grid.back_by(whole + 1.0)[:, None]
    if form.dead_time and form.zeros == form.poles:
        slopes[:, -1] -= numerator[-1] * grid.back_by(whole) * grid.step / period
    return np.asarray(slopes)


def _ramped(grid: Grid, poles: ComplexArray, whole: float, part: float) -> ComplexArray:
    """Return the same for a command that is straight between samples; the dead time's fraction is interpolated."""
    period, back = grid.period, grid.back[:, None]
    first = _integral(poles, period)
    second = np.where(np.abs(poles * period) < 1e-4, 0.5 * period**2, (first - period) / np.where(poles == 0, 1, poles))
    early, late = second / period, first - second / period
    exact = (early + late * back) * grid.decays(poles).T
    return np.asarray(grid.back_by(whole)[:, None] * (1.0 - part + part * back) * exact)


def _integral(poles: ComplexArray, duration: float) -> ComplexArray:
    """Return the integral of exp(p t) over 0 .. duration, (n,)."""
    turned = poles * duration
    grown, small = np.expm1(_bounded(turned)), np.abs(turned) < 1e-8
    return np.where(small, duration, grown / np.where(small, 1.0, poles)) if small.any() else grown / poles


def _integral_slope(poles: ComplexArray, duration: float) -> ComplexArray:
    """Return the derivative of `_integral` by the pole, (n,)."""
    small = np.abs(poles * duration) < 1e-4
    exact = (duration * np.exp(_bounded(poles * duration)) - _integral(poles, duration)) / np.where(small, 1.0, poles)
    return np.where(small, 0.5 * duration**2 + poles * duration**3 / 3.0, exact)


def _bounded(exponent: NDArray[Any]) -> ComplexArray:
    return np.asarray(np.minimum(exponent.real, 40.0) + 1j * exponent.imag)


def edge_columns(grid: Grid) -> ComplexArray:
    """Return what the ends of the record, `_EDGE` samples each, and a drift may add to the position's lines, (m, k).

    The coefficients are real.
    """
    columns = [grid.back ** float(k) for k in range(-_EDGE, _EDGE + 1)]
    return np.stack([*columns, 1.0 / grid.step], axis=1)


def edge_lines(weights: FloatArray, samples: int) -> ComplexArray:
    """Return the sum of `edge_columns` with weights (k,) on all lines of a record, (samples // 2 + 1,)."""
    edges = weights[-1] * (1.0 - np.arange(1.0, samples + 1.0) / samples)
    for k, weight in zip(range(-_EDGE, _EDGE + 1), weights[:-1], strict=True):
        edges[k % samples] += weight
    return np.asarray(np.fft.rfft(edges))


def transient_columns(grid: Grid, theta: FloatArray, form: Form) -> ComplexArray:
    """Return what the state before the record may add to the position's lines: a decay of each pole, (m, poles)."""
    poles = separated(all_poles(theta, form))
    lines = grid.decays(poles)
    columns: list[ComplexArray] = []
    for k in np.flatnonzero(poles.imag >= -1e-14):
        if poles[k].imag > 1e-14:
            other = lines[np.argmin(np.abs(poles - np.conj(poles[k])))]
            columns += [lines[k] + other, 1j * (lines[k] - other)]
        else:
            columns.append(lines[k])
    return np.stack(columns, axis=1)
