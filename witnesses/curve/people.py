"""People with threshold curves of their own, and how they answer; nothing of the program is used.

A curve is relative to a library curve (0 dB SL). Its wave is white noise that a Gaussian filter smooths; the library
curve is a table of this file (thenar, Bolanowski et al. 1988), because the loss of one channel leaves the other where
it stands, and the distance between the two is needed for that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

BAND_HZ = (0.4, 300.0)
GUESS, TARGET = 1.0 / 3.0, 0.5 ** (1.0 / 3.0)
"""Three intervals; a threshold is where 79.4 % of answers are right, lapses included."""

_STEP = 0.005
_GRID = np.arange(np.log10(BAND_HZ[0]) - 1.0, np.log10(BAND_HZ[1]) + 1.0, _STEP)
_LIBRARY_HZ = (0.4, 3.0, 5.0, 10.0, 20.0, 30.0, 40.0, 60.0, 80.0, 100.0, 150.0, 200.0, 250.0, 300.0)
_LIBRARY_DB = (26.0, 26.0, 23.25, 19.0, 15.5, 14.5, 11.0, 5.0, 0.0, -4.0, -10.5, -15.0, -17.0, -18.0)
_OTHER_CHANNEL_DB = 14.5
"""Threshold of the channels that are not Pacinian, from 25 Hz: there the library curve is theirs, and is flat."""


@dataclass(frozen=True)
class Population:
    """People of one sort.

    wave_db, wave_decades: of the wave. shift_db: added everywhere. feature: a notch of feature_db at any place with a
    width (standard deviation) of 0.05 to 0.3 decade, a loss of the Pacinian channel by feature_db, or an edge. slope,
    lapse: from, to. drift_db: rise over the run, up or down. guessed: share of trials. epochs: share of the run that
    is spent in stretches of twelve trials without attention. honest: the claims are made for them.
    """

    name: str
    shift_db: float = 0.0
    feature: Literal["", "notch", "pacinian"] = ""
    feature_db: float = 0.0
    slope: tuple[float, float] = (1.5, 4.0)
    lapse: tuple[float, float] = (0.0, 0.04)
    drift_db: float = 0.0
    guessed: float = 0.0
    epochs: float = 0.0
    honest: bool = True
    wave_db: float = 3.0
    wave_decades: float = 0.25


POPULATIONS = (
    Population("normal"),
    Population("30 dB of loss", shift_db=30.0),
    Population("notch", feature="notch", feature_db=15.0),
    Population("Pacinian loss", feature="pacinian", feature_db=30.0),
    Population("10 % lapses", lapse=(0.1, 0.1)),
    Population("flat slopes", slope=(0.9, 1.3)),
    Population("steep slopes", slope=(4.0, 6.0)),
    Population("drift", drift_db=6.0),
    Population("epochs", epochs=0.16, honest=False),
    Population("30 % guessed", guessed=0.3, honest=False),
)
"""The ten of the facts' section 16; the last two err in more than a tenth of the trials that they feel."""


class People:
    """Some people of a population, who answer trials.

    notch_hz, notch_decades: place and width of everybody's notch, NaN where there is none.
    """

    def __init__(self, of: Population, count: int, trials: int, rng: np.random.Generator) -> None:
        self.of, self.count, self._trials, self._rng = of, count, trials, rng
        self.notch_hz, self.notch_decades = np.full(count, np.nan), np.full(count, np.nan)
        self._curve = of.shift_db + self._waves() + self._features()
        self._slope, self._lapse = rng.uniform(*of.slope, count), rng.uniform(*of.lapse, count)
        self._drift = of.drift_db * rng.choice([-1.0, 1.0], count)
        self._away = np.zeros((count, trials), dtype=bool)
        for person in range(count):
            while self._away[person].mean() < of.epochs:
                start = int(rng.integers(trials))
                self._away[person, start : start + 12] = True

    def _waves(self) -> Floats:
        """Return waves: the correlation of noise through a Gaussian of width w is a Gaussian of width w sqrt(2)."""
        width = self.of.wave_decades / np.sqrt(2.0)
        reach = np.arange(-4.0 * width, 4.0 * width + _STEP, _STEP)
        kernel = np.exp(-0.5 * (reach / width) ** 2)
        kernel *= self.of.wave_db / np.sqrt(np.sum(kernel**2))
        noise = self._rng.standard_normal((self.count, _GRID.size + reach.size - 1))
        return np.array([np.convolve(one, kernel, "valid") for one in noise])

    def _features(self) -> Floats:
        of, rng, count = self.of, self._rng, self.count
        if of.feature == "notch":
            at = rng.uniform(float(np.log10(BAND_HZ[0])), float(np.log10(BAND_HZ[1])), count)
            self.notch_hz, self.notch_decades = 10.0**at, rng.uniform(0.05, 0.3, count)
            away = (_GRID - at[:, None]) / self.notch_decades[:, None]
            return np.asarray(of.feature_db * np.exp(-0.5 * away**2))
        if of.feature == "pacinian":
            library = np.interp(_GRID, np.log10(_LIBRARY_HZ), _LIBRARY_DB)
            other = _OTHER_CHANNEL_DB + rng.normal(0.0, 3.0, (count, 1))
            gap = np.where(np.log10(25.0) < _GRID, np.maximum(other - library, 0.0), 0.0)
            return np.minimum(gap, of.feature_db)
        return np.zeros((count, _GRID.size))

    def threshold(self, frequency_hz: Floats) -> Floats:
        """Return everybody's threshold in dB SL at the frequencies (n,) or, one row for each, (people, n)."""
        asked = np.broadcast_to(np.log10(frequency_hz), (self.count, np.shape(frequency_hz)[-1]))
        return np.array([np.interp(row, _GRID, curve) for row, curve in zip(asked, self._curve, strict=True)])

    def answers(self, frequency_hz: Floats, level_db_sl: Floats, trial: int) -> NDArray[np.bool_]:
        """Return who is right in that trial; arguments (people,)."""
        moved = self._drift * (trial / max(self._trials - 1, 1) - 0.5)
        above = level_db_sl - self.threshold(frequency_hz[:, None])[:, 0] - moved
        felt = 1.0 - self._lapse - GUESS
        at_threshold = (TARGET - GUESS) / felt
        rise = -np.expm1(np.log1p(-at_threshold) * 10.0 ** (self._slope * above / 20.0))
        lost = self._away[:, trial] | (self._rng.random(self.count) < self.of.guessed)
        chance = np.where(lost, GUESS, GUESS + felt * rise)
        return np.asarray(self._rng.random(self.count) < chance)
