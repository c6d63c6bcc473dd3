"""Transfer functions as they are printed: polynomials in s, whole or as factors of the first and second order."""

from __future__ import annotations

from collections import Counter

import numpy as np

from tactuator.signals.systems import ContinuousSystem

FloatArray = np.ndarray[tuple[int], np.dtype[np.float64]]


def printed_polynomial(coefficients: FloatArray) -> str:
    """Return a polynomial in s as it is printed: four digits, no factor of one, no zero term."""
    order = len(coefficients) - 1
    terms = []
    for index, value in enumerate(coefficients):
        power = order - index
        if value == 0.0:
            continue
        symbol = "" if power == 0 else "s" if power == 1 else f"s{_superscript(power)}"
        number = "" if symbol and abs(value) == 1.0 else f"{abs(value):.4g}"
        terms.append((" − " if value < 0.0 else " + ") + number + symbol)
    text = "".join(terms)
    return text.removeprefix(" + ").replace(" − ", "−", 1) if text.startswith(" − ") else text.removeprefix(" + ")


def printed_polynomials(system: ContinuousSystem) -> tuple[str, str]:
    """Return the numerator and denominator of a continuous system as printed."""
    num, den = system.polynomials()
    return printed_polynomial(num), printed_polynomial(den)


def printed_factors(system: ContinuousSystem) -> str:
    """Return the system as a gain and a fraction of factors, each with one real root (rad/s) or one pair of roots.

    Factors keep the digits that a polynomial of high order loses. Roots at the origin come first, then by magnitude.
    """
    above, below = _factors(system.zeros), _factors(system.poles)
    gain = f"{system.gain:.6g}"
    top = f"{gain} {above}" if above else gain
    return f"{top} / ({below})" if below else top


def _factors(roots: np.ndarray[tuple[int], np.dtype[np.complex128]]) -> str:
    """Return the product of the factors of these roots; pairs are told by their root above the real axis."""
    real = roots.imag == 0.0
    upper = roots[roots.imag > 0.0]
    factors = [(abs(root), np.array([1.0, -root.real])) for root in roots[real]]
    factors += [(abs(root), np.array([1.0, -2.0 * root.real, abs(root) ** 2])) for root in upper]
    counted = Counter(_bracketed(values) for _, values in sorted(factors, key=lambda one: one[0]))
    return " ".join(text if times == 1 else text + _superscript(times) for text, times in counted.items())


def _bracketed(values: FloatArray) -> str:
    text = printed_polynomial(values)
    return text if text == "s" else f"({text})"


def _superscript(number: int) -> str:
    return str(number).translate(str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹"))
