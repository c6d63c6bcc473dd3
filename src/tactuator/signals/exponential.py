"""The exponential of a small matrix."""

from __future__ import annotations

import numpy as np

from tactuator.arrays import FloatArray

_NORM_MAX = 4.0  # norm of the scaled matrix: few squarings, each of which costs digits
_SERIES_TERMS = 36  # of the series at that norm: the rest is below 1e-19


def matrix_exponential(matrix: FloatArray) -> FloatArray:
    """Return exp(matrix), shape (n, n): Taylor's series of the scaled matrix, squared again (Moler & Van Loan 2003,
    method 3).

    For the few states of a plant over one sample. scipy.linalg.expm wakes every thread of the BLAS for a matrix of
    any size, which costs a hundred times the work itself, and more on a busy machine.
    """
    norm = float(np.max(np.sum(np.abs(matrix), axis=0)))
    squarings = int(np.ceil(np.log2(norm / _NORM_MAX))) if norm > _NORM_MAX else 0
    scaled, unit = matrix / 2.0**squarings, np.eye(matrix.shape[0])
    result = unit
    for term in range(_SERIES_TERMS, 0, -1):
        result = unit + (scaled @ result) / term
    for _ in range(squarings):
        result = result @ result
    return result
