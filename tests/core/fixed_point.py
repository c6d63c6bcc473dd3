"""The Q31 arithmetic in APyTypes' fixed-point numbers: the words of core's section_q31.h and controller_q31.h, whose
point stands where the headers say; every rounding and saturation is one `cast`.

    signal       1 + 31 bits      in full scales                accumulator   12 + 52 bits, kept within +/- 512
    coefficient  mantissa / 2^(21 + shift)
"""

from dataclasses import dataclass

import numpy as np
from apytypes import APyFixed, APyFloat, OverflowMode, QuantizationMode
from numpy.typing import NDArray

from tactuator.runtime.coefficients import Q31Section
from tests.core.single_precision import finite

SIGNAL = {"int_bits": 1, "frac_bits": 31}
STATE = {"int_bits": 12, "frac_bits": 52}
MOST = APyFixed(2**61, **STATE)
REST = APyFixed(0, **STATE)
PER_VOLT, PER_THRESHOLD = 2.0**22, float(np.float32(2147483.648))


def signal(lsb: int) -> APyFixed:
    return APyFixed(lsb, **SIGNAL)


def lsb(value: APyFixed) -> int:
    """A signal in units of its last bit."""
    return int(value.to_fraction() * 2**31)


def coefficient(mantissa: int, shift: int) -> APyFixed:
    return APyFixed(mantissa, int_bits=11 - shift, frac_bits=21 + shift)


def down(value: APyFixed) -> APyFixed:
    """To an accumulator's last bit, downwards; as wide as it must be."""
    return value.cast(frac_bits=52, quantization=QuantizationMode.TRN)


def bounded(state: APyFixed) -> APyFixed:
    return min(max(state, -MOST), MOST).cast(**STATE)


def saturated(value: APyFixed) -> APyFixed:
    """To a signal: to nearest, halves upwards, stopped at full scale."""
    return value.cast(**SIGNAL, quantization=QuantizationMode.RND, overflow=OverflowMode.SAT)


class FixedSection:
    """One section; what rounding takes from y stays in s1."""

    def __init__(self, section: Q31Section) -> None:
        shifts = [section.shifts[row] for row in (0, 1, 2, 1, 2)]
        self.coefficients = [coefficient(m, shift) for m, shift in zip(section.mantissas, shifts, strict=True)]
        self.s1 = self.s2 = REST

    def shift(self, x: APyFixed) -> APyFixed:
        """What one sample would have left otherwise, had its input been greater by x: a section at rest's own step."""
        s1, s2 = self.s1, self.s2
        self.s1 = self.s2 = REST
        y = self.step(x)
        self.s1, self.s2 = bounded(s1 + self.s1), bounded(s2 + self.s2)
        return y

    def step(self, x: APyFixed) -> APyFixed:
        b0, b1, b2, a1, a2 = self.coefficients
        y = saturated(self.s1 + down(b0 * x))
        self.s1 = bounded(self.s1 + down(b1 * x - a1 * y) + self.s2)
        self.s2 = bounded(self.s2 + down(b2 * x - a2 * y))
        return y


def fixed_of(value: np.float32, scale: float) -> APyFixed:
    """A float32 (finite) times a scale in float32, towards zero; upwards it stops at the last float32 below 2^31."""
    scaled = APyFloat.from_float(float(value), 8, 23) * APyFloat.from_float(scale, 8, 23)
    if scaled.is_inf:
        return signal(-(2**31) if scaled.sign else 2**31 - 128)
    wide = APyFixed.from_number(scaled, int_bits=130, frac_bits=150)
    lsbs = wide.cast(frac_bits=0, quantization=QuantizationMode.TRN_ZERO)
    return signal(int(max(-(2**31), min(2**31 - 128, lsbs.to_fraction()))))


@dataclass
class FixedController:
    """anti_windup: mantissa and shift of each state's gain. command_v: the limit."""

    prefilter: list[FixedSection]
    feedback: list[FixedSection]
    anti_windup: tuple[tuple[int, int], tuple[int, int]]
    command_v: float
    conditioning: tuple[int, int]
    reference_max: int

    def step(self, reference: np.float32, position_v: np.float32) -> np.float32:
        value = asked = fixed_of(finite(reference, 1e6), PER_THRESHOLD)
        for section in self.prefilter:
            value = section.step(value)
        if self.feedback:
            value = saturated(value - fixed_of(finite(position_v, 1e3), PER_VOLT))
            for section in self.feedback:
                value = section.step(value)
        return self._limited(asked, value)

    def _limited(self, asked: APyFixed, wanted: APyFixed) -> np.float32:
        most = fixed_of(np.float32(self.command_v), PER_VOLT)
        command = min(max(wanted, -most), most)
        if self.feedback and command != wanted:
            last, excess = self.feedback[-1], command - wanted
            most = max(abs(asked), signal(self.reference_max))
            worth = (coefficient(*self.conditioning) * excess).cast(frac_bits=31, quantization=QuantizationMode.TRN)
            change = saturated(min(max(asked + worth, -most), most) - asked)
            for section in (*self.prefilter, *self.feedback):
                change = section.shift(change)
            first, second = (coefficient(*gain) for gain in self.anti_windup)
            last.s1 = bounded(last.s1 + down(first * (excess - change)))
            last.s2 = bounded(last.s2 + down(second * (excess - change)))
        return np.float32(np.float32(lsb(command)) / np.float32(PER_VOLT))


def run(
    controller: FixedController, reference: NDArray[np.float32], position: NDArray[np.float32]
) -> NDArray[np.uint32]:
    """Bits of the commands."""
    return np.array([controller.step(r, y) for r, y in zip(reference, position, strict=True)], np.float32).view(
        np.uint32
    )
