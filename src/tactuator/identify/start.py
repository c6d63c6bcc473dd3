"""A rational model fitted to an empirical response: the start of the refined estimate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from tactuator.identify.empirical import EmpiricalResponse
from tactuator.identify.structure import RationalModel, Structure

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_FLOOR = 0.01
"""Relative error below which a band is not believed: friction and leakage are not in its scatter."""


def rational_start(
    response: EmpiricalResponse, structure: Structure, rate_hz: float, delay_s: float
) -> tuple[RationalModel, float]:
    """The best of several Sanathanan-Koerner iterations, polished by least squares; and its weighted squared error.

    Source: Sanathanan and Koerner, Transfer function synthesis as a ratio of two complex polynomials, 1963.
    """
    weight = 1.0 / np.hypot(response.relative_error, _FLOOR)
    omega = 2.0 * np.pi * response.frequency_hz
    scale = float(np.exp(np.average(np.log(omega), weights=weight)))
    hold = _hold(omega, rate_hz)
    best: tuple[float, Array] | None = None
    for corner in (None, scale):
        for lag in {delay_s, delay_s + 1.0 / rate_hz} if structure.dead_time else {delay_s}:
            theta = _koerner(
                response.value / hold, omega / scale, weight, structure, lag * scale, corner and corner / scale
            )
            theta, cost = _polish(theta, response.value / hold, omega / scale, weight, structure, delay_s * scale)
            if best is None or cost < best[0]:
                best = (cost, theta)
    assert best is not None
    cost, theta = best
    b, a, lag = structure.split(theta, delay_s * scale)
    return RationalModel(b, a, scale, lag / scale), cost


def _hold(omega: Array, rate_hz: float) -> Complex:
    """What a zero-order hold adds below half the rate, aliases aside."""
    angle = 1j * omega / rate_hz
    return -np.expm1(-angle) / angle


def _koerner(
    target: Complex, omega: Array, weight: Array, structure: Structure, lag: float, corner: float | None
) -> Array:
    s = 1j * omega
    n, m = structure.poles, structure.zeros
    b_columns = np.stack([s**k for k in range(structure.integrated, m + 1)], axis=1) * np.exp(-s * lag)[:, None]
    a_columns = np.stack([s**k for k in range(n)], axis=1)
    denominator = np.ones_like(s) if corner is None else (s + corner) ** n
    theta = np.zeros(structure.count)
    for _ in range(15):
        row = weight / np.abs(target * denominator)
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


def _stable(a: Array) -> Array:
    """Ascending coefficients below the leading one, poles mirrored into the left half-plane."""
    roots = np.roots(np.append(1.0, a[::-1]))
    mirrored = np.where(roots.real > 0.0, -np.conj(roots), roots)
    return np.asarray(np.real(np.poly(mirrored))[:0:-1])


def _polish(
    theta: Array, target: Complex, omega: Array, weight: Array, structure: Structure, lag: float
) -> tuple[Array, float]:
    """Levenberg-Marquardt on the log ratio of model and target: equal relative weight wherever it is equally certain."""
    s = 1j * omega
    size = np.maximum(np.abs(theta), 1e-6)

    def residual(scaled: Array) -> Array:
        b, a, tau = structure.split(scaled * size, lag)
        value = _evaluate(b, a, s) * np.exp(-s * tau)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.log(np.where(value == 0.0, 1e-30, value) / target) * weight
        ratio = np.where(np.isfinite(ratio), ratio, 1e6)
        # a band that is nearly all noise must not decide by its logarithm
        soft = np.sign(ratio.real) * np.minimum(np.abs(ratio.real), 1e4) + 1j * ratio.imag
        return np.concatenate([soft.real, soft.imag])

    result = optimize.least_squares(residual, theta / size, method="trf", loss="soft_l1", max_nfev=30)
    b, a, tau = structure.split(result.x * size, lag)
    return structure.join(b, _stable(a), max(tau, 0.0)), float(result.cost)


def _evaluate(b: Array, a: Array, s: Complex) -> Complex:
    numerator = np.polyval(b[::-1], s)
    return np.asarray(numerator / np.polyval(np.append(1.0, a[::-1]), s))
