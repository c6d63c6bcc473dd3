"""Partial fractions in x = tan^2(pi f / rate): values, roots, and corners that suit a shape."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from tactuator.arrays import FloatArray

_LEAST_DAMPING = 0.005


def fractions(square: FloatArray, corners: FloatArray) -> FloatArray:
    """Return the fractions 1 and a_k/(x + a_k), shape (n, order + 1)."""
    return np.hstack([np.ones((square.size, 1)), corners / (square[:, None] + corners)])


def fraction_roots(coefficients: FloatArray, corners: FloatArray) -> NDArray[np.complex128]:
    """Return the roots in x of c_0 + sum c_k a_k/(x + a_k), shape (order,): generalised eigenvalues of a bordered
    diagonal.

    The small ones stay right where c_0 is next to nothing and one root is all but infinite; no size is beyond 1e12.
    """
    weights = coefficients * np.append(1.0, corners) / np.max(np.abs(coefficients))
    rows = 1.0 / (1.0 + corners)
    fixed = np.block([[weights[:1, None], weights[None, 1:]], [-rows[:, None], np.diag(corners * rows)]])
    top, bottom = linalg.eigvals(fixed, -np.diag(np.append(0.0, rows)), homogeneous_eigvals=True)
    finite = np.argsort(np.abs(bottom) / (np.abs(top) + np.abs(bottom)))[1:]
    top, bottom = top[finite], bottom[finite]
    far = np.abs(bottom) < 1e-12 * np.abs(top)
    return np.asarray(np.where(far, -1e12, top / np.where(far, 1.0, bottom)), dtype=np.complex128)


def shaping_corners(corners: FloatArray, square: FloatArray, ratio: FloatArray) -> FloatArray:
    """Return corners b_k such that prod (x + b_k)/(x + a_k) rises and falls about as `ratio` does from one a_k to the
    next.

    A factor changes by a/b as x passes: b_k = a_k / (the change of the ratio around a_k), all different.
    """
    inside = square > 0.0
    x, level = np.log(square[inside]), np.log(ratio[inside])
    middles = np.log(corners)
    half = 0.5 * (middles[1] - middles[0]) if corners.size > 1 else 1.0
    edges = np.append(middles - half, middles[-1] + half)
    change = np.diff(np.interp(edges, x, level))
    found = np.sort(np.log(corners) - np.clip(change, -9.0, 9.0))
    least = 0.05 * (middles[-1] - middles[0]) / corners.size if corners.size > 1 else 0.0
    for index in range(1, found.size):
        found[index] = max(found[index], found[index - 1] + least)
    return np.asarray(np.exp(found))


def off_the_axis(roots: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the roots in x with those on or beside the positive axis (where a magnitude touches zero) moved off it,
    two by two, to the least damping allowed: x = w^2 exp(+/- 2j asin(damping)).
    """
    angle = 2.0 * np.arcsin(_LEAST_DAMPING)
    upper = roots[roots.imag > 0.0]
    near = (upper.real > 0.0) & (upper.imag < upper.real * np.tan(angle))
    upper = np.where(near, np.abs(upper) * np.exp(1j * angle), upper)
    real = np.sort(roots.real[roots.imag == 0.0])
    touching = real[real > 0.0]
    pairs = np.sqrt(touching[0::2][: touching.size // 2] * touching[1::2]) * np.exp(1j * angle)
    single = -touching[-1:] if touching.size % 2 else np.empty(0)
    upper = np.concatenate([upper, pairs])
    return np.concatenate([upper, np.conj(upper), real[real <= 0.0], single]).astype(np.complex128)
