"""The beginning of a fit: poles moved to where a linear fit of the local response puts them, for many dead times.

Source: Gustavsen and Semlyen, Rational approximation of frequency domain responses by vector fitting, 1999; the degree
of the numerator is kept.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.form import (
    Form,
    denominator_values,
    is_stable,
    numerator_values,
    sections_of,
    separated,
    stages_of,
)
from tactuator.identification.hold import Grid, Hold
from tactuator.identification.likelihood import SpectralFit, SpectralProblem
from tactuator.identification.lines import LocalResponse, points

_ALIKE = 3.0
"""Half of -2 log likelihood by which a fit may be behind that of another hold, from which it started."""
_WORTH, _WORTH_SHARE = 3e-2, 3e-8
"""What a step of a descent has to win of the cost, in itself and as a share, for another one: this is a beginning."""
_SOON = 20.0
"""Samples before which the beginning of the answer is no start for a dead time."""
_SHORT = (0.1, 0.4)
"""Shares of a step of the search for dead times that are tried too: a dead time may be shorter than the first step."""


class Starter:
    """Fits to one local response under one hold, and what was learnt from them on the way."""

    def __init__(
        self,
        local: LocalResponse,
        rate_hz: float,
        hold: Hold,
        scale_rad_s: float,
        arrival_s: float = 0.0,
        *,
        may_grow: bool = False,
        skewed: bool = False,
    ) -> None:
        self.local, self.hold, self._may_grow = local, hold, may_grow
        grid = Grid(local.frequency_hz, rate_hz, scale_rad_s, hold)
        self.problem = SpectralProblem(
            points(local.frequency_hz, local.value, rate_hz), local.weight, grid, with_transient=False, skewed=skewed
        )
        # what the hold adds, aliases aside, is taken off; the descent has the exact one
        turn = 2j * np.pi * local.frequency_hz / rate_hz
        held = -np.expm1(-turn) / turn
        self._target = local.value / {"zero-order": held, "first-order": np.abs(held) ** 2, "band-limited": 1.0}[hold]
        strength = np.minimum(np.abs(local.value) ** 2 / np.maximum(local.variance, 1e-300), 1e4)
        seen = local.frequency_hz[strength > 10.0] if np.sum(strength > 10.0) > 3 else local.frequency_hz
        self.low_hz, self.high_hz = float(seen.min()), float(seen.max())
        self._scale, self._rate_hz = scale_rad_s, rate_hz
        self._last_delay: float | None = None
        self._arrival = [arrival_s * scale_rad_s] if arrival_s * rate_hz > _SOON else []

    def fit(
        self, form: Form, delay: float = 0.0, near: SpectralFit | None = None, hopeless: float = np.inf
    ) -> SpectralFit | None:
        """Return the best fit of that form; `delay` (scaled) holds where the form has no dead time to estimate.

        near: the fit of that form under another hold, to start from; where this comes out as good, no other start is
        tried. hopeless: the cost beyond which nothing more is tried after a few steps.
        """
        if near is not None:
            ahead = 0.5 if self.hold == "band-limited" else -0.5
            lag = max(near.delay + ahead * self.problem.grid.period, self.problem.earliest) if form.dead_time else delay
            begun = self._descent(form, near.theta, lag, hopeless)
            if begun is not None and begun.cost < near.cost + _ALIKE:
                return begun
        candidates = []
        for lag in self._lags(form) if form.dead_time else [delay]:
            poles = self._relocated(form, lag, np.arange(self._target.size), 5)
            for begun_at in [_mirrored(poles), *([poles] if self._may_grow and np.any(poles.real > 0.0) else [])]:
                with np.errstate(all="ignore"):
                    point = self.problem.evaluate(form, sections_of(begun_at), lag)
                if point is not None and np.isfinite(point.cost):
                    candidates.append(point)
        candidates.sort(key=lambda candidate: candidate.cost)
        fits, begun_from = [], list[tuple[float, bool]]()
        for point in candidates[: 2 if form.poles < 4 else 1]:
            # the search for dead times comes upon one and the same again
            # difference of dead times, samples, within which they are one and the same start
            here, apart = (point.delay, is_stable(point.theta, form)), 1e-3 * self.problem.grid.period
            if all(here[1] != other[1] or abs(here[0] - other[0]) > apart for other in begun_from):
                begun_from.append(here)
                self.problem.keep(point)
                fits.append(self._descent(form, point.theta, point.delay, hopeless))
        finished = [candidate for candidate in fits if candidate is not None]
        if not finished:
            return None
        best = min(finished, key=lambda candidate: candidate.cost)
        if form.dead_time:
            self._last_delay = best.delay
        return best

    def _descent(self, form: Form, theta: FloatArray, lag: float, hopeless: float) -> SpectralFit | None:
        return self.problem.descend(form, theta, lag, most=10, gain=_WORTH, share=_WORTH_SHARE, hopeless=hopeless)

    def _lags(self, form: Form) -> list[float]:
        """Return the three best of many dead times by linear fits, coarse ones below a 16th of the highest frequency
        first; near the one found before, from three poles on.
        """
        if form.poles > 2 and self._last_delay is not None:
            return [self._last_delay, 0.6 * self._last_delay, *self._arrival]
        hertz = self.local.frequency_hz
        longest = max(min(400.0 / self._rate_hz, 0.5 / self.low_hz), 2.5 / self._rate_hz)
        best: list[float] = []
        for top in (self.high_hz / 16.0, self.high_hz / 4.0, self.high_hz):
            below = np.flatnonzero(hertz <= top)
            if below.size < 4 * form.count:
                continue
            # frequencies at which dead times are compared
            chosen = below[np.unique(np.linspace(0, below.size - 1, 120).astype(int))]
            step = max(0.3 / top, 0.4 / self._rate_hz)
            # dead times that are tried at the coarsest step
            near = [lag + k * step for lag in best for k in range(-4, 5)] or step * np.arange(1, 40)
            lags = [lag for lag in [*near, *(part * step for part in _SHORT)] if 0.0 < lag < longest] or [step]
            tried = np.array(sorted({round(lag * self._rate_hz, 6) / self._rate_hz for lag in lags}))
            if form.free == form.poles <= 2:
                costs = self._low_costs(form, tried * self._scale, chosen)
            else:
                costs = np.array([self._cost(form, lag * self._scale, chosen) for lag in tried])
            best = tried[np.argsort(costs, kind="stable")[:3]].tolist()
        return [*(lag * self._scale for lag in best), *self._arrival] or [0.5 * self._scale / self._rate_hz]

    def _low_costs(self, form: Form, lags: FloatArray, chosen: NDArray[np.int64]) -> FloatArray:
        """Return the misfit at all dead times (k,) at once for one or two poles, where coefficients are no trouble.

        The linear fit is weighted by its last denominator (Sanathanan and Koerner, 1963).
        """
        s, weight = self.problem.grid.s[chosen], self.problem.weight[chosen]
        goal = self._target[chosen] * np.exp(s * lags[:, None])
        top = s[:, None] ** np.arange(form.origin_zeros, form.zeros + 1)
        low = s[:, None] ** np.arange(form.poles)
        leading = s**form.poles
        under = np.polyval(np.poly(self._first_poles(form)), s) * np.ones((lags.size, 1))
        for _ in range(4):
            scaled = (weight / under)[:, :, None]
            columns = np.concatenate([np.broadcast_to(top, (lags.size, *top.shape)), -goal[:, :, None] * low], axis=2)
            solution, _ = _least_squares_of_all(columns * scaled, goal * leading * scaled[:, :, 0])
            # mirrored into the left half plane
            coefficients = np.abs(solution[:, top.shape[1] :])
            under = coefficients @ low.T + leading
        return _least_squares_of_all(top * (weight / under)[:, :, None], goal * weight)[1]

    def _cost(self, form: Form, lag: float, chosen: NDArray[np.int64]) -> float:
        s, weight = self.problem.grid.s[chosen], self.problem.weight[chosen]
        theta = sections_of(_mirrored(self._relocated(form, lag, chosen, 4)))
        columns = numerator_values(stages_of(theta, form), s, form)
        columns = columns * (weight * np.exp(-s * lag) / denominator_values(theta, form, s))[:, None]
        weights, matrix, values = _least_squares(columns, self._target[chosen] * weight)
        return float(np.sum((values - matrix @ weights) ** 2)) if np.all(np.isfinite(matrix)) else np.inf

    def _relocated(self, form: Form, lag: float, chosen: NDArray[np.int64], rounds: int) -> ComplexArray:
        """Return the poles after `rounds` of fitting numerator/A and sigma = 1 + sum r/(s - p), whose zeros follow: the
        last ones on whichever side they come out.
        """
        s, weight = self.problem.grid.s[chosen], self.problem.weight[chosen]
        target = self._target[chosen] * np.exp(s * lag)
        poles = self._first_poles(form)
        for _ in range(rounds if form.free else 0):
            poles = separated(_mirrored(poles))
            theta = sections_of(poles)
            top = numerator_values(stages_of(theta, form), s, form) / denominator_values(theta, form, s)[:, None]
            fractions = _fractions(s, poles)
            columns = np.hstack([top, -target[:, None] * fractions]) * weight[:, None]
            solution = _least_squares(columns, target * weight)[0]
            poles = _zeros_of_sigma(poles, solution[top.shape[1] :])
        return poles

    def _first_poles(self, form: Form) -> ComplexArray:
        """Return the lightly damped pairs over what the response shows, for an odd number a real pole amid them."""
        scale = 2.0 * np.pi / self.problem.grid.scale_rad_s
        pairs = np.geomspace(self.low_hz, self.high_hz, form.free // 2 + 2)[1:-1] * scale
        poles = [size * turn for size in pairs for turn in (-0.15 + 1j, -0.15 - 1j)]
        if form.free % 2:
            poles.append(complex(-0.8 * scale * np.sqrt(self.low_hz * self.high_hz)))
        return np.array(poles, dtype=np.complex128)


def _least_squares(columns: NDArray[Any], goal: NDArray[Any]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the real weights (c,) of columns (m, c) that fit the goal (m,) best, and both as real rows, (2 m, c)."""
    matrix = np.concatenate([columns.real, columns.imag])
    values = np.concatenate([goal.real, goal.imag])
    size = np.linalg.norm(matrix, axis=0)
    size[size == 0.0] = 1.0
    if not np.all(np.isfinite(matrix)):
        return np.zeros(matrix.shape[1]), matrix, values
    return np.linalg.lstsq(matrix / size, values, rcond=1e-12)[0] / size, matrix, values


def _least_squares_of_all(columns: NDArray[Any], goal: NDArray[Any]) -> tuple[FloatArray, FloatArray]:
    """Return the real weights (k, c) of columns (k, m, c) that fit goals (k, m) best, and what they leave, (k,)."""
    matrix = np.concatenate([columns.real, columns.imag], axis=1)
    values = np.concatenate([goal.real, goal.imag], axis=1)[:, :, None]
    size = np.maximum(np.linalg.norm(matrix, axis=1), 1e-300)
    matrix = matrix / size[:, None, :]
    turned = matrix.transpose(0, 2, 1)
    gram = turned @ matrix + 1e-12 * np.eye(matrix.shape[2])
    solution = np.linalg.solve(gram, turned @ values)
    rest = np.sum((values - matrix @ solution) ** 2, axis=(1, 2))
    return solution[:, :, 0] / size, np.where(np.isfinite(rest), rest, np.inf)


def _fractions(s: ComplexArray, poles: ComplexArray) -> ComplexArray:
    """Return 1/(s - p) with real coefficients: sum and difference of each conjugate pair, (m, n)."""
    columns = []
    for pole in poles[poles.imag >= -1e-13]:
        fraction = 1.0 / (s - pole)
        if pole.imag > 1e-13:
            other = 1.0 / (s - np.conj(pole))
            columns += [fraction + other, 1j * (fraction - other)]
        else:
            columns.append(fraction)
    return np.stack(columns, axis=1)


def _zeros_of_sigma(poles: ComplexArray, weights: FloatArray) -> ComplexArray:
    upper = poles[poles.imag >= -1e-13]
    n = poles.size
    a, b, i = np.zeros((n, n)), np.zeros(n), 0
    for pole in upper:
        if pole.imag > 1e-13:
            a[i : i + 2, i : i + 2] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
            b[i] = 2.0
            i += 2
        else:
            a[i, i], b[i] = pole.real, 1.0
            i += 1
    moved = a - np.outer(b, weights)
    return np.asarray(np.linalg.eigvals(moved) if np.all(np.isfinite(moved)) else poles, dtype=np.complex128)


def _mirrored(poles: ComplexArray) -> ComplexArray:
    """Move poles into the left half plane, and off the axis."""
    mirrored = np.where(poles.real > 0.0, -np.conj(poles), poles)
    on_axis = np.abs(mirrored.real) < 1e-4 * np.abs(mirrored)
    mirrored = np.where(on_axis, -1e-3 * np.abs(mirrored) + 1j * mirrored.imag, mirrored)
    return np.asarray(mirrored[np.argsort(np.abs(mirrored), kind="stable")])
