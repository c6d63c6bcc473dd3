"""The matrix exponential against closed forms, scipy and forty digits."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from scipy import linalg

from tactuator.signals.discretise import matrix_exponential


@settings(max_examples=60)
@given(hnp.arrays(np.float64, st.integers(1, 9).map(lambda n: (n, n)), elements=st.floats(-0.7, 0.7)))
def test_exponential__any_small_matrix__agrees_with_scipy(matrix: NDArray[np.float64]) -> None:
    expected = linalg.expm(matrix)
    assert matrix_exponential(matrix) == pytest.approx(expected, abs=1e-12 * np.max(np.abs(expected)))


@pytest.mark.parametrize("angle", [1e-12, 0.1, 0.5, 3.0, 40.0])
def test_exponential__rotation__is_cosine_and_sine(angle: float) -> None:
    turned = matrix_exponential(np.array([[0.0, -angle], [angle, 0.0]]))
    cosine, sine = np.cos(angle), np.sin(angle)
    assert turned == pytest.approx(np.array([[cosine, -sine], [sine, cosine]]), abs=3e-14)


def test_exponential__slow_and_fast_together__keeps_the_slow_ones_digits() -> None:
    matrix = np.array([[0.0, 0.02, 0.0], [-0.02, -8.0, 1.0], [0.0, 0.0, 0.0]])
    with mpmath.workdps(40):
        exact = mpmath.expm(mpmath.matrix(matrix.tolist()))
        expected = np.array([[float(exact[i, j]) for j in range(3)] for i in range(3)])
    assert matrix_exponential(matrix) == pytest.approx(expected, rel=1e-13, abs=1e-16)


def test_exponential__zero__is_the_unit_matrix() -> None:
    assert np.array_equal(matrix_exponential(np.zeros((4, 4))), np.eye(4))
