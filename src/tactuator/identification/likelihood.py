"""Maximum likelihood on a record's lines: weighted least squares over poles and dead time, all else linear.

Numerator and transient enter linearly; they are solved for at every step and projected out of the derivatives (Golub
and Pereyra, variable projection, 1973, in Kaufman's form).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.form import (
    Form,
    Stages,
    all_poles,
    denominator_values,
    freedom,
    growth,
    is_stable,
    monic_values,
    numerator_values,
    section_list,
    stages_of,
    weights_left,
)
from tactuator.identification.hold import Grid, held_slopes, response_columns, transient_columns
from tactuator.identification.lines import Equations, JoinedEquations, equation_slices

_SOON, _FAR_AWAY = 4, 100.0
"""Steps after which a fit beyond a hopeless cost is given up, half of them where it is that many times beyond."""


@dataclass(frozen=True, eq=False)
class SpectralFit:
    """A transfer function of scaled time: theta (sections), delay, numerator weights on its stages; cost: half of
    -2 log likelihood for known noise."""

    form: Form
    theta: FloatArray
    delay: float
    numerator: FloatArray
    stages: Stages
    grid: Grid
    cost: float

    def response(self, frequency_hz: FloatArray) -> ComplexArray:
        """Return the complex response at `frequency_hz` (m,), dead time included."""
        s: ComplexArray = np.asarray(2j * np.pi * frequency_hz / self.grid.scale_rad_s)
        top = numerator_values(self.stages, s, self.form) @ self.numerator
        return np.asarray(top * np.exp(-s * self.delay) / denominator_values(self.theta, self.form, s))

    @property
    def poles_rad_s(self) -> ComplexArray:
        """Return the poles in rad/s, (poles,)."""
        return np.asarray(all_poles(self.theta, self.form) * self.grid.scale_rad_s)

    def ringing(self, frequency_hz: FloatArray) -> FloatArray:
        """Return the squared size of one over the denominator at `frequency_hz` (m,)."""
        s: ComplexArray = np.asarray(2j * np.pi * np.maximum(frequency_hz, 1e-9) / self.grid.scale_rad_s)
        return np.asarray(np.abs(denominator_values(self.theta, self.form, s)) ** -2.0)

    @property
    def growth(self) -> float:
        """Return the sum of the rates of growing poles, 1/s."""
        return growth(self.theta, self.form) * self.grid.scale_rad_s

    @property
    def delay_s(self) -> float:
        """Return the dead time in seconds."""
        return self.delay / self.grid.scale_rad_s


@dataclass(frozen=True, eq=False)
class SpectralProblem:
    """Equations with weights (e,) under one hold; with the transient's columns unless the lines are free of one; with
    poles in the left half plane alone if `stable`; with dead times from -1 sample on if `skewed`, from 0 on otherwise.

    All sums over the equations are taken once, as products of columns; what is linear is eliminated from them.
    """

    given: Equations | JoinedEquations
    weight: FloatArray
    grid: Grid
    with_transient: bool = True
    stable: bool = False
    skewed: bool = False

    @property
    def earliest(self) -> float:
        """Return the least dead time, scaled: positions may be read later than commands, by one sample at most."""
        return -self.grid.period if self.skewed else 0.0

    def evaluate(self, form: Form, theta: FloatArray, delay: float) -> _Point | None:
        """Return the linear solution at theta, or None where numbers run away."""
        stages = stages_of(theta, form)
        response = response_columns(self.grid, theta, delay, form, stages)
        parts, goal = [self.given.response_of(response)], self.given.goal
        if form.gain is not None:
            foot, basis = weights_left(theta, form, stages)
            columns = np.ascontiguousarray(parts[0])
            goal, parts = goal - columns @ foot, [columns @ basis]
        if self.with_transient:
            parts.append(self.given.transient_of(transient_columns(self.grid, theta, form)))
        rows = self.weighted(*parts, goal[:, None])
        along = self._along(rows)
        products = self._less_ends(rows @ rows.T, along)
        if not np.all(np.isfinite(products)):
            return None
        turning = turning_of(products[:-1, :-1])
        solution, rest = eliminated(products, rows.shape[0] - 1, turning)
        weights = solution[: parts[0].shape[1], 0]
        if form.gain is not None:
            weights = foot + basis @ weights
        cost = float(max(rest[0, 0], 0.0)) + self._growth_costs * growth(theta, form)
        return _Point(form, theta, delay, weights, stages, response @ weights, rows, along, products, turning, cost)

    @property
    def _growth_costs(self) -> float:
        """Return what growing poles cost, scaled: a record of T seconds is less likely by exp(-T growth) than its lines
        say. A predictor is causal, and lines know nothing of before and after.
        """
        seconds = self.given.total / self.given.rate_hz if self.with_transient else 0.0
        return seconds * self.grid.scale_rad_s

    def products(self, rows: FloatArray) -> FloatArray:
        """Return the products (k, k) of weighted real rows (k, 2 e), less what the records' ends may add."""
        return self._less_ends(rows @ rows.T, self._along(rows))

    def _along(self, rows: FloatArray) -> FloatArray:
        """Return the parts of weighted real rows (k, 2 e) along what the records' ends may add, (k, j)."""
        parts = [rows[:, piece] @ basis.T for piece, basis in self._edges]
        return parts[0] if len(parts) == 1 else np.hstack(parts) if parts else np.zeros((rows.shape[0], 0))

    def _less_ends(self, products: FloatArray, along: FloatArray) -> FloatArray:
        """Take the parts `along` the ends off products (k, k); columns of which nothing is left become zero."""
        if not along.size:
            return products
        size = products.diagonal().copy()
        products -= along @ along.T
        # power of a column, over what it had, below which the records' ends have taken all of it
        lost = products.diagonal() < 1e-12 * size
        if lost.any():
            products[lost, :] = 0.0
            products[:, lost] = 0.0
        return np.asarray(products)

    def weighted(self, *parts: ComplexArray) -> FloatArray:
        """Return sets of complex columns (e, k) one after the other, weighted, as real rows (all k, 2 e)."""
        rows = np.empty((sum(part.shape[1] for part in parts), self.weight.size), dtype=np.complex128)
        begin = 0
        for part in parts:
            np.multiply(part.T, self._complex_weight, out=rows[begin : begin + part.shape[1]])
            begin += part.shape[1]
        return rows.view(np.float64)

    @cached_property
    def _complex_weight(self) -> ComplexArray:
        return self.weight.astype(np.complex128)  # once, and not in every product

    @cached_property
    def _edges(self) -> list[tuple[slice, FloatArray]]:
        """Return where each record's equations are, and an orthonormal basis (k, 2 e) of what its ends may add."""
        bases: list[tuple[slice, FloatArray]] = []
        if not self.with_transient:
            return bases
        for part, piece in zip(self.given.parts, equation_slices(self.given), strict=True):
            rows = np.ascontiguousarray((part.ends * self.weight[piece, None]).T).view(np.float64)
            bases.append((slice(2 * piece.start, 2 * piece.stop), orthonormal(rows)))
        return bases

    @cached_property
    def _ends(self) -> dict[tuple[Form, bytes, float], _Point]:
        """Return the ends of the descents until now: from many of them others go on."""
        return {}

    def keep(self, at: _Point) -> None:
        """Keep a point from which a descent will begin: it is not evaluated again."""
        self._ends[at.form, at.theta.tobytes(), at.delay] = at

    def slopes(self, at: _Point) -> FloatArray:
        """Return the weighted derivatives of the right sides by theta and dead time, real, (k, 2 e)."""
        bent = nonlinear_slopes(self.grid, at.form, at.theta, at.delay, at.numerator, at.stages, at.response)
        if at.form.gain is not None:
            linear = response_columns(self.grid, at.theta, at.delay, at.form, at.stages)
            bent = np.hstack([linear, bent]) @ self._nonlinear(at)
        return self.weighted(self.given.response_of(bent))

    def _nonlinear(self, at: _Point) -> FloatArray:
        """Return what of the freedom at a point bends the response: all of it but the numerator's own."""
        free = freedom(at.theta, at.form, at.stages)
        return free[:, free.shape[1] - at.form.bending :]

    def descend(
        self,
        form: Form,
        theta: FloatArray,
        delay: float,
        *,
        most: int = 25,
        gain: float = 1e-4,
        share: float = 1e-10,
        hopeless: float = np.inf,
    ) -> SpectralFit | None:
        """Return the fit after Levenberg and Marquardt's descent from theta, or None where there is no start.

        most: steps. gain, share: what a step has to win of the cost, in itself and as a share, for another one.
        hopeless: the cost beyond which nothing more is tried after a few steps.
        """
        delay = max(delay, self.earliest)
        with np.errstate(all="ignore"):
            now = self._ends.get((form, theta.tobytes(), delay)) or self.evaluate(form, theta, delay)
            now = None if now is None or self._ran_away(now) else now
            damping = 1e-3
            for step in range(most if now is not None and form.bending else 0):
                assert now is not None
                if (step >= _SOON and now.cost > hopeless) or (step >= _SOON // 2 and now.cost > _FAR_AWAY * hopeless):
                    break
                least = max(gain, share * now.cost)
                ahead, damping = self._step(now, damping, least)
                if ahead is None or self._ran_away(ahead):
                    break
                won, now = now.cost - ahead.cost, ahead
                if won < least:
                    break
        if now is None:
            return None
        self.keep(now)
        return SpectralFit(form, now.theta, now.delay, now.numerator, now.stages, self.grid, now.cost)

    def continued(self, fit: SpectralFit, most: int) -> SpectralFit:
        """Return the fit after further steps of its descent, for these weights."""
        return self.descend(fit.form, fit.theta, fit.delay, most=most) or fit

    def _ran_away(self, at: _Point) -> bool:
        """Return true where a known gain was obeyed by a pole so far away that nothing shows it."""
        if at.form.gain is None:
            return False
        # size of a pole over the highest frequency from which on it is no pole of the mechanism, but hides a known
        # value
        far = 30.0 * float(np.max(np.abs(self.grid.s)))
        return not bool(np.all(np.abs(all_poles(at.theta, at.form)) < far))

    def _step(self, now: _Point, damping: float, least: float) -> tuple[_Point | None, float]:
        """Return the next point and damping; no point where a step would, to first order, win less than `least`."""
        slopes = self.slopes(now)
        if not np.all(np.isfinite(slopes)):
            return None, damping
        linear = now.rows.shape[0] - 1
        _, rest = eliminated(self._products_with(now, slopes), linear, now.turning)
        size = np.sqrt(np.maximum(np.diag(rest)[1:], 0.0))
        size[size == 0.0] = 1.0
        gram, downhill = rest[1:, 1:] / np.outer(size, size), rest[1:, 0] / size
        if not is_stable(now.theta, now.form):
            steps = 1e-6 * np.diag([max(_size(now.theta, now.form, j), 1e-9) for j in range(now.theta.size)])
            here = growth(now.theta, now.form)
            rises = [(growth(now.theta + step, now.form) - here) / step.sum() for step in steps]
            # the cost is the sum of squares itself, its slope twice what the normal equations have
            downhill[: now.theta.size] -= 0.5 * self._growth_costs * np.array(rises) / size[: now.theta.size]
        for _ in range(8):
            try:
                scaled = np.linalg.solve(gram + damping * np.eye(size.size), downhill)
            except np.linalg.LinAlgError:
                break
            if not float(scaled @ downhill) >= least:
                break
            step = scaled / size
            delay = max(now.delay + float(step[-1]), self.earliest) if now.form.dead_time else now.delay
            theta = now.theta + step[: now.theta.size]
            refused = self.stable and not is_stable(theta, now.form)
            trial = None if refused else self.evaluate(now.form, theta, delay)
            if trial is not None and trial.cost < now.cost * (1.0 + 1e-12):
                return trial, max(damping / 8.0, 1e-9)
            damping = max(damping * 6.0, 1e-4)
        return None, damping

    def _products_with(self, now: _Point, slopes: FloatArray) -> FloatArray:
        """Return the products of (linear columns, goal, slopes), those of the first two as they are known."""
        before, more = now.rows.shape[0], slopes.shape[0]
        products = np.empty((before + more, before + more))
        products[:before, :before] = now.products
        along = self._along(slopes)
        products[:before, before:] = now.rows @ slopes.T - now.along @ along.T
        products[before:, :before] = products[:before, before:].T
        products[before:, before:] = slopes @ slopes.T - along @ along.T
        return products

    def won_by(self, fit: SpectralFit, poles: FloatArray) -> FloatArray:
        """Return what a real pole at each of -`poles` (k,), and a zero near it, would win of a fit's cost, to first
        order and beside the fit's own parameters (a score test; held commands: of poles far below the rate).
        """
        at = self.evaluate(fit.form, fit.theta, fit.delay)
        if at is None:
            return np.zeros(poles.size)
        columns = at.response[:, None] / (self.grid.s[:, None] + poles)
        slopes, linear = self.slopes(at), at.rows.shape[0] - 1
        rows = np.concatenate([slopes, self.weighted(self.given.response_of(columns))])
        _, rest = eliminated(self._products_with(at, rows), linear, at.turning)
        # the slopes before the goal
        order = np.concatenate([np.arange(1, slopes.shape[0] + 1), [0], np.arange(slopes.shape[0] + 1, rest.shape[0])])
        _, apart = eliminated(rest[np.ix_(order, order)], slopes.shape[0])
        return np.asarray(apart[0, 1:] ** 2 / np.maximum(np.diag(apart)[1:], 1e-300))

    def criterion(self, fit: SpectralFit) -> float:
        """Return -2 log likelihood with Bayes' penalty."""
        criterion = 2.0 * fit.cost + float(np.log(self.given.total)) * fit.form.count
        return criterion if np.isfinite(criterion) else np.inf  # a fit that overflows is the last one

    def covariance_of(self, fit: SpectralFit) -> FloatArray:
        """Return the covariance of (numerator, theta, dead time), transients beside, for noise of the weights."""
        if fit not in self._covariances:
            self._covariances[fit] = self._covariance_and_step(fit)[0]
        return self._covariances[fit]

    @cached_property
    def _covariances(self) -> dict[SpectralFit, FloatArray]:
        return {}

    def step_of(self, fit: SpectralFit) -> FloatArray:
        """Return the change of (numerator, theta, dead time) that, to first order, leads to the greatest likelihood."""
        return self._covariance_and_step(fit)[1]

    def _covariance_and_step(self, fit: SpectralFit) -> tuple[FloatArray, FloatArray]:
        linear = response_columns(self.grid, fit.theta, fit.delay, fit.form, fit.stages)
        bent = nonlinear_slopes(self.grid, fit.form, fit.theta, fit.delay, fit.numerator, fit.stages)
        given = self.given
        free = freedom(fit.theta, fit.form, fit.stages)
        columns = given.response_of(np.hstack([linear, bent]) @ free)
        rest = given.goal - given.response_of((linear @ fit.numerator)[:, None])[:, 0]
        beside = 0
        if self.with_transient:
            decays = given.transient_of(transient_columns(self.grid, fit.theta, fit.form))
            beside, columns = decays.shape[1], np.hstack([decays, columns])
        products = self.products(self.weighted(columns, rest[:, None]))
        gram = eliminated(products, beside)[1] if beside else products
        size = np.sqrt(np.maximum(np.diag(gram)[:-1], 0.0))
        size[size == 0.0] = 1.0
        inverse = np.linalg.pinv(gram[:-1, :-1] / np.outer(size, size), rcond=1e-14, hermitian=True) / np.outer(
            size, size
        )
        # a complex line's noise has half its power in either part
        return np.asarray(free @ (0.5 * inverse) @ free.T), np.asarray(free @ (inverse @ gram[:-1, -1]))

    def residual(self, fit: SpectralFit) -> ComplexArray:
        """Return what the fit leaves of the goal, not weighted, its transient solved for anew, (e,)."""
        response = response_columns(self.grid, fit.theta, fit.delay, fit.form, fit.stages) @ fit.numerator
        rest = self.given.goal - self.given.response_of(response[:, None])[:, 0]
        if not self.with_transient:
            return np.asarray(rest)
        columns = self.given.transient_of(transient_columns(self.grid, fit.theta, fit.form), ends=True)
        solution = fitted_beside(columns, rest, self.weight)
        return np.asarray(rest - np.ascontiguousarray(columns) @ solution)


@dataclass(frozen=True, eq=False)
class _Point:
    """A point of a descent. response: at the grid, hold included, (m,); rows: weighted linear columns and the goal, (k,
    2 e); along: their parts along the records' ends, (k, j); products: of the rows, ends taken off; turning:
    of their linear columns.
    """

    form: Form
    theta: FloatArray
    delay: float
    numerator: FloatArray
    stages: Stages
    response: ComplexArray
    rows: FloatArray
    along: FloatArray
    products: FloatArray
    turning: FloatArray
    cost: float


def nonlinear_slopes(
    grid: Grid,
    form: Form,
    theta: FloatArray,
    delay: float,
    numerator: FloatArray,
    stages: Stages,
    response: ComplexArray | None = None,
) -> ComplexArray:
    """Return the derivatives of the response by theta and dead time with the numerator as it is, (m, k).

    response: as it is here, (m,), if that is at hand.
    """
    here = response_columns(grid, theta, delay, form, stages) @ numerator if response is None else response
    if grid.hold == "band-limited":
        slopes = []
        for section in section_list(theta, form):
            pulled = -here / monic_values(section, grid.s)
            slopes += [pulled * grid.s] * (section.size == 3) + [pulled]
        slopes += [-grid.s * here] * form.dead_time
        return np.stack(slopes, axis=1) if slopes else np.zeros((grid.s.size, 0), dtype=np.complex128)
    steps = np.array([1e-7 * max(_size(theta, form, j), 1e-9) for j in range(theta.size)])
    smooth = held_slopes(grid, theta, delay, form, stages, numerator, steps) if grid.hold == "zero-order" else None
    if smooth is not None:
        return smooth
    slopes = []
    for step in np.diag(steps):
        moved = response_columns(grid, theta + step, delay, form, stages) @ numerator
        slopes.append((moved - here) / step.sum())
    if form.dead_time:
        late = 1e-6 * grid.period
        slopes.append((response_columns(grid, theta, delay + late, form, stages) @ numerator - here) / late)
    return np.stack(slopes, axis=1) if slopes else np.zeros((grid.s.size, 0), dtype=np.complex128)


def _size(theta: FloatArray, form: Form, j: int) -> float:
    """Return the size of a coefficient; a damping that is near zero counts as its section's frequency."""
    first_of_pair = j < 2 * (form.free // 2) and j % 2 == 0
    return float(abs(theta[j]) + (np.sqrt(abs(theta[j + 1])) if first_of_pair else 0.0))


def fitted_beside(columns: ComplexArray, goal: ComplexArray, weight: FloatArray) -> FloatArray:
    """Return the real weights (k,) of complex columns (e, k) that fit the goal (e,) best."""
    rows = np.ascontiguousarray((np.hstack([columns, goal[:, None]]) * weight[:, None]).T).view(np.float64)
    return np.asarray(eliminated(rows @ rows.T, columns.shape[1])[0][:, 0])


def eliminated(products: FloatArray, linear: int, turning: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Return the least squares weights (linear, k) of the first `linear` columns for all further ones, and the products
    (k, k) of what they leave, from the products of all columns.

    turning: `turning_of` the first columns, if that is at hand.
    """
    turned = turning_of(products[:linear, :linear]) if turning is None else turning
    along = turned.T @ products[:linear, linear:]
    return turned @ along, products[linear:, linear:] - along.T @ along


def turning_of(products: FloatArray) -> FloatArray:
    """Return the weights (k, j) that make those with the products (k, k) orthonormal, lost directions left out."""
    if not products.size:
        return np.zeros((0, 0))
    size = np.sqrt(np.maximum(products.diagonal(), 0.0))
    size[size == 0.0] = 1.0
    values, vectors = np.linalg.eigh(products / (size[:, None] * size))
    kept = values > 1e-13 * max(float(values[-1]), 1e-300)
    return np.asarray(vectors[:, kept] / np.sqrt(values[kept]) / size[:, None])


def orthonormal(rows: FloatArray) -> FloatArray:
    """Return an orthonormal basis (j, n) of the rows (k, n), but for directions that are lost in rounding."""
    size = np.linalg.norm(rows, axis=1)
    basis = rows / np.where(size > 0.0, size, 1.0)[:, None]
    # the second round takes away what the first one's rounding left
    for _ in range(2):
        values, vectors = np.linalg.eigh(basis @ basis.T)
        kept = values > 1e-11 * max(float(values[-1]), 1e-300)
        basis = (vectors[:, kept] / np.sqrt(values[kept])).T @ basis
    return np.asarray(basis)
