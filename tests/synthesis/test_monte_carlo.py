"""Monte Carlo over plants against the sampled loops of the same plants, one by one; its points against SciPy's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import qmc

from tactuator.errors import BadInput
from tactuator.signals.loop import FeedbackLoop, margins
from tactuator.signals.systems import ContinuousSystem
from tactuator.synthesis.even_points import even_points
from tactuator.synthesis.family import plant_family
from tactuator.synthesis.monte_carlo import QUANTILES, monte_carlo
from tests.synthesis.displays import channel, paper_alone, paper_controller

MODELS = tuple(
    ContinuousSystem.from_polynomials([2875.0 * gain], [1.0, 94.0 * damping, 290.0])
    for gain, damping in ((0.8, 1.2), (1.1, 0.9), (1.3, 0.8))
)


@pytest.mark.parametrize(("dimensions", "first", "count"), [(1, 0, 8), (11, 1, 4096), (11, 4097, 16384), (13, 1, 128)])
def test_even_points__any_stretch__are_scipys_to_the_last_bit(dimensions: int, first: int, count: int) -> None:
    sequence = qmc.Sobol(dimensions, scramble=False)
    if first:
        sequence.fast_forward(first)
    assert np.array_equal(even_points(dimensions, first, count), sequence.random(count))


def test_monte_carlo__family_and_load__greatest_peak_is_that_of_the_sampled_loops() -> None:
    one = channel(family=MODELS)
    made = replace(paper_controller(), display=replace(paper_alone(), channels=(one,)))
    found = {trial.load: trial for trial in monte_carlo(made, 200, np.random.default_rng(1))}
    feedback = made.channels[0].feedback(4000.0)
    for load in ("none", "finger"):
        members = [member for member in plant_family(one, 4000.0, 1) if member.load == load]
        peaks = [margins(FeedbackLoop(feedback, member.sampled)).sensitivity_peak for member in members]
        assert np.nanmax(found[load].sensitivity_peak) == pytest.approx(max(peaks), rel=0.01)
        assert found[load].unstable == 0.0
        assert found[load].source == "family"


def test_monte_carlo__covariance__spread_of_the_gain_is_that_of_the_flatness() -> None:
    """Without a loop an error of the gain by its standard deviation of 5 % is one of 0.42 dB in |H|."""
    sigma = 0.05 * 2875.0
    covariance = np.zeros((4, 4))
    covariance[0, 0] = sigma**2
    display = paper_alone()
    one = replace(display.channels[0], covariance=tuple(map(tuple, covariance.tolist())))
    made = paper_controller()
    open_loop = replace(made.channels[0], feedback_sos=None)
    drawn = monte_carlo(
        replace(made, display=replace(display, channels=(one,)), channels=(open_loop,)), 4000, np.random.default_rng(2)
    )
    nominal = monte_carlo(replace(made, channels=(open_loop,)), 1, np.random.default_rng(2))
    assert drawn[0].mode_shift == 0.0  # its covariance says how well the modes are known
    spread = float(np.quantile(drawn[0].flatness_db, 0.95) - nominal[0].flatness_db[0])
    assert spread == pytest.approx(20.0 * np.log10(1.0 + 1.645 * 0.05), abs=0.15)
    assert np.all(np.isnan(drawn[0].sensitivity_peak))


def test_monte_carlo__plants_that_the_loop_cannot_hold__counted() -> None:
    wild = ContinuousSystem.from_polynomials([90_000.0], [1.0, 94.0, 290.0])
    one = channel(loads=(), family=(wild,))
    made = replace(paper_controller(), display=replace(paper_alone(), channels=(one,)))
    (found,) = monte_carlo(made, 1000, np.random.default_rng(3))
    assert found.unstable == pytest.approx(0.5, abs=0.06)
    assert found.quantiles(found.sensitivity_peak).size == len(QUANTILES)


@pytest.mark.parametrize(("count", "shift"), [(0, 0.02), (10_000_000, 0.02), (10, -0.1), (10, 0.5)])
def test_monte_carlo__counts_and_shifts_that_cannot_be__refused(count: int, shift: float) -> None:
    with pytest.raises(BadInput, match="allowed"):
        monte_carlo(paper_controller(), count, np.random.default_rng(0), shift)
