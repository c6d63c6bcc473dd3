"""How many fractional bits a filter's coefficients need, by form and sampling rate (the paper's remark, section 5).

Poles crowd towards z = 1 as the rate rises, so coefficients of z^-1 need ever more bits; one direct form of high order
more than second-order sections, and sections in delta form (polynomials in (z - 1) rate, whose coefficients tend to
those of the continuous filter) hardly any.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from math import comb
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tactuator.signals.decibels import db
from tactuator.signals.sections import backward_difference
from tactuator.signals.systems import SampledSystem

Array = NDArray[np.float64]
Form = Literal["direct", "sections", "delta"]
FORMS: tuple[Form, ...] = ("direct", "sections", "delta")
MOST_BITS = 44

_HZ = np.geomspace(0.1, 300.0, 120)
_TOLERANCE_DB = 0.1


@dataclass(frozen=True)
class BitsNeeded:
    """Fractional bits from which on every coarser rounding fails no more: to be stable, and to keep 0.1 dB."""

    stable: int
    accurate: int


def rounded(coefficients: Array, bits: int) -> Array:
    """The coefficients to `bits` fractional bits, to nearest."""
    return np.asarray(np.round(coefficients * 2.0**bits) * 2.0**-bits)


def in_difference(coefficients: Array) -> Array:
    """A polynomial in z, descending powers, as one in d = z - 1: every coefficient summed without rounding error."""
    order = len(coefficients) - 1
    sums = [Fraction(0)] * (order + 1)
    for index, value in enumerate(coefficients):
        power = order - index
        for lower in range(power + 1):
            sums[order - lower] += Fraction(float(value)) * comb(power, lower)
    return np.array([float(one) for one in sums])


def rounded_blocks(system: SampledSystem, form: Form, bits: int) -> list[tuple[Array, Array]]:
    """Numerators and denominators, as polynomials in d, of the system with coefficients rounded in that form."""
    if form == "direct":
        den = np.atleast_1d(np.real(np.poly(system.poles)))
        num = np.zeros(den.size)
        num[den.size - 1 - system.zeros.size :] = system.gain * np.atleast_1d(np.real(np.poly(system.zeros)))
        return [(in_difference(rounded(num, bits)), in_difference(rounded(den, bits)))]
    halves = [(row[:3], row[3:]) for row in system.sections()]
    if form == "sections":
        return [(in_difference(rounded(num, bits)), in_difference(rounded(den, bits))) for num, den in halves]
    scale = system.rate_hz ** np.arange(3)
    return [
        (rounded(in_difference(num) * scale, bits) / scale, rounded(in_difference(den) * scale, bits) / scale)
        for num, den in halves
    ]


def response_of(blocks: list[tuple[Array, Array]], rate_hz: float, frequency_hz: Array = _HZ) -> NDArray[np.complex128]:
    """Response of a cascade of polynomials in d, at frequency_hz (n,)."""
    d = backward_difference(frequency_hz, rate_hz) * np.exp(2j * np.pi * frequency_hz / rate_hz)
    values = np.ones(frequency_hz.size, dtype=np.complex128)
    for num, den in blocks:
        values = values * np.polyval(num, d) / np.polyval(den, d)
    return values


def filter_bits(system: SampledSystem, form: Form) -> BitsNeeded:
    """Bits for a filter by itself (the prefilter): poles inside the unit circle; its own response within 0.1 dB."""
    exact = system.response(_HZ)

    def is_stable(blocks: list[tuple[Array, Array]]) -> bool:
        return all(bool(np.all(np.abs(1.0 + np.roots(den)) < 1.0)) for _, den in blocks)

    def error_db(blocks: list[tuple[Array, Array]]) -> float:
        return float(np.max(np.abs(db(response_of(blocks, system.rate_hz) / exact))))

    return _needed(lambda bits: rounded_blocks(system, form, bits), is_stable, error_db)


def loop_bits(controller: SampledSystem, plant: SampledSystem, form: Form) -> BitsNeeded:
    """Bits for a feedback controller: the closed loop stable; T within 0.1 dB. plant: with the computing delay."""
    behind = plant.response(_HZ)
    loop = controller.response(_HZ) * behind
    exact = loop / (1.0 + loop)

    def is_stable(blocks: list[tuple[Array, Array]]) -> bool:
        return all(np.any(num) for num, _ in blocks) and _closes(blocks, plant)

    def error_db(blocks: list[tuple[Array, Array]]) -> float:
        rounded_loop = response_of(blocks, plant.rate_hz) * behind
        return float(np.max(np.abs(db(rounded_loop / (1.0 + rounded_loop) / exact))))

    return _needed(lambda bits: rounded_blocks(controller, form, bits), is_stable, error_db)


def _closes(blocks: list[tuple[Array, Array]], plant: SampledSystem) -> bool:
    """Whether 1 + C P has all its zeros inside the unit circle: the polynomial in d, the plant's delay included."""
    num: NDArray[np.floating[Any]] = np.array([plant.gain])
    den: NDArray[np.floating[Any]] = np.ones(1)
    for zero in plant.zeros:
        num = np.polymul(num, [1.0, 1.0 - zero])
    for pole in plant.poles:
        den = np.polymul(den, [1.0, 1.0 - pole])
    for _ in range(plant.delay_samples):
        den = np.polymul(den, [1.0, 1.0])
    for block_num, block_den in blocks:
        num, den = np.polymul(num, block_num), np.polymul(den, block_den)
    return bool(np.all(np.abs(1.0 + np.roots(np.polyadd(num, den))) < 1.0))


def _needed(
    blocks_at: Callable[[int], list[tuple[Array, Array]]],
    is_stable: Callable[[list[tuple[Array, Array]]], bool],
    error_db: Callable[[list[tuple[Array, Array]]], float],
) -> BitsNeeded:
    """From the finest rounding downwards until it fails: a coarser one that happens to fit does not count."""
    stable = accurate = MOST_BITS + 1
    still_accurate = True
    for bits in range(MOST_BITS, -1, -1):
        blocks = blocks_at(bits)
        if not is_stable(blocks):
            break
        stable = bits
        still_accurate = still_accurate and error_db(blocks) <= _TOLERANCE_DB
        if still_accurate:
            accurate = bits
    return BitsNeeded(stable, accurate)
