"""Covariance of the estimate, and the band that it puts on the frequency response."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.identification.estimate.structure import RationalModel, Structure


def robust_covariance(jacobian: FloatArray, innovation: FloatArray, past: FloatArray | None = None) -> FloatArray:
    """Return (J'J)^-1 J' Phi J (J'J)^-1 with Phi from the innovation's smoothed spectrum: right though some colour is
    left.

    jacobian (n, p), innovation (n,). past (n, k): the noise model's regressors; in closed loop the plant's estimate
    leans on them, so they are projected out of the jacobian. Source: Ljung, System Identification, 1999, section 9.3.
    """
    if past is not None and past.shape[1]:
        weight = np.linalg.lstsq(past.T @ past, past.T @ jacobian, rcond=1e-10)[0]
        jacobian = jacobian - past @ weight
    n = innovation.size
    size = np.sqrt(np.sum(jacobian**2, axis=0))
    size[size == 0.0] = 1.0
    scaled = jacobian / size
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-13)
    spectrum = np.fft.rfft(scaled, axis=0)
    density = _smooth(np.abs(np.fft.rfft(innovation)) ** 2 / n)
    double = np.full(density.size, 2.0)
    double[0] = 1.0
    if n % 2 == 0:
        double[-1] = 1.0
    weighted = np.real(np.conj(spectrum).T @ (spectrum * (density * double)[:, None])) / n
    return np.asarray(inverse @ weighted @ inverse / np.outer(size, size))


def _smooth(periodogram: FloatArray) -> FloatArray:
    """Return the mean over a tenth of an octave, 8 lines at least."""
    count = periodogram.size
    total = np.concatenate([[0.0], np.cumsum(periodogram)])
    k = np.arange(count)
    half = np.maximum(8, (0.05 * k).astype(int))
    low, high = np.maximum(k - half, 0), np.minimum(k + half + 1, count)
    return np.asarray((total[high] - total[low]) / (high - low))


def response_derivatives(
    model: RationalModel, structure: Structure, frequency_hz: FloatArray
) -> NDArray[np.complex128]:
    """Return d log G / d theta at `frequency_hz` (m,), shape (m, p), theta as `structure` orders it."""
    p = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64) / model.scale_rad_s
    numerator = np.polyval(model.b[::-1], p)
    denominator = np.polyval(np.append(1.0, model.a[::-1]), p)
    by_b = np.stack([p**i for i in range(structure.integrated, model.b.size)], axis=1) / numerator[:, None]
    by_a = -np.stack([p**j for j in range(model.a.size)], axis=1) / denominator[:, None]
    parts = [by_b, by_a]
    if structure.dead_time:
        parts.append(-p[:, None])
    return np.hstack(parts)


def magnitude_band_db(derivatives: NDArray[np.complex128], covariance: FloatArray) -> FloatArray:
    """Return the 95 % half-width of the magnitude in dB, (m,), from `response_derivatives` and the
    covariance of theta.
    """
    real = derivatives.real
    variance = np.einsum("ij,jk,ik->i", real, covariance, real)
    return np.asarray(1.959964 * 20.0 / np.log(10.0) * np.sqrt(np.maximum(variance, 0.0)))


def phase_band_rad(derivatives: NDArray[np.complex128], covariance: FloatArray) -> FloatArray:
    """Return the 95 % half-width of the phase, radians, (m,)."""
    imaginary = derivatives.imag
    variance = np.einsum("ij,jk,ik->i", imaginary, covariance, imaginary)
    return np.asarray(1.959964 * np.sqrt(np.maximum(variance, 0.0)))
