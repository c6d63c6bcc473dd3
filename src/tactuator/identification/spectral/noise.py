"""The noise's power over frequency, from what a model leaves of the record: it weighs the lines.

Weighted by its own residual's spectrum the estimate is consistent in closed loop too, as long as all lines up to half
the rate take part: what the loop feeds back of the noise is causal, so that its sum over the whole circle vanishes.
"""

from __future__ import annotations

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.spectral.joined import JoinedEquations, equation_slices
from tactuator.identification.spectral.lines import Equations

_WIDTH = 0.12
_FEWEST = 40


def noise_power(given: Equations, residual: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """Return the residual's mean power at each equation (e,) and each band (b,), over 12 % of frequency, 40 lines."""
    frequency = np.concatenate([given.of_hz, given.centre_hz])
    power = np.concatenate([np.abs(residual) ** 2, given.rest])
    count = np.concatenate([np.ones(given.of_hz.size), given.spare])
    order = np.argsort(frequency, kind="stable")
    place = frequency[order]
    sums = np.concatenate([[0.0], np.cumsum(power[order])])
    counts = np.concatenate([[0.0], np.cumsum(count[order])])

    def at(hertz: FloatArray) -> FloatArray:
        low = np.searchsorted(place, hertz * (1.0 - 0.5 * _WIDTH))
        high = np.searchsorted(place, hertz * (1.0 + 0.5 * _WIDTH), side="right")
        for _ in range(12):
            few = counts[high] - counts[low] < _FEWEST
            if not np.any(few):
                break
            step = np.maximum(4, (high - low) // 2)
            low, high = (
                np.where(few, np.maximum(low - step, 0), low),
                np.where(few, np.minimum(high + step, place.size), high),
            )
        mean = (sums[high] - sums[low]) / np.maximum(counts[high] - counts[low], 1.0)
        return np.asarray(np.maximum(mean, 1e-30))

    return at(given.of_hz), at(given.centre_hz) if given.centre_hz.size else np.zeros(0)


def weights(given: Equations | JoinedEquations, residual: ComplexArray, highest_hz: float) -> FloatArray:
    """Return one over the noise's deviation at each equation up to highest_hz, zero beyond, (e,); the noise of each
    record is its own.
    """
    pieces = zip(given.parts, equation_slices(given), strict=True)
    by_equation = np.concatenate([noise_power(one, residual[piece])[0] for one, piece in pieces])
    return np.where(given.of_hz <= highest_hz, 1.0 / np.sqrt(by_equation), 0.0)
