"""What is read of a belief about a curve: its mean, and a band of the quantiles of a mixture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from tactuator.arrays import FloatArray

_TAIL = 0.025
_HALVINGS = 24
_WIDENED = 1.3
"""Factor by which bands are wider than the belief has them: it makes them hold for people whose slopes and lapse rates
lie between the few of the belief, as witnesses.curve.populations draws them."""


@dataclass(frozen=True)
class CurveReading:
    """A curve in dB SL: mean, standard deviation and 95 % band, each (runs, frequencies), or (frequencies,)."""

    mean: FloatArray
    sd: FloatArray
    low: FloatArray
    high: FloatArray


def mixed(share: FloatArray, level: FloatArray, sd: FloatArray) -> CurveReading:
    """Return the reading of a mixture of normal marginals.

    share: (runs, components), of sum 1. level, sd: (runs, components, frequencies).
    """
    mean = np.einsum("rk,rkf->rf", share, level)
    spread = np.sqrt(np.einsum("rk,rkf->rf", share, sd**2 + (level - mean[:, None]) ** 2))
    used = np.flatnonzero((share > 0.0).any(axis=0))
    part = share[:, used], level[:, used], sd[:, used]
    low, high = (_quantile(*part, mean, spread, tail) for tail in (_TAIL, 1.0 - _TAIL))
    low, high = (mean + _WIDENED * (edge - mean) for edge in (low, high))
    return CurveReading(mean, _WIDENED * spread, low, high)


def _quantile(
    share: FloatArray, level: FloatArray, sd: FloatArray, mean: FloatArray, spread: FloatArray, tail: float
) -> FloatArray:
    """Return a quantile of the mixture by halving, (runs, frequencies)."""
    reach = 1.0 / np.sqrt(min(tail, 1.0 - tail))  # Chebyshev: no quantile lies further from the mean
    low, high = mean - reach * spread, mean + reach * spread
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        below = np.einsum("rk,rkf->rf", share, scipy.special.ndtr((middle[:, None] - level) / sd)) < tail
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.asarray(0.5 * (low + high))
