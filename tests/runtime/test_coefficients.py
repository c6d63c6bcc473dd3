"""Delta coefficients against exact rationals."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactuator.errors import BadInput
from tactuator.runtime.coefficients import delta_coefficients, delta_coefficients_single
from tests.runtime.paper_display import feedback_sections

coefficient = st.floats(-4.0, 4.0, allow_nan=False)


def evaluate(row: list[float], z: Fraction) -> Fraction:
    b0, b1, b2, a1, a2 = (Fraction(value) for value in row)
    d = z - 1
    return (b0 * d * d + b1 * d + b2) / (d * d + a1 * d + a2)


@given(st.lists(coefficient, min_size=5, max_size=5))
def test_delta_coefficients__monic_section__is_the_same_rational_function(values: list[float]) -> None:
    b0, b1, b2, a1, a2 = values
    row = delta_coefficients([[b0, b1, b2, 1.0, a1, a2]])[0].tolist()
    z = Fraction(17, 5)
    below = z * z + Fraction(a1) * z + Fraction(a2)
    direct = (Fraction(b0) * z * z + Fraction(b1) * z + Fraction(b2)) / below
    # what is rounded in the denominator counts the more the nearer z is to a pole
    nearness = max(1.0, float((z * z + abs(a1) * z + abs(a2)) / abs(below)))
    assert float(evaluate(row, z)) == pytest.approx(float(direct), rel=1e-13 * nearness, abs=1e-13 * nearness)


def test_delta_coefficients__cancelling_sum__is_rounded_once() -> None:
    row = delta_coefficients([[1.0, -2.0 + 2.0**-52, 1.0, 1.0, -2.0 + 2.0**-50, 1.0 - 2.0**-53]])[0]
    assert row.tolist() == [1.0, 2.0**-52, 2.0**-52, 2.0**-50, float(Fraction(2) ** -50 - Fraction(2) ** -53)]


def test_delta_coefficients__leading_a0__divides_it_out() -> None:
    assert delta_coefficients([[2.0, 0.0, 0.0, 2.0, -2.0, 0.5]])[0].tolist() == [1.0, 2.0, 1.0, 1.0, 0.25]


def test_delta_coefficients_single__too_many_sections_or_beyond_single_precision__is_refused() -> None:
    with pytest.raises(BadInput, match="prefilter has 9 sections; allowed: at most 8"):
        delta_coefficients_single(np.tile(feedback_sections(), (9, 1)), 8, "prefilter")
    with pytest.raises(BadInput, match="allowed: what single precision holds"):
        delta_coefficients_single([[1e39, 0.0, 0.0, 1.0, 0.0, 0.0]], 8, "prefilter")
