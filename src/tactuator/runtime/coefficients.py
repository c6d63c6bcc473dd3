"""Sections as the core computes with them: delta form, each coefficient rounded once, in float32 and in Q31.

H = (b0 + b1 z^-1 + b2 z^-2)/(1 + a1 z^-1 + a2 z^-2) = (b0 d^2 + b1' d + b2')/(d^2 + a1' d + a2') with d = z - 1 and
b1' = 2 b0 + b1, b2' = b0 + b1 + b2, a1' = 2 + a1, a2' = 1 + a1 + a2 (Middleton & Goodwin 1990, chapter 2).

In Q31 a coefficient is mantissa / 2^(21 + shift), int32 mantissas with a shift for each row
(core/arithmetic/section_q31.h). References have a full scale of 1000 threshold units (60 dB SL), volts one of 512 V:
the command is known before its limits, as conditioning needs it (decision 0003). Between sections each signal gets a
power of two for a full scale, so that it does not saturate: the sum of the magnitudes of the impulse response up to
there, times the greatest input, bounds it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.signals.systems import check_sections

PREFILTER_SECTIONS_MAX = 8
FEEDBACK_SECTIONS_MAX = 4
REFERENCE_FULL_SCALE = 1000.0
VOLTS_FULL_SCALE = 512.0
SHIFT_MIN, SHIFT_MAX = 2, 62
_EXTRA_BITS = 21
_BOUND_SECONDS = 4.0
_COEFFICIENT_MAX = 256.0
_Q31_CONDITIONING_MAX = 64.0
_Q31_CONDITIONING_SHIFT_MAX = 62 - _EXTRA_BITS


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


@dataclass(frozen=True)
class Q31Section:
    """One section: mantissas of b0, b1, b2, a1, a2, and the shifts of the rows (b0), (b1, a1), (b2, a2)."""

    mantissas: tuple[int, int, int, int, int]
    shifts: tuple[int, int, int]

    @property
    def coefficients(self) -> tuple[float, ...]:
        """Return the mantissas' values: b0, b1', b2', a1', a2' between the section's own full scales."""
        row_of = (0, 1, 2, 1, 2)
        return tuple(
            math.ldexp(mantissa, -_EXTRA_BITS - self.shifts[row])
            for mantissa, row in zip(self.mantissas, row_of, strict=True)
        )


def q31_row(values: tuple[float, ...], bits: int = 31) -> tuple[tuple[int, ...], int]:
    """Return the mantissas within 2^bits and the shift that they share. Raises BadInput for a value of 256 or more."""
    largest = max(abs(value) for value in values)
    if not largest < 2.0 ** (bits - _EXTRA_BITS - SHIFT_MIN):
        raise BadInput(f"a coefficient of {largest:g} is too large for Q31", "below 256 (float32 holds it)")
    shift = SHIFT_MAX
    if largest > 0.0:
        shift = min(SHIFT_MAX, bits - _EXTRA_BITS - math.frexp(largest)[1])
    limit = 2**bits - 1
    mantissas = (round(math.ldexp(value, _EXTRA_BITS + shift)) for value in values)
    return tuple(max(-limit, min(limit, mantissa)) for mantissa in mantissas), shift


def q31_conditioning(threshold_units_per_volt: float) -> tuple[tuple[int, ...], int]:
    """Return, as `q31_row`, the reference's shares of full scale for one of the command's; 0 if Q31 cannot hold it."""
    share = threshold_units_per_volt * VOLTS_FULL_SCALE / REFERENCE_FULL_SCALE
    if not abs(share) < _Q31_CONDITIONING_MAX:
        share = 0.0
    shift = min(_Q31_CONDITIONING_SHIFT_MAX, q31_row((share,), bits=30)[1])
    return (round(math.ldexp(share, _EXTRA_BITS + shift)),), shift


def q31_section(delta: ArrayLike) -> Q31Section:
    """Return one section from b0, b1', b2', a1', a2' (shape (5,)), each rounded once."""
    b0, b1, b2, a1, a2 = (float(value) for value in np.asarray(delta, dtype=np.float64))
    (m0,), shift0 = q31_row((b0,))
    (m1, n1), shift1 = q31_row((b1, a1))
    (m2, n2), shift2 = q31_row((b2, a2))
    return Q31Section((m0, m1, m2, n1, n2), (shift0, shift1, shift2))


def q31_cascade(sos: ArrayLike, rate_hz: float, full_scale_in: float) -> tuple[Q31Section, ...]:
    """Return a cascade (n, 6) with full_scale_in at its input and 512 V at its output.

    Raises BadInput for a coefficient that Q31 cannot hold, or an unstable section before the last.
    """
    sections = check_sections(sos)
    rows = delta_coefficients(sections)
    scales = full_scales(sections, rate_hz, full_scale_in, np.max(np.abs(rows[:, :3]), axis=1))
    rows[:, :3] *= (scales[:-1] / scales[1:])[:, None]
    return tuple(q31_section(row) for row in rows)


def full_scales(
    sections: FloatArray,
    rate_hz: float,
    full_scale_in: float,
    largest: FloatArray | None = None,
    full_scale_out: float = VOLTS_FULL_SCALE,
) -> FloatArray:
    """Return the full scales of the input, of what is between the sections (powers of two), and of the output: shape (n
    + 1,).

    A section's coefficients, `largest` times its input's full scale over its output's, must fit: where a slow last one
    asks for more, its output saturates for inputs that stay at full scale for long. Raises BadInput for an unstable
    section before the last.
    """
    following = np.zeros(len(sections)) if largest is None else largest
    impulse = np.zeros(max(16, round(_BOUND_SECONDS * rate_hz)))
    impulse[0] = full_scale_in
    between = []
    for section, next_one in zip(sections[:-1], following[1:], strict=True):
        if np.max(np.abs(np.roots(section[3:]))) >= 1.0:
            raise BadInput("a section before the last has a pole on or outside the unit circle", "none in Q31")
        impulse = scipy.signal.sosfilt(section[None, :], impulse)
        bound = max(float(np.sum(np.abs(impulse))), 2.0**-20)
        most = 0.5 * _COEFFICIENT_MAX * full_scale_out / max(float(next_one), 2.0**-20)
        between.append(2.0 ** min(math.ceil(math.log2(bound)), math.floor(math.log2(most))))
    return np.array([full_scale_in, *between, full_scale_out])
