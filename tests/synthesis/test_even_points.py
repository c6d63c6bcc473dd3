"""Sobol's points beside those of scipy.stats, to the last bit."""

import numpy as np
import pytest
from scipy.stats import qmc

from tactuator.synthesis.even_points import even_points


@pytest.mark.parametrize(("dimensions", "first", "count"), [(1, 0, 8), (11, 1, 4096), (11, 4097, 16384), (13, 1, 128)])
def test_even_points__any_stretch__are_scipys(dimensions: int, first: int, count: int) -> None:
    sequence = qmc.Sobol(dimensions, scramble=False)
    if first:
        sequence.fast_forward(first)
    assert np.array_equal(even_points(dimensions, first, count), sequence.random(count))
