"""Prediction of a record by a model, and its derivatives by every parameter, from one set of states.

With A of order n, the 2n states s^k/A^2 u hold B/A u and all its derivatives: d/db_i = s^i/A u = s^i A/A^2 u,
d/da_j = -s^j B/A^2 u. Offsets of sensor and command, the state before the record began and steady lines (hum) enter
linearly; they are fitted beside and projected out (Golub and Pereyra, variable projection, 1973).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.identification.estimate.states import Hold, companion_states, shift
from tactuator.identification.estimate.structure import Structure


@dataclass(frozen=True, eq=False)
class Problem:
    """A record in scaled time: rate is the sampling rate over scale_rad_s, delays are in 1/scale_rad_s.

    command, position: (n,). friction: state of the friction along the record (n,), or None. fixed: columns (n, k) that
    are fitted beside (a constant, hum). All of them have been through the same whitening filter, if any. skip: first
    samples that do not count.
    """

    command: FloatArray
    position: FloatArray
    friction: FloatArray | None
    fixed: FloatArray
    rate: float
    delay: float
    skip: int
    hold: Hold = "zero-order"


@dataclass(frozen=True, eq=False)
class Prediction:
    """A prediction of a record: residual (n - skip,), jacobian (n - skip, p) of the prediction, both with everything
    linear projected out; cost: sum of squares; output: the prediction (n,) by the plant alone, without offsets and
    lines.
    """

    residual: FloatArray
    jacobian: FloatArray
    cost: float
    output: FloatArray


@dataclass(frozen=True, eq=False)
class _Driven:
    """States s^k/A^2 of one driver, (n, 2 order), and the driver as it acts (n,); first rows only where it dies out."""

    states: FloatArray
    acting: FloatArray

    def combine(self, polynomials: Sequence[NDArray[np.floating[Any]]], square: FloatArray) -> FloatArray:
        """Return each polynomial(s)/A^2 (descending, of degree 2 order at most) applied to the driver: (n, columns)."""
        weights, direct = np.zeros((square.size - 1, len(polynomials))), np.zeros(len(polynomials))
        for column, polynomial in enumerate(polynomials):
            rest = polynomial
            if polynomial.size == square.size:
                direct[column] = polynomial[0]
                rest = polynomial[1:] - polynomial[0] * square[1:]
            weights[: rest.size, column] = rest[::-1]
        made = self.states @ weights
        if np.any(direct):
            made += self.acting[:, None] * direct
        return made


def combination(polynomials: list[FloatArray], square: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how much of each state (2 order, columns) and of the driver (columns,) makes polynomial(s)/A^2 of the
    driver.
    """
    weights, direct = np.zeros((square.size - 1, len(polynomials))), np.zeros(len(polynomials))
    for column, polynomial in enumerate(polynomials):
        rest = polynomial
        if polynomial.size == square.size:
            direct[column] = polynomial[0]
            rest = polynomial[1:] - polynomial[0] * square[1:]
        weights[: rest.size, column] = rest[::-1]
    return weights, direct


def predict(
    problem: Problem, structure: Structure, theta: FloatArray, coulomb: float, *, derivatives: bool = True
) -> Prediction:
    """Return the prediction and derivatives at theta; `coulomb` is the last parameter where the problem has
    friction.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        model = Model(problem, structure, theta, coulomb)
        output = model.output()
        projector = Projector(model.nuisance(), problem.skip)
        residual, level = projector.apply(problem.position - output)
        cost = float(residual @ residual)
        if not np.isfinite(cost) or not derivatives:
            return Prediction(residual, np.zeros((0, 0)), cost if np.isfinite(cost) else np.inf, output)
        jacobian, _ = projector.apply(model.derivatives(level))
    return Prediction(residual, jacobian, cost, output)


class Model:
    """One model's states on one problem, and what follows from them by combining them."""

    def __init__(self, problem: Problem, structure: Structure, theta: FloatArray, coulomb: float) -> None:
        self.problem, self.structure, self.coulomb = problem, structure, coulomb
        b, a, self.delay = structure.split(theta, problem.delay)
        self.monic, self.b = np.append(1.0, a[::-1]), b[::-1]
        self.square = np.polymul(self.monic, self.monic)
        self.order = a.size
        self.pushing = self._drive(problem.command)
        self.resisting = None if problem.friction is None else self._drive(problem.friction)
        count = problem.position.size
        memory = self._memory(count)
        # once the start is forgotten the answer to a constant is a constant, and that is among the fixed columns
        ones = np.ones(count if memory > 0.2 * count else 0)
        self.steady = _Driven(companion_states(self.square, ones, problem.rate), ones)
        pulse = np.zeros(memory)
        pulse[0] = problem.rate
        self.pulse = _Driven(companion_states(self.square, pulse, problem.rate), pulse)

    @cached_property
    def driven(self) -> _Driven:
        """Return the states of the command less friction."""
        if self.resisting is None:
            return self.pushing
        return _Driven(
            self.pushing.states - self.coulomb * self.resisting.states,
            self.pushing.acting - self.coulomb * self.resisting.acting,
        )

    def _memory(self, count: int) -> int:
        """Return the number of samples after which the state before the record is forgotten."""
        slowest = -float(np.max(np.roots(self.monic).real))
        return count if slowest <= 0.0 else int(min(count, 60.0 * self.problem.rate / slowest + 10.0))

    def _drive(self, driver: FloatArray, denominator: FloatArray | None = None) -> _Driven:
        problem, delay = self.problem, max(self.delay, 0.0)
        under = self.square if denominator is None else denominator
        states = companion_states(under, driver, problem.rate, hold=problem.hold, delay_s=delay)
        whole, part = divmod(delay * problem.rate, 1.0)
        acting = shift(driver, int(whole))
        if part > 0.0:
            acting = (1.0 - part) * acting + part * shift(driver, int(whole) + 1)
        return _Driven(states, acting)

    def output(self) -> FloatArray:
        """Return B/A applied to the command less friction, (n,)."""
        return self.driven.combine([np.polymul(self.b, self.monic)], self.square)[:, 0]

    def resistance(self, state: FloatArray) -> FloatArray:
        """Return the derivative of the output by the Coulomb level of a friction of that state: -B/A applied to it,
        (n,).
        """
        return self._drive(state, self.monic).combine([-self.b], self.monic)[:, 0]

    def nuisance(self) -> FloatArray:
        """Return the columns (n, k): free responses, response to a constant command, and the problem's fixed ones."""
        count, n = self.problem.position.size, self.order
        columns = np.zeros((count, n + 1 + self.problem.fixed.shape[1]))
        free = self.pulse.combine([np.polymul(_power(i), self.monic) for i in range(n)], self.square)
        columns[: free.shape[0], :n] = free
        columns[: self.steady.acting.size, n] = self.steady.combine([self.monic], self.square)[:, 0]
        columns[:, n + 1 :] = self.problem.fixed
        return columns

    def slopes(self) -> list[FloatArray]:
        """Return the polynomials over A^2 that make the derivatives of B/A by numerator, denominator and dead time."""
        b, a = self.b, self.monic
        by_b = [np.polymul(_power(i), a) for i in range(self.structure.integrated, b.size)]
        by_a = [-np.polymul(b, _power(j)) for j in range(self.order)]
        late = [-np.polymul(np.polymul(b, a), _power(1))] if self.structure.dead_time else []
        return by_b + by_a + late

    def derivatives(self, level: FloatArray) -> FloatArray:
        """Return the derivatives by every parameter, (n, p); `level` are the nuisance columns' coefficients."""
        b, a, n = self.b, self.monic, self.order
        columns = self.driven.combine(self.slopes(), self.square)
        first = self.structure.numerator_count
        free = level[:n][::-1]
        columns[: self.pulse.acting.size, first : first + n] -= self.pulse.combine(
            [np.polymul(free, _power(j)) for j in range(n)], self.square
        )
        if self.steady.acting.size:
            by_offset = [level[n] * _power(j) for j in range(n)]
            columns[:, first : first + n] -= self.steady.combine(by_offset, self.square)
        if self.resisting is None:
            return columns
        return np.hstack([columns, self.resisting.combine([-np.polymul(b, a)], self.square)])


def _power(exponent: int) -> FloatArray:
    """Return the polynomial s^exponent, descending."""
    return np.append(1.0, np.zeros(exponent))


class Projector:
    """Takes out of signals, from row `skip` on, what columns (n, k) explain of them."""

    def __init__(self, columns: FloatArray, skip: int) -> None:
        self._kept, self._skip = columns[skip:], skip
        gram = self._kept.T @ self._kept
        size = np.sqrt(np.diag(gram))
        self._size = np.where(size > 0.0, size, 1.0)
        gram = gram / np.outer(self._size, self._size)
        self.is_finite = bool(np.all(np.isfinite(gram)))
        self._inverse = np.linalg.pinv(gram, rcond=1e-11, hermitian=True) if self.is_finite else gram

    def apply(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what the columns leave of `values`, (n,) or (n, p): (n - skip, ...), and their coefficients (k,) or
        (k, p).
        """
        target = values[self._skip :]
        goal = (self._kept.T @ target).T / self._size
        if not (self.is_finite and np.all(np.isfinite(goal))):
            return np.full(target.shape, np.inf), np.zeros(goal.T.shape)
        solution = ((goal @ self._inverse) / self._size).T
        return np.asarray(target - self._kept @ solution), solution
