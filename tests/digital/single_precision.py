"""The controller's arithmetic once more, in NumPy's float32, straight from the description in core's headers."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Single = np.float32
TINY = Single(1e-30)
ZERO = Single(0.0)


def finite(x: np.float32, limit: float) -> np.float32:
    if np.isnan(x) or abs(x) < TINY:
        return ZERO
    return min(max(x, Single(-limit)), Single(limit))


@dataclass
class Section:
    coefficients: NDArray[np.float32]
    s1: np.float32 = ZERO
    s2: np.float32 = ZERO

    def step(self, x: np.float32) -> np.float32:
        b0, b1, b2, a1, a2 = self.coefficients
        y = b0 * x + self.s1
        s1 = self.s1 + ((b1 * x - a1 * y) + self.s2)
        s2 = self.s2 + (b2 * x - a2 * y)
        at_rest = x == 0 and abs(s1) < TINY and abs(s2) < TINY
        self.s1, self.s2 = (ZERO, ZERO) if at_rest else (s1, s2)
        return y


@dataclass
class ReferenceController:
    prefilter: list[Section]
    feedback: list[Section]
    anti_windup: tuple[np.float32, np.float32]
    command_v: np.float32
    broken: bool = False
    clamped: bool = field(default=False)

    def step(self, reference: np.float32, position_v: np.float32) -> np.float32:
        with np.errstate(all="ignore"):
            value = finite(reference, 1e6)
            for section in self.prefilter:
                value = section.step(value)
            if self.feedback:
                value = value - finite(position_v, 1e3)
                for section in self.feedback:
                    value = section.step(value)
            return self._limited(value)

    def _limited(self, wanted: np.float32) -> np.float32:
        command = wanted if np.isnan(wanted) else min(max(wanted, -self.command_v), self.command_v)
        if self.feedback:
            excess = command - wanted
            self.feedback[-1].s1 += self.anti_windup[0] * excess
            self.feedback[-1].s2 += self.anti_windup[1] * excess
        self.clamped = bool(command != wanted)
        self.broken = self.broken or not abs(wanted) < Single(1e20)
        return ZERO if self.broken else command


def sections(coefficients: NDArray[np.float32]) -> list[Section]:
    return [Section(row) for row in coefficients]
