"""The residual's own colour: an autoregressive model of it, and the filter that takes the colour away."""

from __future__ import annotations

import numpy as np
from scipy import linalg, signal

from tactuator.arrays import FloatArray


def autocorrelation(values: FloatArray, lags: int) -> FloatArray:
    """Return the biased autocovariance at lags 0 .. lags of `values` (n,), shape (lags + 1,)."""
    size = 1 << int(np.ceil(np.log2(values.size + lags + 1)))
    spectrum = np.abs(np.fft.rfft(values, size)) ** 2
    return np.asarray(np.fft.irfft(spectrum, size)[: lags + 1] / values.size)


def whitening_filter(residual: FloatArray, highest_order: int = 40) -> FloatArray:
    """Return the coefficients 1, h1, .. hp of the prediction-error filter of `residual` (n,), p by Akaike's criterion.

    Levinson and Durbin's recursion on the autocovariance; p = 0 (white) gives [1].
    """
    order = min(highest_order, residual.size // 50)
    covariance = autocorrelation(residual - residual.mean(), order)
    if covariance[0] <= 0.0:
        return np.ones(1)
    best, best_score = np.ones(1), residual.size * np.log(covariance[0])
    filtered, error = np.ones(1), covariance[0]
    for p in range(1, order + 1):
        reflection = -float(filtered @ covariance[p:0:-1]) / error
        padded = np.append(filtered, 0.0)
        filtered = padded + reflection * padded[::-1]
        error *= 1.0 - reflection**2
        if error <= 1e-14 * covariance[0]:
            break
        score = residual.size * np.log(error) + 2.0 * p
        if score < best_score - 4.0:
            best, best_score = filtered, score
    return best


def apply_filter(coefficients: FloatArray, values: FloatArray) -> FloatArray:
    """Return `values` (n,) or (n, k) through the filter, along the first axis, from rest."""
    if coefficients.size == 1:
        return np.asarray(values * coefficients[0])
    if values.ndim == 1:
        return np.asarray(signal.oaconvolve(values, coefficients)[: values.size])
    return np.asarray(signal.oaconvolve(values, coefficients[:, None], axes=0)[: values.shape[0]])


def toeplitz_covariance(covariance: FloatArray) -> FloatArray:
    """Return the matrix of a stationary signal's autocovariance (p,), shape (p, p)."""
    return np.asarray(linalg.toeplitz(covariance))
