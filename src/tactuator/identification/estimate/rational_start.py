"""A rational model fitted to an empirical response: the start of the refined estimate."""

from __future__ import annotations

import numpy as np
from scipy import optimize

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.estimate.structure import RationalModel, Structure
from tactuator.identification.evidence.empirical import EmpiricalResponse

_FLOOR = 0.01
"""Relative error below which a band is not believed: friction and leakage are not in its scatter."""


def rational_start(
    response: EmpiricalResponse, structure: Structure, rate_hz: float, delay_s: float
) -> tuple[RationalModel, float]:
    """Return the best of several Sanathanan-Koerner iterations, polished by least squares; and its weighted squared
    error.

    With a dead time, whole samples even in log from delay_s on are tried first. Source: Sanathanan and Koerner,
    Transfer function synthesis as a ratio of two complex polynomials, 1963.
    """
    weight = 1.0 / np.hypot(response.relative_error, _FLOOR)
    omega = 2.0 * np.pi * response.frequency_hz
    scale = float(np.exp(np.average(np.log(omega), weights=weight)))
    fit = _Fit(response.value, omega / scale, weight, structure, _hold(omega, rate_hz), delay_s * scale)
    lags = [delay_s * scale]
    if structure.dead_time:
        lags += [(delay_s + k / rate_hz) * scale for k in (1, 2, 3, 5, 8, 13, 21, 34, 55, 89)]
    starts = [fit.koerner(lag, corner) for lag in lags for corner in (None, 1.0)]
    starts.sort(key=fit.cost)
    polished = [fit.polish(theta) for theta in starts[:2]]
    cost, theta = min(polished, key=lambda one: one[0])
    b, a, lag = structure.split(theta, delay_s * scale)
    return RationalModel(b, a, scale, lag / scale), cost


class _Fit:
    """One structure fitted to one response in scaled frequency: target (m,), omega (m,), weight (m,), hold (m,)."""

    def __init__(
        self,
        target: ComplexArray,
        omega: FloatArray,
        weight: FloatArray,
        structure: Structure,
        hold: ComplexArray,
        delay: float,
    ) -> None:
        self._target, self._omega, self._weight, self._structure = target, omega, weight, structure
        self._hold, self._delay, self._s = hold, delay, 1j * omega

    def koerner(self, lag: float, corner: float | None) -> FloatArray:
        """Solve linear least squares, reweighted by the denominator before; corner: poles of the first one."""
        s, structure = self._s, self._structure
        n, m = structure.poles, structure.zeros
        # what passes at once is not held; where there is such a part the hold is left to the polish
        target = self._target if m == n else self._target / self._hold
        b_columns = np.stack([s**k for k in range(structure.integrated, m + 1)], axis=1) * np.exp(-s * lag)[:, None]
        a_columns = np.stack([s**k for k in range(n)], axis=1)
        denominator = np.ones_like(s) if corner is None else (s + corner) ** n
        theta = np.zeros(structure.count)
        for _ in range(8):
            row = self._weight / np.abs(target * denominator)
            matrix = np.hstack([b_columns, -target[:, None] * a_columns]) * row[:, None]
            goal = target * s**n * row
            size = np.linalg.norm(matrix, axis=0)
            size[size == 0.0] = 1.0
            stacked = np.vstack([matrix.real, matrix.imag]) / size
            solution = np.linalg.lstsq(stacked, np.concatenate([goal.real, goal.imag]), rcond=1e-12)[0] / size
            b, a = solution[: b_columns.shape[1]], _stable(solution[b_columns.shape[1] :])
            denominator = s**n + a_columns @ a
            theta = structure.join(b, a, lag)
        return theta

    def residual(self, theta: FloatArray) -> FloatArray:
        """Return the log ratio of model and target, weighted: equal relative weight wherever it is equally certain."""
        b, a, tau = self._structure.split(theta, self._delay)
        direct = b[-1] if b.size > a.size else 0.0
        held = np.polyval(b[::-1], self._s) / np.polyval(np.append(1.0, a[::-1]), self._s) - direct
        value = (direct + held * self._hold) * np.exp(-self._s * tau)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.log(np.where(value == 0.0, 1e-30, value) / self._target) * self._weight
        ratio = np.where(np.isfinite(ratio), ratio, 1e6)
        return np.concatenate([ratio.real, ratio.imag])

    def cost(self, theta: FloatArray) -> float:
        """Return half the squared error, a band's error counted linearly beyond one standard error."""
        squared = self.residual(theta) ** 2
        return float(np.sum(np.sqrt(1.0 + squared) - 1.0))

    def polish(self, theta: FloatArray) -> tuple[float, FloatArray]:
        """Return the cost and parameters after a descent from theta."""
        size = np.maximum(np.abs(theta), 1e-6)
        result = optimize.least_squares(
            lambda scaled: self.residual(scaled * size), theta / size, method="trf", loss="soft_l1", max_nfev=30
        )
        b, a, tau = self._structure.split(result.x * size, self._delay)
        return float(result.cost), self._structure.join(b, _stable(a), max(tau, 0.0))


def _hold(omega: FloatArray, rate_hz: float) -> ComplexArray:
    """Return what a zero-order hold adds below half the rate, aliases aside."""
    angle = 1j * omega / rate_hz
    return np.asarray(-np.expm1(-angle) / angle)


def _stable(a: FloatArray) -> FloatArray:
    """Return the ascending coefficients below the leading one, poles mirrored into the left half-plane."""
    roots = np.roots(np.append(1.0, a[::-1]))
    mirrored = np.where(roots.real > 0.0, -np.conj(roots), roots)
    return np.asarray(np.real(np.poly(mirrored))[:0:-1])
