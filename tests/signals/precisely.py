"""Responses with fifty digits."""

from collections.abc import Iterable, Sequence

import mpmath
import numpy as np
from numpy.typing import NDArray


def expanded(roots: Iterable[complex]) -> list[mpmath.mpf]:
    """prod(x - roots), descending powers, in the digits of the moment."""
    coefficients = [mpmath.mpf(1)]
    for root in roots:
        shifted = [mpmath.mpc(0), *(-mpmath.mpc(complex(root)) * each for each in coefficients)]
        coefficients = [a + b for a, b in zip([*coefficients, 0], shifted, strict=True)]
    return [mpmath.re(each) for each in coefficients]


def polynomial_response(
    coefficients: Sequence[float], frequency_hz: NDArray[np.float64], rate_hz: float
) -> NDArray[np.complex128]:
    """c0 + c1 z^-1 + ... at the frequencies (n,)."""
    with mpmath.workdps(50):
        values = []
        for hertz in frequency_hz:
            back = mpmath.expjpi(-2 * mpmath.mpf(float(hertz)) / mpmath.mpf(rate_hz))
            values.append(complex(sum(mpmath.mpf(float(c)) * back**k for k, c in enumerate(coefficients))))
    return np.array(values)


def level_db(sections: NDArray[np.float64], frequency_hz: float, rate_hz: float) -> float:
    """The level of a cascade of sections (rows of six), dB."""
    parts = [
        polynomial_response(half, np.array([frequency_hz]), rate_hz)[0]
        for row in sections
        for half in (row[:3], row[3:])
    ]
    return float(20.0 * np.log10(abs(np.prod(parts[::2]) / np.prod(parts[1::2]))))


def difference_response(
    row: Sequence[float], frequency_hz: NDArray[np.float64], rate_hz: float
) -> NDArray[np.complex128]:
    """(b0 d^2 + b1 d + b2)/(d^2 + a1 d + a2), d = z - 1, at the frequencies (n,)."""
    b0, b1, b2, a1, a2 = (mpmath.mpf(float(value)) for value in row)
    with mpmath.workdps(50):
        values = []
        for hertz in frequency_hz:
            d = mpmath.expjpi(2 * mpmath.mpf(float(hertz)) / mpmath.mpf(rate_hz)) - 1
            values.append(complex((b0 * d * d + b1 * d + b2) / (d * d + a1 * d + a2)))
    return np.array(values)
