"""Maximum likelihood on a record's lines: weighted least squares over poles and dead time, all else linear.

Numerator and transient enter linearly; they are solved for at every step and projected out of the derivatives (Golub
and Pereyra, variable projection, 1973, in Kaufman's form).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from tactuator.identification.spectral.between import Grid, edge_columns, response_columns, transient_columns
from tactuator.identification.spectral.form import (
    Form,
    Ladder,
    all_poles,
    denominator_values,
    ladder,
    numerator_values,
    section_list,
)
from tactuator.identification.spectral.lines import Equations

Array = NDArray[np.float64]
Complex = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Fit:
    """A transfer function of scaled time: theta (sections), delay, numerator weights on its ladder; cost: half of
    -2 log likelihood for known noise."""

    form: Form
    theta: Array
    delay: float
    numerator: Array
    rungs: Ladder
    grid: Grid
    cost: float

    def response(self, frequency_hz: Array) -> Complex:
        """Return the complex response at `frequency_hz` (m,), dead time included."""
        s = 2j * np.pi * np.asarray(frequency_hz) / self.grid.scale_rad_s
        top = numerator_values(self.rungs, s, self.form) @ self.numerator
        return np.asarray(top * np.exp(-s * self.delay) / denominator_values(self.theta, self.form, s))

    @property
    def poles_rad_s(self) -> Complex:
        """Return the poles, (poles,)."""
        return np.asarray(all_poles(self.theta, self.form) * self.grid.scale_rad_s)

    @property
    def delay_s(self) -> float:
        """Return the dead time."""
        return self.delay / self.grid.scale_rad_s


@dataclass(frozen=True, eq=False)
class Problem:
    """Equations with weights (e,) under one hold; with the transient's columns unless the lines are free of one."""

    given: Equations
    weight: Array
    grid: Grid
    with_transient: bool = True

    def evaluate(self, form: Form, theta: Array, delay: float) -> _Point | None:
        """Return the linear solution at theta, or None where numbers run away."""
        rungs = ladder(theta, form)
        columns = self.given.response_of(response_columns(self.grid, theta, delay, form, rungs))
        if self.with_transient:
            columns = np.hstack([columns, self.given.transient_of(transient_columns(self.grid, theta, form))])
        matrix = self.without_edges(_real(columns * self.weight[:, None]))
        if not np.all(np.isfinite(matrix)):
            return None
        goal = self._goal
        solution, basis = solve(matrix, goal)
        left = goal - matrix @ solution
        return _Point(form, theta, delay, solution[: form.numerators], rungs, left, basis, float(left @ left))

    @cached_property
    def _edges(self) -> Array:
        """Orthonormal basis of what the record's ends may add, weighted and real, (2 e, k)."""
        columns = self.given.transient_of(edge_columns(self.grid)) * self.weight[:, None]
        return solve(_real(columns), np.zeros(2 * self.weight.size))[1]

    @cached_property
    def _goal(self) -> Array:
        return self.without_edges(_real(self.given.goal * self.weight)[:, None])[:, 0]

    def without_edges(self, matrix: Array) -> Array:
        """Return weighted real columns (2 e, k) less what the record's ends may add."""
        return matrix - self._edges @ (self._edges.T @ matrix) if self.with_transient else matrix

    def slopes(self, at: _Point) -> Array:
        """Return the weighted derivatives of the right sides by theta and dead time, real, (2 e, k)."""
        made = nonlinear_slopes(self.grid, at.form, at.theta, at.delay, at.numerator, at.rungs)
        return self.without_edges(_real(self.given.response_of(made) * self.weight[:, None]))

    def descend(self, form: Form, theta: Array, delay: float, *, most: int = 25, gain: float = 1e-4) -> Fit | None:
        """Return the fit after Levenberg and Marquardt's descent from theta, or None where there is no start."""
        with np.errstate(all="ignore"):
            now = self.evaluate(form, theta, delay)
            damping = 1e-3
            for _ in range(most if now is not None and theta.size + form.dead_time else 0):
                assert now is not None
                ahead, damping = self._step(now, damping)
                if ahead is None:
                    break
                won, now = now.cost - ahead.cost, ahead
                if won < gain * max(1.0, 1e-6 * now.cost):
                    break
        if now is None:
            return None
        return Fit(form, now.theta, now.delay, now.numerator, now.rungs, self.grid, now.cost)

    def _step(self, now: _Point, damping: float) -> tuple[_Point | None, float]:
        slopes = self.slopes(now)
        slopes = slopes - now.basis @ (now.basis.T @ slopes)
        if not np.all(np.isfinite(slopes)):
            return None, damping
        size = np.linalg.norm(slopes, axis=0)
        size[size == 0.0] = 1.0
        gram, downhill = (slopes / size).T @ (slopes / size), (slopes / size).T @ now.left
        for _ in range(8):
            step = np.linalg.solve(gram + damping * np.eye(size.size), downhill) / size
            delay = max(now.delay + float(step[-1]), 0.0) if now.form.dead_time else now.delay
            trial = self.evaluate(now.form, now.theta + step[: now.theta.size], delay)
            if trial is not None and trial.cost < now.cost * (1.0 + 1e-12):
                return trial, max(damping / 8.0, 1e-9)
            damping = max(damping * 6.0, 1e-4)
        return None, damping

    def residual(self, fit: Fit) -> Complex:
        """Return what the fit leaves of the goal, not weighted, its transient solved for anew, (e,)."""
        own = response_columns(self.grid, fit.theta, fit.delay, fit.form, fit.rungs) @ fit.numerator
        left = self.given.goal - self.given.response_of(own[:, None])[:, 0]
        if not self.with_transient:
            return np.asarray(left)
        columns = self.given.transient_of(beside_columns(self.grid, fit.theta, fit.form))
        solution, _ = solve(_real(columns * self.weight[:, None]), _real(left * self.weight))
        return np.asarray(left - columns @ solution)

    def with_weight(self, weight: Array) -> Problem:
        """Return the same equations, weighted otherwise."""
        return replace(self, weight=weight)


def beside_columns(grid: Grid, theta: Array, form: Form) -> Complex:
    """Return everything that is fitted beside the response: decays, ends, drift, (m, k)."""
    return np.hstack([transient_columns(grid, theta, form), edge_columns(grid)])


@dataclass(frozen=True, eq=False)
class _Point:
    form: Form
    theta: Array
    delay: float
    numerator: Array
    rungs: Ladder
    left: Array
    basis: Array
    cost: float


def nonlinear_slopes(grid: Grid, form: Form, theta: Array, delay: float, numerator: Array, rungs: Ladder) -> Complex:
    """Return the derivatives of the response by theta and dead time with the numerator as it is, (m, k)."""
    if grid.hold == "band-limited":
        value = response_columns(grid, theta, delay, form, rungs) @ numerator
        made = []
        for section in section_list(theta, form):
            under = np.polyval(section, grid.s)
            made += [-value * grid.s / under] * (section.size == 3) + [-value / under]
        made += [-grid.s * value] * form.dead_time
        return np.stack(made, axis=1) if made else np.zeros((grid.s.size, 0), dtype=np.complex128)
    made = []
    for j in range(theta.size):
        step = np.zeros(theta.size)
        step[j] = 1e-6 * max(_size(theta, form, j), 1e-9)
        above = response_columns(grid, theta + step, delay, form, rungs) @ numerator
        below = response_columns(grid, theta - step, delay, form, rungs) @ numerator
        made.append((above - below) / (2.0 * step[j]))
    if form.dead_time:
        step_late = 1e-5 * grid.period
        first = max(delay - step_late, 0.0)
        above = response_columns(grid, theta, delay + step_late, form, rungs) @ numerator
        made.append(
            (above - response_columns(grid, theta, first, form, rungs) @ numerator) / (delay + step_late - first)
        )
    return np.stack(made, axis=1) if made else np.zeros((grid.s.size, 0), dtype=np.complex128)


def _size(theta: Array, form: Form, j: int) -> float:
    """Size of a coefficient; a damping that is near zero counts as its section's frequency."""
    first_of_pair = j < 2 * (form.free // 2) and j % 2 == 0
    return float(abs(theta[j]) + (np.sqrt(abs(theta[j + 1])) if first_of_pair else 0.0))


def solve(matrix: Array, goal: Array) -> tuple[Array, Array]:
    """Return the least squares solution and an orthonormal basis of the columns that are not lost in rounding."""
    size = np.linalg.norm(matrix, axis=0)
    size[size == 0.0] = 1.0
    q, r = np.linalg.qr(matrix / size)
    diagonal = np.abs(np.diag(r))
    if diagonal.size and diagonal.min() > 1e-8 * diagonal.max():
        return linalg.solve_triangular(r, q.T @ goal, check_finite=False) / size, q
    q, r, order = linalg.qr(matrix / size, mode="economic", pivoting=True, check_finite=False)
    diagonal = np.abs(np.diag(r))
    rank = int(np.sum(diagonal > 1e-11 * max(float(diagonal[0]), 1e-300)))
    solution = np.zeros(matrix.shape[1])
    solution[order[:rank]] = linalg.solve_triangular(r[:rank, :rank], q[:, :rank].T @ goal, check_finite=False)
    return solution / size, q[:, :rank]


def _real(values: Complex) -> Array:
    return np.concatenate([values.real, values.imag])


def information(problem: Problem, fit: Fit) -> Array:
    """Return the covariance of (numerator, theta, dead time), transients fitted beside, for noise of the weights."""
    linear = response_columns(problem.grid, fit.theta, fit.delay, fit.form, fit.rungs)
    bent = nonlinear_slopes(problem.grid, fit.form, fit.theta, fit.delay, fit.numerator, fit.rungs)
    given, weight = problem.given, problem.weight[:, None]
    slopes = _real(given.response_of(np.hstack([linear, bent])) * weight)
    if problem.with_transient:
        beside = _real(given.transient_of(beside_columns(problem.grid, fit.theta, fit.form)) * weight)
        _, basis = solve(beside, np.zeros(beside.shape[0]))
        slopes = slopes - basis @ (basis.T @ slopes)
    size = np.linalg.norm(slopes, axis=0)
    size[size == 0.0] = 1.0
    gram = (slopes / size).T @ (slopes / size)
    # a complex line's noise has half its power in either part
    return np.asarray(0.5 * np.linalg.pinv(gram, rcond=1e-14, hermitian=True) / np.outer(size, size))
