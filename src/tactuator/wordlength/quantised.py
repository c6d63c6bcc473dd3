"""Coefficients rounded to a word, in the forms that a filter can be written in, and what is left of the filter.

    direct     one polynomial over one polynomial in 1/z        sections   second-order sections, b and a in 1/z
    delta      second-order sections in d = z - 1, coefficients times the power of the rate that makes them those of the
               continuous filter, or nearly (in float32 as they are, as the core has them)

What the rounded numbers stand for is a table of rows b0, b1', ..., a1', ... in d (as core/arithmetic/section.h, or
longer), and is examined in double precision there, where nothing more is lost.
"""

from __future__ import annotations

from fractions import Fraction
from math import comb
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.runtime.coefficients import delta_coefficients
from tactuator.signals.loop import closed_roots
from tactuator.signals.sections import backward_difference, check_sections
from tactuator.signals.systems import SampledSystem

Form = Literal["direct", "sections", "delta"]
FORMS: tuple[Form, ...] = ("direct", "sections", "delta")


def rounded(values: ArrayLike, bits: int | None) -> FloatArray:
    """Return the values rounded to the nearest multiple of 2^-bits, or to float32 for None."""
    array = np.asarray(values, dtype=np.float64)
    if bits is None:
        return array.astype(np.float32).astype(np.float64)
    return np.asarray(np.ldexp(np.round(np.ldexp(array, bits)), -bits))


def quantised_rows(sos: ArrayLike, form: Form, bits: int | None, rate_hz: float) -> FloatArray:
    """Return the rows in d of what is left of the cascade `sos` once its numbers in `form` are rounded: shape (n, 5),
    or (1, 2 order + 1) for the direct form. Raises BadInput for a form that is not there.
    """
    sections = check_sections(sos)
    if form == "delta":
        scale = np.ones(5) if bits is None else rate_hz ** np.array([0.0, 1.0, 2.0, 1.0, 2.0])
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
    """Return a polynomial in z, descending powers, as one in d = z - 1: every coefficient summed without rounding
    error.
    """
    order = len(coefficients) - 1
    sums = [Fraction(0)] * (order + 1)
    for index, value in enumerate(coefficients):
        power = order - index
        for lower in range(power + 1):
            sums[order - lower] += Fraction(float(value)) * comb(power, lower)
    return np.array([float(one) for one in sums])


def _product(factors: FloatArray) -> FloatArray:
    """Return the product of polynomials, exact before it is rounded to double."""
    exact = [Fraction(1)]
    for factor in factors:
        terms = [Fraction(float(value)) for value in factor]
        longer = [Fraction(0)] * (len(exact) + len(terms) - 1)
        for i, one in enumerate(exact):
            for j, other in enumerate(terms):
                longer[i + j] += one * other
        exact = longer
    return np.array([float(value) for value in exact])


def rows_response(rows: FloatArray, frequency_hz: ArrayLike, rate_hz: float) -> ComplexArray:
    """Return the response of a cascade of rows."""
    frequency = np.asarray(frequency_hz, dtype=np.float64)
    difference = np.exp(2j * np.pi * frequency / rate_hz) * backward_difference(frequency, rate_hz)
    response = np.ones(frequency.shape, dtype=np.complex128)
    for num, den in map(_fraction, rows):
        response = response * np.polyval(num, difference) / np.polyval(den, difference)
    return response


def is_stable(rows: FloatArray, plant: SampledSystem | None = None) -> bool:
    """Return whether the poles lie inside the unit circle; with a plant (its delay included): those of the loop closed
    around both.
    """
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


def is_inside(poles_in_d: ComplexArray) -> bool:
    """Return whether |1 + d| < 1 for every pole: 2 Re d + |d|^2 < 0, which keeps its digits for slow poles."""
    return bool(np.all(2.0 * poles_in_d.real + np.abs(poles_in_d) ** 2 < 0.0))


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
