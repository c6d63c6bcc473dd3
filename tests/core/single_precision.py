"""The controller's arithmetic once more, in NumPy's float32, straight from the description in core's headers."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Single = np.float32
TINY = Single(1e-30)
ZERO = Single(0.0)
COMFORT = Single(10.0 ** (55.0 / 20.0))


def finite(x: np.float32, limit: float) -> np.float32:
    if np.isnan(x) or abs(x) < TINY:
        return ZERO
    return min(max(x, Single(-limit)), Single(limit))


def within(x: np.float32, most: np.float32) -> np.float32:
    return x if np.isnan(x) else min(max(x, -most), most)


@dataclass
class Section:
    coefficients: NDArray[np.float32]
    s1: np.float32 = ZERO
    s2: np.float32 = ZERO

    def shift(self, x: np.float32) -> np.float32:
        """What one sample would have left otherwise, had its input been greater by x."""
        b0, b1, b2, a1, a2 = self.coefficients
        y = b0 * x
        self.s1, self.s2 = self.s1 + (b1 * x - a1 * y), self.s2 + (b2 * x - a2 * y)
        return y

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
    conditioning: np.float32 = ZERO
    reference_max: np.float32 = COMFORT
    broken: bool = False
    clamped: bool = field(default=False)

    def step(self, reference: np.float32, position_v: np.float32) -> np.float32:
        with np.errstate(all="ignore"):
            value = asked = finite(reference, 1e6)
            for section in self.prefilter:
                value = section.step(value)
            if self.feedback:
                value = value - finite(position_v, 1e3)
                for section in self.feedback:
                    value = section.step(value)
            return self._limited(asked, value)

    def _limited(self, asked: np.float32, wanted: np.float32) -> np.float32:
        command = within(wanted, self.command_v)
        if self.feedback and command != wanted:
            excess = command - wanted
            change = within(asked + self.conditioning * excess, max(abs(asked), self.reference_max)) - asked
            for section in (*self.prefilter, *self.feedback):
                change = section.shift(change)
            self.feedback[-1].s1 += self.anti_windup[0] * (excess - change)
            self.feedback[-1].s2 += self.anti_windup[1] * (excess - change)
        self.clamped = bool(command != wanted)
        self.broken = self.broken or not abs(wanted) < Single(1e20)
        return ZERO if self.broken else command


def sections(coefficients: NDArray[np.float32]) -> list[Section]:
    return [Section(row) for row in coefficients]
