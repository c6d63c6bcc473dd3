"""Was the record made in a loop? A loop feeds the sensor's noise back into the command."""

from __future__ import annotations

import numpy as np
from scipy import stats

from tactuator.arrays import FloatArray
from tactuator.identification.spectral.lines import Spectrum
from tactuator.identification.spectral.record_residual import Residual

_CHANCE = 1e-4


def feedback_seen(taken: Spectrum, left: Residual) -> bool | None:
    """Return true where later commands follow the residual, None otherwise: the record cannot tell.

    A loop that is weak, or acts at the lowest frequencies alone, leaves no trace in a residual, so that no residual
    shows that there was none.
    """
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
    follows = float(np.max(np.abs(later))) > highest
    return follows or float(np.sum(later**2)) > 1.3 * float(stats.chi2.isf(_CHANCE, lags)) or None


def _smoothed(power: FloatArray) -> FloatArray:
    width = 201 if power.size > 2000 else 21
    mean = np.convolve(power, np.ones(width) / width, mode="same")
    return np.asarray(mean + 1e-12 * float(power.max()))
