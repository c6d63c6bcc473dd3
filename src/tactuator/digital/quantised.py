"""Coefficients rounded to a word, in the forms that a filter can be written in, and what is left of the filter.

    direct   one polynomial over one polynomial in 1/z          biquad   second-order sections, b and a in 1/z
    delta    second-order sections in d = z - 1 (core/section.h)

A form's numbers are rounded to so many fractional bits (fixed point) or to float32; the filter that they stand for is
then examined in double precision, in d, where nothing more is lost.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.digital.coefficients import delta_coefficients
from tactuator.errors import BadInput
from tactuator.signals.sections import backward_difference, check_sections

Form = Literal["direct", "biquad", "delta"]
FORMS: tuple[Form, ...] = ("direct", "biquad", "delta")
BITS_MOST = 52

Rows = NDArray[np.float64]


def rounded(values: ArrayLike, bits: int | None) -> Rows:
    """Values to the nearest multiple of 2^-bits; None: to float32."""
    array = np.asarray(values, dtype=np.float64)
    if bits is None:
        return array.astype(np.float32).astype(np.float64)
    return np.asarray(np.ldexp(np.round(np.ldexp(array, bits)), -bits))


def quantised_delta(sos: ArrayLike, form: Form, bits: int | None) -> Rows:
    """Rows b0, b1', b2', ..., a1', a2', ... in d of what is left of the cascade `sos` once its numbers in `form` are
    rounded: shape (n, 5), or (1, 2 order + 1) for the direct form. Sums are exact to double precision."""
    sections = check_sections(sos)
    if form == "delta":
        return _scaled(delta_coefficients(sections), bits)
    if form == "biquad":
        plain = rounded(sections / sections[:, 3:4], bits)
        plain[:, 3] = 1.0
        return delta_coefficients(plain)
    if form == "direct":
        return _direct(sections, bits)
    raise BadInput(f"form {form!r}; allowed: {', '.join(FORMS)}")


def _scaled(rows: Rows, bits: int | None) -> Rows:
    """Each number of a delta form has a power of two of its own, as the core's have (and as an operator d / 2^-k gives
    them): `bits` count from the number's own size."""
    if bits is None:
        return rounded(rows, None)
    exponent = np.frexp(rows)[1]
    return np.asarray(np.ldexp(rounded(np.ldexp(rows, -exponent), bits), exponent))


def _direct(sections: Rows, bits: int | None) -> Rows:
    num, den = np.ones(1), np.ones(1)
    for section in sections:
        num, den = np.polymul(num, section[:3] / section[3]), np.polymul(den, section[3:] / section[3])
    while num.size > 1 and num[-1] == 0.0 and den[-1] == 0.0:
        num, den = num[:-1], den[:-1]
    num, den = rounded(num, bits), np.append(1.0, rounded(den[1:], bits))
    return np.concatenate([_shifted(num), _shifted(den)[1:]])[None, :]


def _shifted(polynomial: Rows) -> Rows:
    """The polynomial in z of these coefficients, in d = z - 1."""
    coefficients = list(polynomial)
    for step in range(len(coefficients) - 1):
        for index in range(1, len(coefficients) - step):
            coefficients[index] += coefficients[index - 1]
    return np.array(coefficients)


def delta_response(rows: Rows, frequency_hz: ArrayLike, rate_hz: float) -> NDArray[np.complex128]:
    """Response of rows as `quantised_delta` gives them."""
    frequency = np.asarray(frequency_hz, dtype=np.float64)
    difference = np.exp(2j * np.pi * frequency / rate_hz) * backward_difference(frequency, rate_hz)
    response = np.ones(frequency.shape, dtype=np.complex128)
    order = (rows.shape[1] - 1) // 2
    for row in rows:
        response = response * np.polyval(row[: order + 1], difference)
        response = response / np.polyval(np.append(1.0, row[order + 1 :]), difference)
    return response


def delta_poles(rows: Rows) -> NDArray[np.complex128]:
    """Poles in d."""
    order = (rows.shape[1] - 1) // 2
    return np.concatenate([np.roots(np.append(1.0, row[order + 1 :])) for row in rows])


def delta_zeros(rows: Rows) -> tuple[NDArray[np.complex128], float]:
    """Zeros in d, and the gain before them."""
    order = (rows.shape[1] - 1) // 2
    zeros, gain = [np.empty(0, dtype=np.complex128)], 1.0
    for row in rows:
        numerator = np.trim_zeros(row[: order + 1], "f")
        if numerator.size == 0:
            return np.empty(0, dtype=np.complex128), 0.0
        gain *= float(numerator[0])
        zeros.append(np.asarray(np.roots(numerator), dtype=np.complex128))
    return np.concatenate(zeros), gain


def is_inside(poles_in_d: NDArray[np.complex128], slack: float = 0.0) -> bool:
    """Whether |1 + d| < 1 for every pole: 2 Re d + |d|^2 < 0, which keeps its digits for slow poles."""
    return bool(np.all(2.0 * poles_in_d.real + np.abs(poles_in_d) ** 2 < slack))
