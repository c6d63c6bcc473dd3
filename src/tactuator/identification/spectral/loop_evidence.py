"""The command's own likelihood given what a fit leaves of the position: in a loop it has a say in the hold.

In a loop the command follows the noise. A model that answers the command at once, or before it, then takes for an
answer what the noise did to the command, and the likelihood of the position given the command favours it wrongly. The
likelihood of both signals does not: to the position's it adds that of the command given the residual, which a loop's
filter can only follow causally (identifiability in a loop: Soderstrom and Stoica, System Identification, 1989,
chapter 10).
"""

from __future__ import annotations

import numpy as np
from scipy import linalg

from tactuator.arrays import FloatArray
from tactuator.identification.spectral.lines import Spectrum
from tactuator.identification.spectral.record_residual import Residual

_LENGTHS = (2, 5, 10, 20, 40)
"""Lengths of the filter that are tried, samples."""
_SMEARED = 3
"""Samples by which the filters before the converters let a band-limited command seem to run ahead of the noise."""
_NEAR = 40
"""Lines over which powers are averaged: they may fall by much towards half the rate, and all is lost in a wide mean."""
_NUGGET = 1e-7


def joint_misfit(taken: Spectrum, left: Residual, highest_hz: float, *, filtered: bool) -> tuple[float, float]:
    """Return -2 log likelihood of position and command, constants aside, from the lines up to highest_hz of what a fit
    leaves, and how much of it a loop explains; filtered as for `explained_by_loop`.
    """
    inside = taken.frequency_hz[1:] <= highest_hz
    power = _mean(np.where(inside, np.abs(left.lines[1:]) ** 2, 0.0)) / np.maximum(
        _mean(inside.astype(np.float64)), 1e-3
    )
    own = 2.0 * float(np.sum(np.log(np.maximum(power[inside], 1e-30))))
    by_loop = explained_by_loop(taken, left, highest_hz, filtered=filtered)
    return own - by_loop, by_loop


def explained_by_loop(taken: Spectrum, left: Residual, highest_hz: float, *, filtered: bool) -> float:
    """Return by how much -2 log likelihood of the command's lines up to highest_hz falls if they follow the residual
    causally, Bayes' price of the filter paid; zero where no loop shows. filtered: behind filters, as it were a little
    before it.
    """
    hertz = taken.frequency_hz[1:]
    inside = hertz <= highest_hz
    command = np.where(inside, taken.command[1:], 0.0)
    residual = np.where(inside, left.lines[1:], 0.0)
    counted = np.maximum(_mean(inside.astype(np.float64)), 1e-3)
    before = _mean(np.abs(command) ** 2) / counted
    usable = inside & (before > 0.0)
    weight = np.where(usable, 1.0 / np.where(usable, before, 1.0), 0.0)
    own = np.fft.irfft(np.concatenate([[0.0], weight * np.abs(residual) ** 2]), taken.samples)
    shared = np.fft.irfft(np.concatenate([[0.0], weight * np.conj(residual) * command]), taken.samples)
    own[0] *= 1.0 + _NUGGET
    price, lines = float(np.log(2.0 * usable.sum())), float(usable.sum())
    best, chosen = 0.0, None
    for early in (0, _SMEARED) if filtered else (0,):
        for length in _LENGTHS:
            lags = (np.arange(-early, length) + taken.shift) % taken.samples
            taps = linalg.solve_toeplitz(own[: lags.size], shared[lags])
            share = float(taps @ shared[lags]) * taken.samples / (2.0 * lines)
            # a weight that is not yet the residual's own: less than all, and enough to tell the lengths apart
            won = -2.0 * lines * float(np.log(max(1.0 - share, 1e-9))) - price * lags.size
            if won > best:
                best, chosen = won, (lags, taps)
    if chosen is None:
        return 0.0
    lags, taps = chosen
    sparse = np.zeros(taken.samples)
    sparse[lags] = taps
    after = _mean(np.where(usable, np.abs(command - np.fft.rfft(sparse)[1:] * residual) ** 2, 0.0)) / counted
    return max(best, 2.0 * float(np.sum(np.log(before[usable] / after[usable]))) - price * lags.size)


def _mean(power: FloatArray) -> FloatArray:
    """Return the mean of power (m,) over 40 lines."""
    sums = np.concatenate([[0.0], np.cumsum(power)])
    count, half = power.size, _NEAR // 2
    if count <= 2 * half:
        place = np.arange(count)
        low, high = np.maximum(place - half, 0), np.minimum(place + half + 1, count)
        return np.asarray((sums[high] - sums[low]) / (high - low))
    made, near = np.empty(count), np.arange(half + 1, 2 * half + 1)
    made[half : count - half] = (sums[2 * half + 1 :] - sums[: count - 2 * half]) / (2 * half + 1)
    made[:half] = sums[near] / near
    made[count - half :] = ((sums[count] - sums[count - near]) / near)[::-1]
    return made
