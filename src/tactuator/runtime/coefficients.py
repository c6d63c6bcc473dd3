"""Sections as the core computes with them: delta form, each coefficient rounded once to float32.

H = (b0 + b1 z^-1 + b2 z^-2)/(1 + a1 z^-1 + a2 z^-2) = (b0 d^2 + b1' d + b2')/(d^2 + a1' d + a2') with d = z - 1 and
b1' = 2 b0 + b1, b2' = b0 + b1 + b2, a1' = 2 + a1, a2' = 1 + a1 + a2 (Middleton & Goodwin 1990, chapter 2).
"""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.signals.systems import check_sections

PREFILTER_SECTIONS_MAX = 8
FEEDBACK_SECTIONS_MAX = 4


def delta_coefficients(sos: ArrayLike) -> FloatArray:
    """Return b0, b1', b2', a1', a2' of each section in double, sums exact before they are rounded: shape (n, 5)."""
    return np.array(_delta_rows(check_sections(sos).tobytes()), dtype=np.float64).reshape(-1, 5)


@lru_cache(maxsize=64)
def _delta_rows(sections: bytes) -> list[list[float]]:
    """Return the rows of sections (n, 6): a controller that is loaded again needs no sums of fractions."""
    rows = []
    for section in np.frombuffer(sections).reshape(-1, 6).tolist():
        b0, b1, b2, a0, a1, a2 = (Fraction(value) for value in section)
        exact = (b0 / a0, (2 * b0 + b1) / a0, (b0 + b1 + b2) / a0, (2 * a0 + a1) / a0, (a0 + a1 + a2) / a0)
        rows.append([float(value) for value in exact])
    return rows


def delta_coefficients_single(sos: ArrayLike, most: int, name: str) -> NDArray[np.float32]:
    """Return `delta_coefficients` rounded to float32, shape (n, 5).

    Raises BadInput for more than `most` sections, or for a coefficient that float32 cannot hold; `name` says of what.
    """
    exact = delta_coefficients(sos)
    if exact.shape[0] > most:
        raise BadInput(f"{name} has {exact.shape[0]} sections", f"at most {most}")
    if np.any(np.abs(exact) > float(np.finfo(np.float32).max)):
        raise BadInput(f"{name} has a coefficient of {np.max(np.abs(exact)):g}", "what single precision holds")
    return exact.astype(np.float32)
