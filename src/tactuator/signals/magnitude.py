"""Sampled filters of a given magnitude: the least possible maximum error in dB, stable and minimum phase.

On the unit circle |F|^2 is a ratio N(x)/D(x) of polynomials in x = tan^2(pi f / rate), x from 0 to infinity; any ratio
positive there is the squared magnitude of one stable, minimum-phase filter. "The error is at most e dB" is linear in
the coefficients of N and D, so that a bisection over linear programs finds the least e, globally. (Rabiner, Graham &
Helms 1974, "Linear programming design of IIR digital filters with arbitrary magnitude function", IEEE Trans. ASSP 22.)

Powers of x over six decades would be hopeless to compute with. N and D are written as partial fractions instead, 1 and
a_k/(x + a_k) with a_k even in log frequency: the same functions, and well conditioned. For goals of more than 60 dB
from end to end N gets other fractions, 1 and b_k/(x + b_k), such that prod(x + b_k)/prod(x + a_k) already has the
goal's rough shape; the better of both is taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.signals.decibels import db
from tactuator.signals.systems import SampledSystem


@dataclass(frozen=True)
class MagnitudeGoal:
    """Goal of a filter's magnitude.

    frequency_hz, level_db: shape (n,), ascending, zero allowed: the level wanted. allowance_db: shape (n,), how far
    beyond the common error each point may be off (0 in the band proper). ceiling_db: the greatest level of the band;
    at above_hz, shape (m,), and at every frequency beyond, no more than what the filter reaches there. floor_db: shape
    (n,), no error is to be lower than this, where that narrows the tolerance by little (0.19 dB of an error of 0.2 dB,
    nothing of one of 0.5 dB or more); None: no floor. falls_above_hz: from the band to here the ceiling is 6 dB higher.
    """

    frequency_hz: FloatArray
    level_db: FloatArray
    allowance_db: FloatArray
    above_hz: FloatArray
    ceiling_db: float
    floor_db: FloatArray | None = None
    falls_above_hz: float = 0.0


def fractions(square: FloatArray, corners: FloatArray) -> FloatArray:
    """Return the fractions 1 and a_k/(x + a_k), shape (n, order + 1)."""
    return np.hstack([np.ones((square.size, 1)), corners / (square[:, None] + corners)])


def fraction_roots(coefficients: FloatArray, corners: FloatArray) -> NDArray[np.complex128]:
    """Return the roots in x of c_0 + sum c_k a_k/(x + a_k), shape (order,): eigenvalues of a bordered diagonal.

    The small ones stay right where c_0 is next to nothing and one root is all but infinite; no size is beyond 1e12.
    """
    weights = coefficients * np.append(1.0, corners) / np.max(np.abs(coefficients))
    rows = 1.0 / (1.0 + corners)
    fixed = np.block([[weights[:1, None], weights[None, 1:]], [-rows[:, None], np.diag(corners * rows)]])
    top, bottom = scipy.linalg.eigvals(fixed, -np.diag(np.append(0.0, rows)), homogeneous_eigvals=True)
    finite = np.argsort(np.abs(bottom) / (np.abs(top) + np.abs(bottom)))[1:]
    top, bottom = top[finite], bottom[finite]
    far = np.abs(bottom) < 1e-12 * np.abs(top)
    return np.asarray(np.where(far, -1e12, top / np.where(far, 1.0, bottom)), dtype=np.complex128)


def shaping_corners(corners: FloatArray, square: FloatArray, ratio: FloatArray) -> FloatArray:
    """Return corners b_k such that prod (x + b_k)/(x + a_k) rises and falls about as `ratio` does between a_k.

    A factor changes by a/b as x passes: b_k = a_k / (the change of the ratio around a_k), all different.
    """
    inside = square > 0.0
    x, level = np.log(square[inside]), np.log(ratio[inside])
    middles = np.log(corners)
    half = 0.5 * (middles[1] - middles[0]) if corners.size > 1 else 1.0
    edges = np.append(middles - half, middles[-1] + half)
    change = np.diff(np.interp(edges, x, level))
    shaped = np.sort(np.log(corners) - np.clip(change, -9.0, 9.0))
    least = 0.05 * (middles[-1] - middles[0]) / corners.size if corners.size > 1 else 0.0
    for index in range(1, shaped.size):
        shaped[index] = max(shaped[index], shaped[index - 1] + least)
    return np.asarray(np.exp(shaped))


def off_the_axis(roots: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the roots in x with those on or beside the positive axis (where a magnitude touches zero) moved off it,
    two by two, to the least damping allowed: x = w^2 exp(+/- 2j asin(damping)).
    """
    # the least damping of a root
    angle = 2.0 * np.arcsin(0.005)
    upper = roots[roots.imag > 0.0]
    near = (upper.real > 0.0) & (upper.imag < upper.real * np.tan(angle))
    upper = np.where(near, np.abs(upper) * np.exp(1j * angle), upper)
    real = np.sort(roots.real[roots.imag == 0.0])
    touching = real[real > 0.0]
    pairs = np.sqrt(touching[0::2][: touching.size // 2] * touching[1::2]) * np.exp(1j * angle)
    single = -touching[-1:] if touching.size % 2 else np.empty(0)
    upper = np.concatenate([upper, pairs])
    return np.concatenate([upper, np.conj(upper), real[real <= 0.0], single]).astype(np.complex128)


Coefficients = tuple[FloatArray, FloatArray]

STEEP_DB = 60.0
"""Range of a goal from which on a linear program comes near its solver's tolerance."""
_WIDEST_DB = 16.0
"""Error beyond which no filter is looked for, dB."""
_PRECISION = 0.015
"""Share of an error to which the least one is found."""
_LEAST_DB = 1e-3
"""Error below which no smaller one is looked for, dB."""
_QUICK = {"simplex_dual_edge_weight_strategy": "devex"}
_TYPICAL_DB = 15.0
"""Above the least error times the square of the order, for threshold curves: where the search for it begins."""
_BETWEEN_DB = 6.0
"""Rise above the ceiling, dB, that is allowed between the band and where the filter has to fall."""
_MOST_NARROWED_DB, _FINE_DB, _COARSE_DB = 0.19, 0.235, 0.5
"""Error to which a floor of friction may narrow the goal, and the errors between which it may do so less and less."""


class Program:
    """The linear program of one goal and order; constraints may be added where the grid overlooked something."""

    def __init__(
        self,
        goal: MagnitudeGoal,
        rate_hz: float,
        order: int,
        shaped: bool,
        former: Program | None = None,
        within_db: float | None = None,
    ) -> None:
        """Solve for the least common error or, where `within_db` is given, for any within that; BadInput for none."""
        self._within_db = within_db
        self._goal, self._rate_hz, self.order = goal, rate_hz, order
        inside = goal.frequency_hz[goal.allowance_db == 0.0]
        low, high = np.tan(np.pi * inside[[0, -1]] / rate_hz) ** 2
        self._unit = float(np.sqrt(low * high))
        self._middle_db = 0.5 * float(np.max(goal.level_db) + np.min(goal.level_db))
        steep = float(np.ptp(goal.level_db)) > STEEP_DB
        ratio = 10.0 ** ((goal.level_db - self._middle_db) / 10.0)
        self._corners = np.geomspace(low, 4.0 * high, order) / self._unit
        squares = self._squares(goal.frequency_hz)
        self._zero_corners = shaping_corners(self._corners, squares, ratio) if shaped else self._corners
        self._sized_by: NDArray[np.complex128] | None = None
        if former is not None:
            self._sized_by = fraction_roots(former._coefficients[1], former._corners)
            self._corners, self._zero_corners = former.root_corners()
        self._basis = fractions(squares, self._corners)
        self._target = self._numerators(goal.frequency_hz) / ratio[:, None]
        self._scale = np.max(np.abs(self._target), axis=0)
        self._above = np.append(goal.above_hz, 0.5 * rate_hz)
        self._taken = np.zeros(goal.frequency_hz.size, dtype=bool)
        # of the grid's points, those that the search for the least error begins with
        self._taken[::3] = self._taken[-1] = True
        self._lower_bound_db, self._is_delicate = 0.0, former is not None or steep
        self._guess_db: float = _TYPICAL_DB / order**2 if former is None else former._guess_db
        self._step = 1.4 if former is None else 1.1
        self._coefficients: Coefficients = self.best()
        for _ in range(6):
            missed = self.violations(self._coefficients)
            if missed.size == 0:
                break
            self.add(missed)
            self._coefficients = self.best()

    @cached_property
    def error_db(self) -> float:
        """Return the greatest error of the filter itself, over the band."""
        inside = self._goal.allowance_db == 0.0
        miss = db(self.filter.response(self._goal.frequency_hz[inside])) - self._goal.level_db[inside]
        return float(np.max(np.abs(miss)))

    @cached_property
    def excess_db(self) -> float:
        """Return the excess of the filter itself over the ceiling above the band, dB; 0 for what does not matter."""
        above = np.geomspace(self._goal.above_hz[0], 0.4999 * self._rate_hz, 1000)
        peaks = np.abs(np.angle(self.filter.poles)) * self._rate_hz / (2.0 * np.pi)
        above = np.append(above, peaks[(peaks > above[0]) & (peaks < above[-1])])
        ceiling_db = 10.0 * np.log10(self._ceiling(above, 0.0)) + self._middle_db
        excess = float(np.max(db(self.filter.response(above)) - ceiling_db))
        # dB beyond a ceiling that a grid may overlook
        return excess if excess > 0.05 else 0.0

    def again(self) -> Program:
        """Return a program of the same goal in the basis of this solution's roots, constraints scaled by its D."""
        return Program(self._goal, self._rate_hz, self.order, False, self)

    def root_corners(self) -> tuple[FloatArray, FloatArray]:
        """Return the corners at the sizes of the solution's poles and zeros, kept apart: a basis that fits closely."""
        sizes = []
        for part, corners in zip(self._coefficients[::-1], (self._corners, self._zero_corners), strict=True):
            logs = np.sort(np.log(np.clip(np.abs(fraction_roots(part, corners)), 1e-6, 1e6)))
            for index in range(1, logs.size):
                logs[index] = max(logs[index], logs[index - 1] + 0.2)
            sizes.append(np.exp(logs))
        return sizes[0], sizes[1]

    def _squares(self, frequency_hz: FloatArray) -> FloatArray:
        """Return the squares x, in units that put the band's middle at one; at the Nyquist frequency it is infinite."""
        nyquist = frequency_hz >= 0.5 * self._rate_hz
        return np.where(
            nyquist, 1e15, np.tan(np.pi * np.where(nyquist, 0.0, frequency_hz) / self._rate_hz) ** 2 / self._unit
        )

    def _numerators(self, frequency_hz: FloatArray) -> FloatArray:
        """Return the fractions of N times the rough shape, shape (n, order + 1)."""
        square = self._squares(frequency_hz)
        logs = np.log(square[:, None] + self._zero_corners) - np.log(square[:, None] + self._corners)
        return np.asarray(fractions(square, self._zero_corners) * np.exp(np.sum(logs, axis=1))[:, None])

    def _sizes(self, frequency_hz: FloatArray) -> FloatArray:
        """Return the size of D that the last solution suggests (1 without one), shape (n, 1): constraints are scaled by
        it, because the solver has one tolerance for all.
        """
        square = self._squares(frequency_hz)[:, None]
        if self._sized_by is None:
            return np.ones_like(square)
        logs = np.sum(np.log(np.abs(square - self._sized_by)) - np.log(square + self._corners), axis=1, keepdims=True)
        return np.asarray(np.exp(np.maximum(logs - np.max(logs), -20.0)))

    def best(self) -> Coefficients:
        """Return the coefficients for an error slightly above the least possible.

        It is bracketed from the first guess in growing steps, then bisected.
        """
        if self._within_db is not None:
            within = self._solve(self._within_db)
            if within is None:
                raise BadInput(f"no filter of {self.order} poles is within {self._within_db:g} dB", "more poles")
            return within
        low, high = self._bracket()
        while high - low > _PRECISION * max(low, 0.05) and high >= _LEAST_DB:
            middle = float(np.sqrt(low * high))
            low, high = (low, middle) if self._seems_possible(middle) else (middle, high)
        while not self._is_possible(high) and high < _WIDEST_DB:
            low, high = high, high * (1.0 + _PRECISION)
        self._lower_bound_db, self._guess_db = low, high
        # factors of the least error: one rule of pivoting may miss, by rounding, what another found possible
        for times in (1.01, 1.0, 1.05, 1.2, 2.0, 4.0):
            coefficients = self._solve(times * high + 0.002)
            if coefficients is not None:
                return coefficients
        raise BadInput(f"no filter of {self.order} poles was found", "another number of poles")

    def _bracket(self) -> tuple[float, float]:
        """Return an error that is impossible, or next to zero, and one that is possible, dB."""
        low, high, step = self._lower_bound_db, max(self._guess_db, 1.05 * self._lower_bound_db), self._step
        while not self._seems_possible(high):
            if high >= _WIDEST_DB:
                raise BadInput(
                    f"no prefilter of {self.order} poles follows the curve within {_WIDEST_DB:g} dB", "more poles"
                )
            # before a solution gives the size of D, "impossible" may be rounding alone
            low = high if self._sized_by is not None else low
            high, step = min(high * step, _WIDEST_DB), step**1.5
        while high >= _LEAST_DB:
            below = high / self._step
            if below <= low:
                break
            if not self._seems_possible(below):
                return below, high
            high = below
        return low, high

    def _is_possible(self, error_db: float) -> bool:
        """Return whether the linear program at that error has a solution on all of the grid."""
        taken = 0
        while taken < np.sum(self._taken):
            taken = int(np.sum(self._taken))
            if not self._seems_possible(error_db):
                return False
        return True

    def _seems_possible(self, error_db: float) -> bool:
        """Return whether the linear program at that error has a solution on some points of the grid, by the quickest
        pivoting.

        Points that the solution passes are included from then on. The size of D, which scales later constraints, is
        updated.
        """
        coefficients = self._solve(error_db, {} if self._is_delicate else _QUICK, self._taken)
        if coefficients is None:
            return False
        self._taken |= self._passed(coefficients, error_db)
        self._sized_by = fraction_roots(coefficients[1], self._corners)
        return True

    def _passed(self, coefficients: Coefficients, error_db: float) -> NDArray[np.bool_]:
        """Return at which points of the grid the coefficients pass the error, where they pass it most, (n,)."""
        with np.errstate(all="ignore"):
            ratio = (self._target @ coefficients[0]) / (self._basis @ coefficients[1])
            off_db = 10.0 * np.log10(ratio)
        lowest, highest = self._tolerance_db(error_db)
        over = np.nan_to_num(np.maximum(off_db - highest, lowest - off_db), nan=np.inf)
        edged = np.concatenate([[-np.inf], over, [-np.inf]])
        # share of an error by which a point that the search left out may be off before it is taken in
        return np.asarray((over > 0.003 * error_db) & (over >= edged[:-2]) & (over >= edged[2:]))

    def _tolerance_db(self, error_db: float) -> tuple[FloatArray, FloatArray]:
        """Return the least and the greatest error at every point of the grid, dB, (n,) each."""
        floor = -np.inf if self._goal.floor_db is None else self._goal.floor_db
        spare = max(0.0, 1.0 - max(0.0, error_db - _FINE_DB) / (_COARSE_DB - _FINE_DB))
        most = min(0.0, _MOST_NARROWED_DB * spare - error_db)
        narrowed = np.minimum(np.maximum(-error_db, floor), most)
        return narrowed - self._goal.allowance_db, error_db + self._goal.allowance_db

    def _solve(
        self, error_db: float, options: dict[str, Any] | None = None, at: NDArray[np.bool_] | None = None
    ) -> Coefficients | None:
        """Find coefficients (of N, of D) that keep the error at the grid's points `at` (None: all), as far inside the
        constraints as can be, or None.
        """
        places = np.ones(self._goal.frequency_hz.size, dtype=bool) if at is None else at
        lowest, highest = (side[places, None] for side in self._tolerance_db(error_db))
        root, least = 10.0 ** (highest / 20.0), 10.0 ** (lowest / 20.0)
        ceiling = self._ceiling(self._above, error_db)[:, None]
        sizes, outside = self._sizes(self._goal.frequency_hz[places]), self._sizes(self._above)
        above = fractions(self._squares(self._above), self._corners) / outside
        over = self._numerators(self._above) / outside
        none = np.zeros_like(above)
        n, m = int(np.sum(places)), above.shape[0]
        top, bottom = self._target[places] / self._scale / sizes, self._basis[places] / sizes
        rows = np.vstack(
            [
                np.hstack([top / root, -root * bottom, np.ones((n, 1))]),
                np.hstack([-top / least, least * bottom, np.ones((n, 1))]),
                np.hstack([over / self._scale / ceiling, -above, np.full((m, 1), 1e-3)]),
                np.hstack([none, -above, np.full((m, 1), 1e-2)]),
                np.hstack([-over / self._scale / ceiling, none, np.full((m, 1), 1e-7)]),
            ]
        )
        size = self.order + 1
        cost = np.append(np.zeros(2 * size), -1.0)
        bounds = [(-1.0, 1.0)] * (2 * size) + [(0.0, None)]
        asked = {"presolve": self._is_delicate, **(options or {})}
        result = scipy.optimize.linprog(
            cost, rows, np.zeros(rows.shape[0]), bounds=bounds, method="highs-ds", options=asked
        )
        if result.status != 0 or result.x[-1] <= 1e-7:
            return None
        return result.x[:size] / self._scale, result.x[size : 2 * size]

    def _ceiling(self, frequency_hz: FloatArray, error_db: float) -> FloatArray:
        """Return the ceiling as a squared magnitude: what the filter is sure to reach in the band."""
        more = np.where(frequency_hz < self._goal.falls_above_hz, _BETWEEN_DB, 0.0)
        return np.asarray(10.0 ** ((self._goal.ceiling_db - error_db + more - self._middle_db) / 10.0))

    def violations(self, coefficients: Coefficients) -> FloatArray:
        """Return frequencies off the grid, outside the band, where N or D is not positive or the ceiling is passed."""
        low, top = self._goal.frequency_hz[self._goal.allowance_db == 0.0][[0, -1]]
        dense = np.concatenate([np.geomspace(low / 30.0, low, 1000), np.geomspace(top, 0.4999 * self._rate_hz, 4000)])
        numerator = self._numerators(dense) @ coefficients[0]
        denominator = fractions(self._squares(dense), self._corners) @ coefficients[1]
        ceiling = self._ceiling(dense, self._lower_bound_db)
        reach = self._goal.above_hz[0]
        room = np.minimum(denominator / np.max(np.abs(denominator)), numerator / np.max(np.abs(numerator)))
        over = (dense >= reach) & (numerator > 1.001 * ceiling * denominator)
        bad = np.flatnonzero((room <= 0.0) | over)
        return np.unique(dense[bad[:: max(1, bad.size // 12)]]) if bad.size else np.empty(0)

    def add(self, frequency_hz: FloatArray) -> None:
        """Keep the constraints outside the band at these frequencies too."""
        self._above = np.unique(np.append(self._above, frequency_hz))

    @cached_property
    def filter(self) -> SampledSystem:
        """Return the spectral factorisation: the roots of N and D in the stable half, with the mean error taken out."""
        zeros = self._roots(self._coefficients[0], self._zero_corners)
        poles = self._roots(self._coefficients[1], self._corners)
        shape = SampledSystem(zeros, poles, 1.0, self._rate_hz)
        inside = self._goal.allowance_db == 0.0
        frequency = self._goal.frequency_hz[inside]
        miss = 20.0 * np.log10(np.abs(shape.response(frequency))) - self._goal.level_db[inside]
        gain = 10.0 ** (-0.5 * float(np.max(miss) + np.min(miss)) / 20.0)
        return SampledSystem(zeros, poles, gain, self._rate_hz)

    def _roots(self, coefficients: FloatArray, corners: FloatArray) -> NDArray[np.complex128]:
        """Return z-plane roots, |z| < 1, of c_0 + sum c_k a_k/(x + a_k), as eigenvalues: diagonal plus rank one."""
        s = -np.sqrt(-off_the_axis(fraction_roots(coefficients, corners)) * self._unit)
        return np.asarray((1.0 + s) / (1.0 - s), dtype=np.complex128)


_REFINED_ORDER, _REFINED_DB = 8, (0.22, 0.45, 0.45)


def fit_magnitude(goal: MagnitudeGoal, rate_hz: float, order: int) -> SampledSystem:
    """Return the stable, minimum-phase filter of `order` poles (and as many zeros) nearest to the goal, in maximum dB.

    The common error is within 3 % of the least possible: a little is given up for poles and zeros that keep away from
    the unit circle. Raises BadInput if no filter of that order is within 16 dB.
    """
    steep = float(np.ptp(goal.level_db)) > STEEP_DB
    failed: BadInput | None = None
    programs: list[Program] = []
    for shaped in (False, True) if steep else (False,):
        try:
            programs.append(Program(goal, rate_hz, order, shaped))
        except BadInput as error:
            failed = error
    if not programs:
        assert failed is not None
        raise failed
    return _refined(min(programs, key=_off_db)).filter


def fit_within(goal: MagnitudeGoal, rate_hz: float, order: int, error_db: float) -> SampledSystem | None:
    """Return a filter of `order` poles whose common error is no more than `error_db`, or None if none was found: much
    quicker than to ask for the least error.
    """
    for shaped in (False, True) if float(np.ptp(goal.level_db)) > STEEP_DB else (False,):
        try:
            program = Program(goal, rate_hz, order, shaped, within_db=error_db)
        except BadInput:
            continue
        # what rounding may make of an error that a linear program keeps
        if program.excess_db == 0.0 and program.error_db <= 1.1 * error_db:
            return program.filter
    return None


def _refined(best: Program) -> Program:
    """Solve the program again in a basis of its solution's roots, as long as it is poor and that helps."""
    for enough_db in _REFINED_DB:
        if best.excess_db == 0.0 and (best.order < _REFINED_ORDER or best.error_db <= enough_db):
            break
        try:
            again = best.again()
        except BadInput:
            break
        if _off_db(again) >= _off_db(best):
            break
        best = again
    return best


def _off_db(program: Program) -> float:
    """Return the error of the program's filter from its goal, dB: in the band and, above it, beyond the ceiling."""
    return program.error_db + program.excess_db
