"""Power spectra of records, and levels of lines and bands in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput


@dataclass(frozen=True)
class PowerSpectrum:
    """One-sided power spectral density, unit^2/Hz, at frequency_hz (m,), from `averages` windows."""

    frequency_hz: FloatArray
    density: FloatArray
    averages: float

    @property
    def spacing_hz(self) -> float:
        """Return the distance between two lines, hertz."""
        return float(self.frequency_hz[1])

    def power(self, low_hz: float, high_hz: float, without_hz: ArrayLike = (), width_hz: float = 1.5) -> float:
        """Return the power within low..high, unit^2, without +/- width_hz around each of `without_hz`.

        What was left out is filled with the mean density of the rest, so that a band does not shrink with it; a band
        that is all left out has none.
        """
        edges = self.frequency_hz + 0.5 * self.spacing_hz
        share = np.clip(np.minimum(edges, high_hz) - np.maximum(edges - self.spacing_hz, low_hz), 0.0, None)
        left = np.ones(share.size, dtype=bool)
        for line in np.atleast_1d(np.asarray(without_hz, dtype=np.float64)):
            left &= np.abs(self.frequency_hz - line) > width_hz
        kept = float(np.sum(share * left))
        return float(np.sum(self.density * share * left)) * (float(np.sum(share)) / kept) if kept > 0.0 else 0.0

    def through(self, response: ComplexArray) -> PowerSpectrum:
        """Return the spectrum behind a system with that response (m,) at frequency_hz."""
        return PowerSpectrum(self.frequency_hz, self.density * np.abs(response) ** 2, self.averages)


def power_spectrum(values: ArrayLike, rate_hz: float, resolution_hz: float = 1.0) -> PowerSpectrum:
    """Return Welch's estimate: Hann windows of 1/resolution_hz, half overlapping, mean taken off each.

    values: (n,). Raises BadInput where the record is shorter than one window.
    """
    data = np.asarray(values, dtype=np.float64)
    length = round(rate_hz / resolution_hz)
    if data.ndim != 1 or data.size < length:
        raise BadInput(f"{data.size} samples for a resolution of {resolution_hz:g} Hz", f"{length} or more")
    frequency, density = signal.welch(data, rate_hz, window="hann", nperseg=length, detrend="constant")
    return PowerSpectrum(frequency, density, 1.0 + 1.2 * (data.size / length - 1.0))
