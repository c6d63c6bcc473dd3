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
