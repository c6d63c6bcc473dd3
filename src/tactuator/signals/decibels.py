"""Decibels of amplitude ratios, and back."""

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray


def db(ratio: ArrayLike) -> FloatArray:
    """Return the level of an amplitude ratio: 20 log10 |ratio|, in dB; any shape, complex allowed; 0 gives -inf."""
    magnitude = np.abs(np.asarray(ratio))
    with np.errstate(divide="ignore"):
        return np.asarray(20.0 * np.log10(magnitude), dtype=np.float64)


def from_db(level_db: ArrayLike) -> FloatArray:
    """Return the amplitude ratio of a level in dB: 10^(level/20); any shape."""
    return np.asarray(10.0 ** (np.asarray(level_db, dtype=np.float64) / 20.0))


def half_width_db(magnitude: ArrayLike, half_width: ArrayLike) -> FloatArray:
    """Return the half-width of a magnitude in dB: 20 log10(1 + half_width / |magnitude|); arguments broadcast.

    It is infinite where the half-width reaches the magnitude: what was found may then be noise alone, which has a
    magnitude but says nothing of the response.
    """
    size, width = np.broadcast_arrays(np.abs(np.asarray(magnitude)), np.asarray(half_width, dtype=np.float64))
    is_clear = size > width
    return np.where(is_clear, 20.0 * np.log10(1.0 + width / np.where(is_clear, size, 1.0)), np.inf)
