"""What is believed of a person's threshold curve before a trial: a Gaussian process over log frequency.

Relative to the display's own curve (0 dB SL), a curve is an offset, a tilt in dB per decade about the band's middle,
and a smooth wave, all normal (Rasmussen & Williams 2006, chapter 2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.errors import BadInput

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class CurvePrior:
    """Standard deviations: offset_db, tilt_db_per_decade, wave_db; wave_decades: the wave's length scale.

    points: frequencies at which trials may be put, even in log frequency over band_hz but kept clearance_hz away from
    multiples of mains_hz, where hum is felt with the stimulus.
    """

    band_hz: tuple[float, float] = (0.4, 300.0)
    offset_db: float = 4.0
    tilt_db_per_decade: float = 2.5
    wave_db: float = 2.0
    wave_decades: float = 0.35
    points: int = 20
    mains_hz: float = 60.0
    clearance_hz: float = 2.0

    def __post_init__(self) -> None:
        low, high = self.band_hz
        if not 0.0 < low < high:
            raise BadInput(f"whole curve: band_hz is [{low:g}, {high:g}]; allowed: 0 < low < high")
        if self.points < 3:
            raise BadInput(f"whole curve: {self.points} points; allowed: 3 or more")
        if min(self.offset_db, self.tilt_db_per_decade, self.wave_db, self.wave_decades) <= 0.0:
            raise BadInput("whole curve: a standard deviation or length is not positive; allowed: positive numbers")

    @property
    def frequency_hz(self) -> Floats:
        """Where trials may be put, shape (points,)."""
        even = np.geomspace(*self.band_hz, self.points)
        nearest = np.maximum(np.round(even / self.mains_hz), 1.0) * self.mains_hz
        gap = even - nearest
        side = np.where(nearest + self.clearance_hz > self.band_hz[1], -1.0, np.where(gap < 0.0, -1.0, 1.0))
        return np.where(np.abs(gap) < self.clearance_hz, nearest + side * self.clearance_hz, even)

    def covariance(self, first_hz: ArrayLike, second_hz: ArrayLike) -> Floats:
        """Prior covariance, dB^2, shape (first, second)."""
        middle = 0.5 * np.log10(self.band_hz[0] * self.band_hz[1])
        a = np.log10(np.asarray(first_hz, dtype=np.float64))[:, None]
        b = np.log10(np.asarray(second_hz, dtype=np.float64))[None, :]
        line = self.offset_db**2 + self.tilt_db_per_decade**2 * (a - middle) * (b - middle)
        return np.asarray(line + self.wave_db**2 * np.exp(-0.5 * ((a - b) / self.wave_decades) ** 2))

    def draw(self, frequency_hz: ArrayLike, count: int, rng: np.random.Generator) -> Floats:
        """Curves of people, dB relative to the display's, shape (count, frequencies)."""
        covariance = self.covariance(frequency_hz, frequency_hz)
        root = np.linalg.cholesky(covariance + 1e-8 * np.eye(len(covariance)))
        return np.asarray(rng.standard_normal((count, len(covariance))) @ root.T)

    def weights(self, frequency_hz: ArrayLike) -> Floats:
        """Maps values at `self.frequency_hz` to their conditional mean at others, shape (others, points)."""
        own = self.covariance(self.frequency_hz, self.frequency_hz) + 1e-6 * np.eye(self.points)
        return np.asarray(np.linalg.solve(own, self.covariance(self.frequency_hz, frequency_hz)).T)
