"""Was the record made in a closed loop? Yes, no, or cannot tell.

In a loop the command holds what the controller made of the residual's past. Its filter from residual to command is
-S C, and times the plant -T, the loop's complementary sensitivity: near -1 wherever a loop has gain.
"""

from __future__ import annotations

import numpy as np
from scipy import stats

from tactuator.arrays import FloatArray
from tactuator.identification.spectral.lines import Spectrum
from tactuator.identification.spectral.record_residual import Residual

_CHANCE = 1e-4
_ACTS = 0.25
_TOLD = 1000.0
"""Statistic that a weak loop would have had to bring for its absence to mean anything (chance is 1 a line)."""


def feedback_seen(taken: Spectrum, left: Residual) -> bool | None:
    """Return true where later commands follow the residual, false where they would have shown it, None otherwise.

    A weak loop is taken to be proportional, with a loop gain of one half where the plant is strongest, and to act there
    alone: a loop need not reach far beyond.
    """
    plant = left.response
    residual, command = left.lines[1:], taken.command[1:]
    good = (left.weight[1:] > 0.0) & (np.abs(residual) > 0.0)
    power = _smoothed(np.abs(command) ** 2)
    noise = 1.0 / np.where(good, left.weight[1:], 1.0) ** 2
    cross = np.where(good, np.conj(residual) * command / np.sqrt(noise * power), 0.0)
    ahead = np.fft.irfft(np.concatenate([[0.0], cross]), taken.samples) * taken.samples / np.sqrt(2.0 * good.sum())
    lags = min(200, taken.samples // 20)
    # the first lags carry a controller's answer; a chance maximum of that many normal deviates is what it must beat
    later = ahead[taken.shift : lags + taken.shift]
    highest = 1.15 * float(stats.norm.isf(0.5 * _CHANCE / lags))
    if float(np.max(np.abs(later))) > highest or float(np.sum(later**2)) > 1.3 * float(stats.chi2.isf(_CHANCE, lags)):
        return True
    strongest = float(np.quantile(np.abs(plant[good]), 0.98)) if good.any() else 1.0
    weak = 0.5 * plant / strongest
    loop = np.abs(0.5 / strongest / (1.0 + weak)) ** 2 * noise / power
    acts = good & (np.abs(weak) > _ACTS)
    return False if float(np.sum(np.minimum(loop[acts], 1.0))) > _TOLD else None


def _smoothed(power: FloatArray) -> FloatArray:
    width = 201 if power.size > 2000 else 21
    mean = np.convolve(power, np.ones(width) / width, mode="same")
    return np.asarray(mean + 1e-12 * float(power.max()))
