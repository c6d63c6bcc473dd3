"""Filters of the residual's tests beside those of scipy.signal, to the last bit."""

import numpy as np
import pytest
from scipy import signal

from tactuator.identification.residual_tests import _time_scales, apply_filter


@pytest.mark.parametrize("taps", [1, 2, 3, 9, 41])
@pytest.mark.parametrize("count", [41, 60, 100, 217, 2000, 50_001])
def test_apply_filter__any_length__is_scipys_overlapping_convolution(count: int, taps: int) -> None:
    random = np.random.default_rng(count + taps)
    coefficients, values = random.standard_normal(taps), random.standard_normal(count)
    wanted = signal.oaconvolve(values, coefficients)[:count]
    assert np.array_equal(apply_filter(coefficients, values), wanted)


@pytest.mark.parametrize("rate_hz", [1000.0, 4000.0])
def test_time_scales__noise__are_scipys_filters_of_first_order(rate_hz: float) -> None:
    command = np.random.default_rng(5).standard_normal(3000)
    late = np.concatenate([[0.0], command[:-1] - command.mean()])
    corners = np.geomspace(2.0 * rate_hz / command.size, 0.2 * rate_hz, 14)
    for passed, decay in zip(_time_scales(command, rate_hz), np.exp(-2.0 * np.pi * corners / rate_hz), strict=True):
        assert np.array_equal(passed, signal.lfilter([1.0 - decay], [1.0, -decay], late))
