"""Residuals: what they tell of the hold, their filters beside SciPy's, and their tests where slopes are no numbers.

What SciPy has too, beside it: filters of residuals to the last bit, tails, filters of loops, fast lengths.
"""

import numpy as np
import pytest
from scipy import fft, linalg, signal, special

from tactuator.identification.friction import _REACH, _uphill
from tactuator.identification.identify import identify
from tactuator.identification.lines import Spectrum, fast_length, spectrum
from tactuator.identification.residual import Residual, _solutions, explained_by_loop
from tactuator.identification.residual_tests import _time_scales, apply_filter, check_residual, chi_squared_tail
from tactuator.signals.record import Record
from tests.identification.others import Plant, held

RATE_HZ, COUNT = 1000.0, 8000


def lines_of(command: np.ndarray, residual: np.ndarray) -> tuple[Spectrum, Residual]:
    taken = spectrum(command, residual, RATE_HZ)
    ones = np.ones(taken.position.size)
    return taken, Residual(taken.position, ones, ones[1:] + 0j, taken)


def noises(seed: int) -> tuple[np.ndarray, np.ndarray]:
    first, second = np.random.default_rng(seed).standard_normal((2, COUNT))
    return signal.lfilter([1.0], [1.0, -0.9], first), second


def test_explained_by_loop__command_apart_from_the_residual_or_ahead_of_it__is_nothing() -> None:
    for seed in range(5):
        own, noise = noises(seed)
        ahead = signal.lfilter([1.0, -0.9], [1.0], own) + np.roll(noise, -20)
        for command in (own, ahead):
            assert explained_by_loop(*lines_of(command, noise), 470.0, filtered=True) == 0.0


def test_explained_by_loop__command_that_follows__is_the_likelihood_of_its_regression() -> None:
    own, noise = noises(6)
    # white innovations, so that the regression's sum of squares is the likelihood
    white = signal.lfilter([1.0, -0.9], [1.0], own)
    command = white - 0.5 * noise - 0.25 * np.roll(noise, 1)
    found = explained_by_loop(*lines_of(command, noise), 500.0, filtered=False)
    expected = COUNT * np.log(np.var(command) / np.var(white)) - 2.0 * np.log(COUNT)
    assert found == pytest.approx(expected, rel=0.05)


def test_identify__held_loop_whose_noise_a_prompt_model_would_take__is_told_or_left_open() -> None:
    """The command answers the noise within its sample: read as band-limited the position alone is likelier."""
    plant = Plant(np.zeros(0), np.array([-315.0 + 774.0j, -315.0 - 774.0j, -650.0]), 0.6, 0.0)
    record = Record(600.0, *held(plant, np.random.default_rng(13), 600.0, 10.0, 22.0, closed=True))
    found = identify(record, order=3)
    assert found.between.hold == "zero-order"
    frequency = np.geomspace(1.0, 180.0, 100)
    off = np.log(found.model.response(frequency) / plant.response(frequency))
    assert np.mean(np.abs(off.imag) <= found.model.band_rad(frequency)) > 0.9


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


@pytest.mark.parametrize("amiss", [np.inf, np.nan, 1e200])
def test_residual__slopes_that_overflow__speak_for_no_model(amiss):
    """Found with a record of a plant that runs away: the eigenvalues of what was no number did not converge."""
    random = np.random.default_rng(1)
    slopes = random.standard_normal((4000, 2))
    slopes[17, 1] = amiss
    with np.errstate(all="ignore"):
        found = check_residual(random.standard_normal(4000), random.standard_normal(4000), slopes, 1000.0)
    assert found.uncorrelated_p == 0.0
