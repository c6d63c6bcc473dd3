"""The parts that a model may consist of: numbers of poles and zeros, a dead time; and a rational model in scaled
frequency.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput


@dataclass(frozen=True)
class Structure:
    """A structure of n poles and m <= n zeros, of which `integrated` at s = 0 (1 for a velocity output, 2 for an
    acceleration).

    dead_time: whether a dead time is estimated too. Parameters: numerator coefficients ascending (from s^integrated),
    denominator coefficients ascending below the leading 1, dead time if estimated.
    """

    poles: int
    zeros: int
    dead_time: bool = False
    integrated: int = 0

    def __post_init__(self) -> None:
        if not (1 <= self.poles <= 6 and self.integrated <= self.zeros <= self.poles):
            raise BadInput(f"{self.poles} poles, {self.zeros} zeros", "1 to 6 poles, no more zeros than poles")

    @property
    def numerator_count(self) -> int:
        """Return the number of free numerator coefficients."""
        return self.zeros + 1 - self.integrated

    @property
    def count(self) -> int:
        """Return the number of parameters."""
        return self.numerator_count + self.poles + int(self.dead_time)

    def split(self, theta: FloatArray, delay: float) -> tuple[FloatArray, FloatArray, float]:
        """Return from theta the numerator ascending (zeros + 1,), denominator ascending without its leading 1 (poles,),
        delay.
        """
        k = self.numerator_count
        b = np.concatenate([np.zeros(self.integrated), theta[:k]])
        return b, theta[k : k + self.poles], float(theta[-1]) if self.dead_time else delay

    def join(self, b: FloatArray, a: FloatArray, delay: float) -> FloatArray:
        """Return theta, the inverse of `split`; b may come with or without its leading zeros."""
        free = b[-self.numerator_count :]
        return np.concatenate([free, a, [delay] if self.dead_time else []])


@dataclass(frozen=True)
class RationalModel:
    """B(p)/A(p) exp(-s delay_s) with p = s/scale_rad_s; b (m+1,) and a (n,) ascending, A monic."""

    b: FloatArray
    a: FloatArray
    scale_rad_s: float
    delay_s: float

    def numerator(self) -> FloatArray:
        """Return the numerator in s over a monic denominator, descending powers."""
        n = self.a.size
        powers = np.arange(self.b.size)
        return np.asarray((self.b * self.scale_rad_s ** (n - powers.astype(float)))[::-1])

    def denominator(self) -> FloatArray:
        """Return the monic denominator in s, descending powers."""
        n = self.a.size
        powers = np.arange(n)
        return np.append(1.0, (self.a * self.scale_rad_s ** (n - powers.astype(float)))[::-1])

    def response(self, frequency_hz: FloatArray) -> NDArray[np.complex128]:
        """Return the complex response at `frequency_hz` (any shape)."""
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)
        p = s / self.scale_rad_s
        value = np.polyval(self.b[::-1], p) / np.polyval(np.append(1.0, self.a[::-1]), p)
        return np.asarray(value * np.exp(-s * self.delay_s))
