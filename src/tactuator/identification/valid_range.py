"""The frequencies between which a model holds: the record moved the mechanism there, and the band is narrow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.identification.estimate.refined import Samples
from tactuator.identification.spectral.lines import Spectrum, spectrum
from tactuator.model.plant_model import PlantModel

_WIDEST_DB, _WIDEST_RAD = 3.0, 0.345
"""Half-widths of the band, 3 dB and as much of the phase (20 degrees), beyond which the model says nothing."""
_MOVED = 1e-5
"""Power of the command, over its greatest, from which on it moves the mechanism (50 dB)."""
_HIGHEST = 0.47
_SHARE, _FEWEST, _POINTS = 0.02, 12, 200


def valid_range(model: PlantModel, moved_hz: tuple[float, float]) -> tuple[float, float]:
    """Return the longest range within moved_hz over which the band of the model is narrow, Hz; a range of two
    neighbouring frequencies stands for none.
    """
    low, high = moved_hz
    frequency = np.geomspace(low, max(high, 1.01 * low), _POINTS)
    narrow = np.flatnonzero((model.band_db(frequency) <= _WIDEST_DB) & (model.band_rad(frequency) <= _WIDEST_RAD))
    if not narrow.size:
        return (float(frequency[0]), float(frequency[1]))
    # the longest run without a wide place in it
    runs = np.split(narrow, np.flatnonzero(np.diff(narrow) > 1) + 1)
    longest = max(runs, key=len)
    first, last = int(longest[0]), int(longest[-1])
    if first == last:
        first, last = min(first, _POINTS - 2), min(first, _POINTS - 2) + 1
    return (float(frequency[first]), float(frequency[last]))


def moved_range(spectra: Sequence[Spectrum]) -> tuple[float, float]:
    """Return the lowest and the highest frequency at which the commands of the records have power, Hz.

    The lines are those of a Hann window: those of the record as it is hold the jump between its ends too, which falls
    by only 20 dB a decade and moves nothing.
    """
    longest = max(spectra, key=lambda one: one.samples)
    count = longest.samples // 2
    frequency = np.geomspace(longest.spacing_hz, _HIGHEST * longest.rate_hz, max(_POINTS, min(count, 2000)))
    power = np.max([_windowed(one, frequency) for one in spectra], axis=0)
    moved = frequency[power > _MOVED * float(np.max(power))]
    return (float(moved[0]), float(moved[-1]))


def _windowed(taken: Spectrum, frequency_hz: FloatArray) -> FloatArray:
    """Return the mean power of the command's windowed lines about each frequency (m,), 2 % of it or 12 lines wide."""
    lines = taken.command.copy()
    lines[0] = 0.0
    power = np.zeros(lines.size)
    power[1:-1] = np.abs(0.5 * lines[1:-1] - 0.25 * (lines[:-2] + lines[2:])) ** 2 / 0.375
    sums = np.concatenate([[0.0], np.cumsum(power)])
    place = frequency_hz / taken.spacing_hz
    half = np.maximum(0.5 * _SHARE * place, 0.5 * _FEWEST)
    low = np.clip(np.rint(place - half), 0, lines.size - 1).astype(np.int64)
    high = np.clip(np.rint(place + half) + 1, 1, lines.size).astype(np.int64)
    return np.asarray((sums[high] - sums[low]) / (high - low))


def valid_range_of(model: PlantModel, samples: Samples) -> tuple[float, float]:
    """Return the range of a model of these samples that was not fitted in the frequency domain."""
    taken = spectrum(samples.command, samples.position, samples.rate_hz)
    return valid_range(model, moved_range([taken]))
