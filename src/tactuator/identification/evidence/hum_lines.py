"""Steady lines in a residual (hum): found by their spectrum, to be fitted beside the model."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy import ndimage

from tactuator.arrays import FloatArray

_STRENGTH = 40.0
"""Power over the median around it: chance makes one bin in e^28 as strong."""


def find_lines(residual: FloatArray, command: FloatArray, rate_hz: float, most: int = 8) -> FloatArray:
    """Return the frequencies (hertz, ascending) of up to `most` lines in residual (n,) that the command (n,) does not
    excite.

    Multiples of 50 and 60 Hz count although the command carries them: feedback puts hum into the command as well.
    """
    count = residual.size
    window = np.hanning(count)
    power = np.abs(np.fft.rfft(window * residual)) ** 2
    driven = np.abs(np.fft.rfft(window * (command - command.mean()))) ** 2
    floor, driven_floor = _median_around(power), _median_around(driven)
    spacing = rate_hz / count
    strong = power > _STRENGTH * floor
    strong[:8] = False
    strong[1:-1] &= (power[1:-1] >= power[:-2]) & (power[1:-1] >= power[2:])
    bins = np.flatnonzero(strong)
    frequency = np.array([_peak(power, int(k)) * spacing for k in bins])
    mains = np.zeros(bins.size, dtype=bool)
    for base in (50.0, 60.0):
        off = np.abs(frequency - base * np.maximum(np.round(frequency / base), 1.0))
        mains |= off < max(0.05, 0.5 * spacing)
    keep = mains | (driven[bins] < 10.0 * driven_floor[bins])
    ranked = np.argsort(-(power[bins] / floor[bins])[keep])[:most]
    return np.sort(frequency[keep][ranked])


def line_columns(frequency_hz: FloatArray, rate_hz: float, count: int) -> FloatArray:
    """Return a constant, then cosine and sine of every line: (count, 1 + 2 k), read-only."""
    return _columns(tuple(float(hertz) for hertz in frequency_hz), rate_hz, count)


@lru_cache(maxsize=2)
def _columns(frequency_hz: tuple[float, ...], rate_hz: float, count: int) -> FloatArray:
    angle = 2.0 * np.pi * np.outer(np.arange(count), frequency_hz) / rate_hz
    columns = np.hstack([np.ones((count, 1)), np.cos(angle), np.sin(angle)])
    columns.flags.writeable = False
    return columns


def _median_around(power: FloatArray) -> FloatArray:
    """Return the median of a few hundred lines around each, in steps: it bends slowly."""
    step = max(1, power.size // 4000)
    width = 61
    trimmed = power[: power.size // step * step].reshape(-1, step)
    medians = ndimage.median_filter(np.median(trimmed, axis=1) if step > 1 else trimmed[:, 0], width, mode="nearest")
    spread = np.repeat(medians, step)
    return np.asarray(np.append(spread, np.full(power.size - spread.size, spread[-1]))) + 1e-300


def _peak(power: FloatArray, k: int) -> float:
    """Place of a Hann-windowed line from the ratio of its two highest bins (Grandke, 1983), in bins."""
    left, right = np.sqrt(power[k - 1]), np.sqrt(power[min(k + 1, power.size - 1)])
    centre = np.sqrt(power[k])
    if right >= left:
        ratio = right / centre
        return k + float((2.0 * ratio - 1.0) / (ratio + 1.0))
    ratio = left / centre
    return k - float((2.0 * ratio - 1.0) / (ratio + 1.0))
