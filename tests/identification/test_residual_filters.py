"""What SciPy has too, beside it: filters of residuals to the last bit, tails, filters of loops, fast lengths."""

import numpy as np
import pytest
from scipy import fft, linalg, signal, special

from tactuator.identification.friction import _REACH, _uphill
from tactuator.identification.lines import fast_length
from tactuator.identification.residual import _solutions
from tactuator.identification.residual_tests import _time_scales, apply_filter, chi_squared_tail


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


@pytest.mark.parametrize("degrees", [1, 2, 3, 14, 40])
def test_chi_squared_tail__any_value__is_scipys(degrees: int) -> None:
    values = np.geomspace(1e-6, 1200.0, 50)
    found = [chi_squared_tail(degrees, value) for value in values]
    np.testing.assert_allclose(found, special.chdtrc(degrees, values), rtol=1e-12)
    assert (chi_squared_tail(degrees, 0.0), chi_squared_tail(degrees, np.inf)) == (1.0, 0.0)


def test_solutions__every_length__are_scipys_of_toeplitz_equations() -> None:
    row, goal = 0.8 ** np.arange(43.0) * np.cos(np.arange(43)), np.random.default_rng(0).standard_normal(43)
    lengths = [
        np.testing.assert_allclose(taps, linalg.solve_toeplitz(row[: taps.size], goal[: taps.size]), atol=1e-12)
        for taps in _solutions(row, goal)
    ]
    assert len(lengths) == 43


def test_fast_length__any_count__is_scipys() -> None:
    for count in (*range(1, 400), 239_999, 999_983):
        assert fast_length(count) == fft.next_fast_len(count, real=True)
        assert fast_length(count, up=False) == fft.prev_fast_len(count, real=True)
        assert fast_length(count, primes=(2, 3, 5, 7, 11)) == fft.next_fast_len(count)


@pytest.mark.parametrize("step", [1, 8])
def test_uphill__one_summit_within_reach__is_found_in_few_trials(step: int) -> None:
    for summit in range(-_REACH, _REACH + 1):
        tried: set[int] = set()
        found = _uphill(lambda at, summit=summit, tried=tried: tried.add(at) or -abs(at - summit), step)
        assert found == summit
        assert len(tried) <= 12
