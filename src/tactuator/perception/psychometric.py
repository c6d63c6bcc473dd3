"""Psychometric functions of detection: probability of a correct response against level, m-interval forced choice.

All have the envelope psi(x) = guess + (1 - guess - lapse) * F(x), where F rises from 0 to 1 and x is the level in dB.
The threshold is where psi itself, lapses included, reaches `target`; with guess 1/3, 0.5^(1/3) = 79.37 % is where a
3-down-1-up track balances (Levitt 1971, Table I).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput

TARGET_3_DOWN_1_UP = 0.5 ** (1.0 / 3.0)
"""Share of right answers at which three in a row are as likely as not: 0.794 (Levitt, 1971)."""


@dataclass(frozen=True)
class Weibull:
    """Weibull in amplitude: F = 1 - exp(-k a^slope), a the amplitude re threshold, k = -ln(1 - F(0))."""

    slope: float = 2.5

    def __post_init__(self) -> None:
        if not (np.isfinite(self.slope) and self.slope > 0.0):
            raise BadInput(f"Weibull slope is {self.slope:g}", "a positive number")

    def rise(self, level_db: ArrayLike, at_threshold: ArrayLike) -> FloatArray:
        """Return F at `level_db` re threshold."""
        return weibull_rise(level_db, self.slope, at_threshold)


def weibull_rise(level_db: ArrayLike, slope: ArrayLike, at_threshold: ArrayLike) -> FloatArray:
    """Return F of a Weibull in amplitude with F(0) = at_threshold; arguments broadcast."""
    rate = -np.log1p(-np.asarray(at_threshold, dtype=np.float64))
    exponent = np.asarray(slope, dtype=np.float64) * np.asarray(level_db, dtype=np.float64) * (np.log(10.0) / 20.0)
    return np.asarray(-np.expm1(-rate * np.exp(np.minimum(exponent, 300.0))))


@dataclass(frozen=True)
class Psychometric:
    """Psychometric function psi: the probability of a correct response against level in dB re threshold.

    Raises BadInput unless 0 <= guess < target < 1 - lapse <= 1.
    """

    shape: Weibull
    guess: float = 1.0 / 3.0
    lapse: float = 0.0
    target: float = TARGET_3_DOWN_1_UP

    def __post_init__(self) -> None:
        if not 0.0 <= self.guess < self.target < 1.0:
            raise BadInput(f"guess {self.guess:g}, target {self.target:g}", "0 <= guess < target < 1")
        if not 0.0 <= self.lapse < 1.0 - self.target:
            raise BadInput(f"{self.lapse:g}", f"0 up to, not with, {1.0 - self.target:.4g}", key="lapse")

    @property
    def at_threshold(self) -> float:
        """Return F at the threshold (0 dB)."""
        return (self.target - self.guess) / (1.0 - self.guess - self.lapse)

    def rise(self, level_db: ArrayLike) -> FloatArray:
        """Return F at `level_db` re threshold."""
        return self.shape.rise(level_db, self.at_threshold)

    def probability(self, level_db: ArrayLike) -> FloatArray:
        """Return psi at `level_db` re threshold."""
        return np.asarray(self.guess + (1.0 - self.guess - self.lapse) * self.rise(level_db))
