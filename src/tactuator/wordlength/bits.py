"""Fractional bits that a filter's coefficients need, by form and sampling rate (the paper's remark, section 5).

    direct     one polynomial over one polynomial in 1/z        sections   second-order sections, b and a in 1/z
    delta      second-order sections in d = z - 1, coefficients times the power of the rate that makes them those of the
               continuous filter, or nearly

Poles crowd towards z = 1 as the rate rises, so coefficients of z^-1 need ever more bits; one direct form of high order
more than second-order sections, and sections in delta form hardly any. The rounded numbers are a table of rows b0, b1',
..., a1', ... in d (as core/arithmetic/section.h, or longer), and is examined in double precision there, where nothing
more is lost.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import reduce
from math import comb
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.model.controller import ChannelController, Controller
from tactuator.runtime.image import delta_coefficients
from tactuator.signals.decibels import db
from tactuator.signals.discretise import discretise
from tactuator.signals.loop import closed_roots, is_inside
from tactuator.signals.systems import ContinuousSystem, SampledSystem, backward_difference, check_sections

Form = Literal["direct", "sections", "delta"]
FORMS: tuple[Form, ...] = ("direct", "sections", "delta")


def rounded(values: FloatArray, bits: int) -> FloatArray:
    """Return the values rounded to the nearest multiple of 2^-bits."""
    return np.asarray(np.ldexp(np.round(np.ldexp(values, bits)), -bits))


def quantised_rows(sos: ArrayLike, form: Form, bits: int, rate_hz: float) -> FloatArray:
    """Return the rows in d of what is left of the cascade `sos` once its numbers in `form` are rounded: shape (n, 5),
    or (1, 2 order + 1) for the direct form. Raises BadInput for a form that is not there.
    """
    sections = check_sections(sos)
    if form == "delta":
        scale = rate_hz ** np.array([0.0, 1.0, 2.0, 1.0, 2.0])
        return np.asarray(rounded(delta_coefficients(sections) * scale, bits) / scale)
    if form == "sections":
        plain = rounded(sections / sections[:, 3:4], bits)
        plain[:, 3] = 1.0
        return delta_coefficients(plain)
    if form == "direct":
        num, den = _product(sections[:, :3]), _product(sections[:, 3:])
        num, den = num / den[0], np.append(1.0, rounded(den[1:] / den[0], bits))
        return np.concatenate([in_difference(rounded(num, bits)), in_difference(den)[1:]])[None, :]
    raise BadInput(f"form {form!r}", f"{', '.join(FORMS)}")


def in_difference(coefficients: FloatArray) -> FloatArray:
    """Return a polynomial in z, descending powers, as one in d = z - 1, summed without rounding error."""
    order = len(coefficients) - 1
    sums = [Fraction(0)] * (order + 1)
    for index, value in enumerate(coefficients):
        power = order - index
        for lower in range(power + 1):
            sums[order - lower] += Fraction(float(value)) * comb(power, lower)
    return np.array([float(value) for value in sums])


def _product(factors: FloatArray) -> FloatArray:
    """Return the product of polynomials, exact before it is rounded to double."""
    exact = reduce(np.convolve, [np.array([Fraction(float(value)) for value in factor]) for factor in factors])
    return exact.astype(np.float64)


def rows_response(rows: FloatArray, frequency_hz: ArrayLike, rate_hz: float) -> ComplexArray:
    """Return the response of a cascade of rows."""
    frequency = np.asarray(frequency_hz, dtype=np.float64)
    difference = np.exp(2j * np.pi * frequency / rate_hz) * backward_difference(frequency, rate_hz)
    response = np.ones(frequency.shape, dtype=np.complex128)
    for num, den in map(_fraction, rows):
        response = response * np.polyval(num, difference) / np.polyval(den, difference)
    return response


def is_stable(rows: FloatArray, plant: SampledSystem | None = None) -> bool:
    """Return whether the poles lie inside the unit circle; with a plant and its delay: those of the closed loop."""
    poles = np.concatenate([np.roots(den) for _, den in map(_fraction, rows)])
    if plant is None:
        return is_inside(poles)
    zeros, gain = _zeros(rows)
    delay = np.full(plant.delay_samples, -1.0 + 0.0j)
    closed = closed_roots(
        np.concatenate([zeros, plant.zeros - np.complex128(1.0)]),
        np.concatenate([poles, plant.poles - 1.0, delay]),
        gain * plant.gain,
    )
    return is_inside(closed)


def _fraction(row: FloatArray) -> tuple[FloatArray, FloatArray]:
    order = (row.size - 1) // 2
    return row[: order + 1], np.append(1.0, row[order + 1 :])


def _zeros(rows: FloatArray) -> tuple[ComplexArray, float]:
    """Return the zeros in d and the gain before them; without gain there are no zeros."""
    zeros, gain = [np.empty(0, dtype=np.complex128)], 1.0
    for row in rows:
        numerator = np.trim_zeros(_fraction(row)[0], "f")
        if numerator.size == 0:
            return np.empty(0, dtype=np.complex128), 0.0
        gain *= float(numerator[0])
        zeros.append(np.asarray(np.roots(numerator), dtype=np.complex128))
    return np.concatenate(zeros), gain


_MATCH_HZ = 10.0
"""Where a section at another rate has the gain of the first: in the band, far below every rate."""


def at_rate(controller: Controller, rate_hz: float) -> Controller:
    """Return the same F and C, bilinear, at another rate (their own continuous counterparts, without prewarping).

    The display's delay stays one of samples. Anti-windup gains scale with the period. Raises BadInput for a rate that
    the display cannot have.
    """
    display = replace(controller.display, rate_hz=rate_hz)
    channels = tuple(_channel_at(channel, controller.rate_hz, rate_hz) for channel in controller.channels)
    return Controller(display, channels, controller.tool)


def _channel_at(channel: ChannelController, old_hz: float, new_hz: float) -> ChannelController:
    feedback = channel.feedback_sos
    gains = channel.anti_windup.gains
    ratio = old_hz / new_hz
    return replace(
        channel,
        prefilter_sos=_sections_at(channel.prefilter_sos, old_hz, new_hz),
        feedback_sos=None if feedback is None else _sections_at(feedback, old_hz, new_hz),
        anti_windup=replace(channel.anti_windup, gains=(gains[0] * ratio, gains[1] * ratio**2)),
    )


def _sections_at(sos: FloatArray, old_hz: float, new_hz: float) -> FloatArray:
    """Return the sections at the other rate, each by itself, so that the order (and the integrator's place) stays."""
    return np.stack([_section_at(section, old_hz, new_hz) for section in sos])


def _section_at(section: FloatArray, old_hz: float, new_hz: float) -> FloatArray:
    sampled = SampledSystem.from_sections(section[None, :], old_hz)
    finite = sampled.zeros[np.abs(sampled.zeros + 1.0) > 1e-9]
    zeros = 2.0 * old_hz * (finite - 1.0) / (finite + 1.0)
    poles = 2.0 * old_hz * (sampled.poles - 1.0) / (sampled.poles + 1.0)
    shape = ContinuousSystem(zeros, poles, 1.0)
    before, unit = sampled.response(_MATCH_HZ), discretise(shape, old_hz, "bilinear").response(_MATCH_HZ)
    gain = float(np.real(before / unit))
    moved = discretise(ContinuousSystem(zeros, poles, gain), new_hz, "bilinear")
    row: FloatArray = moved.sections()[0]
    if np.any(poles == 0.0):
        row[4:] = _with_integrator(float(row[5]))
    return row


def _with_integrator(other: float) -> tuple[float, float]:
    """Return a1 and a2 of (z - 1)(z - other): their sum with 1 is exactly 0, so that the integrator holds."""
    exact = float(np.ldexp(np.round(np.ldexp(other, 52)), -52))
    return -(1.0 + exact), exact


MOST_BITS = 44
"""Coefficients in double precision say nothing about more."""

_HZ = np.geomspace(0.1, 300.0, 120)

Needed = dict[str, dict[str, dict[float, "BitsNeeded"]]]
"""By filter, form and rate."""


@dataclass(frozen=True)
class BitsNeeded:
    """Fractional bits from which on every coarser rounding fails no more: to be stable, and to keep 0.1 dB.

    MOST_BITS + 1 where even MOST_BITS are not enough.
    """

    stable: int
    accurate: int


def filter_bits(system: SampledSystem, form: Form, frequency_hz: FloatArray = _HZ) -> BitsNeeded:
    """Return the bits that a prefilter needs: poles inside the unit circle, its response within 0.1 dB."""
    exact = system.response(frequency_hz)

    def error_db(rows: FloatArray) -> float:
        return float(np.max(np.abs(db(rows_response(rows, frequency_hz, system.rate_hz) / exact))))

    return _needed(system, form, is_stable, error_db)


def loop_bits(
    controller: SampledSystem, plant: SampledSystem, form: Form, frequency_hz: FloatArray = _HZ
) -> BitsNeeded:
    """Return the bits of a feedback controller: loop stable, T within 0.1 dB. plant: with the computing delay."""
    behind = plant.response(frequency_hz)
    loop = controller.response(frequency_hz) * behind
    exact = loop / (1.0 + loop)

    def closes(rows: FloatArray) -> bool:
        numerators = rows[:, : (rows.shape[1] + 1) // 2]
        return bool(np.all(np.any(numerators, axis=1))) and is_stable(rows, plant)

    def error_db(rows: FloatArray) -> float:
        rounded_loop = rows_response(rows, frequency_hz, plant.rate_hz) * behind
        return float(np.max(np.abs(db(rounded_loop / (1.0 + rounded_loop) / exact))))

    return _needed(controller, form, closes, error_db)


def controller_bits(controller: Controller, rates_hz: Sequence[float]) -> Needed:
    """Return the bits for the prefilter and the feedback of a designed controller at those rates: the most that any
    channel needs, over its own band; of prefilters with unity gain at its lower end, as the paper's has.
    """
    needed: Needed = {"prefilter": {form: {} for form in FORMS}}
    for rate_hz in rates_hz:
        moved = at_rate(controller, rate_hz)
        for channel, filters in zip(moved.display.channels, moved.channels, strict=True):
            band = np.geomspace(*channel.threshold.band_hz, 120)
            plant = discretise(channel.plant, rate_hz, "zoh", moved.delay_samples)
            feedback = filters.feedback(rate_hz)
            prefilter = filters.prefilter(rate_hz)
            unity = replace(prefilter, gain=prefilter.gain / float(abs(prefilter.response(band[0]))))
            for form in FORMS:
                _raise(needed, "prefilter", form, rate_hz, filter_bits(unity, form, band))
                if feedback is not None:
                    _raise(needed, "feedback", form, rate_hz, loop_bits(feedback, plant, form, band))
    return needed


def _raise(needed: Needed, name: str, form: Form, rate_hz: float, bits: BitsNeeded) -> None:
    by_rate = needed.setdefault(name, {}).setdefault(form, {})
    so_far = by_rate.get(rate_hz, bits)
    by_rate[rate_hz] = BitsNeeded(max(bits.stable, so_far.stable), max(bits.accurate, so_far.accurate))


def _needed(
    system: SampledSystem, form: Form, holds: Callable[[FloatArray], bool], error_db: Callable[[FloatArray], float]
) -> BitsNeeded:
    """Search from the finest rounding downwards until one fails: a coarser one that happens to fit does not count."""
    sections = system.sections()
    stable = accurate = MOST_BITS + 1
    still_accurate = True
    for bits in range(MOST_BITS, -1, -1):
        rows = quantised_rows(sections, form, bits, system.rate_hz)
        if not holds(rows):
            break
        stable = bits
        # dB, as ERROR_MAX_DB of float32_check
        still_accurate = still_accurate and error_db(rows) <= 0.1
        if still_accurate:
            accurate = bits
    return BitsNeeded(stable, accurate)
