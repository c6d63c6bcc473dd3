"""Monte Carlo of drawn plants against the same plants, and the verdict on them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.verdict import Finding, Outcome
from tactuator.signals.loop import FeedbackLoop
from tactuator.signals.loop_figures import margins
from tactuator.signals.systems import ContinuousSystem
from tactuator.synthesis.family import plant_family
from tactuator.synthesis.monte_carlo import QUANTILES, DrawnPlants, monte_carlo
from tactuator.synthesis.objectives import drawn_assumptions, judge_drawn
from tests.synthesis.displays import channel, paper_alone, paper_controller


def drawn(
    peaks: FloatArray,
    *,
    source: str = "covariance",
    load: str = "none",
    stable: int | None = None,
    mode_shift: float = 0.0,
) -> DrawnPlants:
    """Plants of these max|S|, of an error of |H| of 0.2 dB, without hum; all stable but the last few."""
    is_stable = np.arange(peaks.size) < (peaks.size if stable is None else stable)
    flat = np.where(is_stable, 0.2, np.nan)
    return DrawnPlants(
        "index", load, source, mode_shift, is_stable, np.where(is_stable, peaks, np.nan), flat, flat * np.nan
    )


def found(plants: DrawnPlants, quantity: str) -> Finding:
    display = paper_alone()
    return next(one for one in judge_drawn([plants], display) if one.quantity.startswith(quantity))


@pytest.mark.parametrize("count", [10, 58, 59, 200, 1000])
@pytest.mark.parametrize("share", [0.0, 0.02, 0.05, 0.08, 0.2])
def test_judge_drawn__share_that_passes__as_exact_binomial_tests_tell(count: int, share: float) -> None:
    passing = round(share * count)
    limit = paper_alone().channels[0].feedback.sensitivity_peak
    peak = found(drawn(np.where(np.arange(count) < passing, limit + 0.1, limit - 0.1)), "max|S|")
    fewer = stats.binomtest(passing, count, 0.05, alternative="less").pvalue <= 0.05
    more = stats.binomtest(passing, count, 0.05, alternative="greater").pvalue <= 0.05
    assert peak.outcome is (Outcome.MET if fewer else Outcome.NOT_MET if more else Outcome.NOT_JUDGED)
    assert ("more plants" in peak.remark) == (peak.outcome is Outcome.NOT_JUDGED)


def test_judge_drawn__one_unstable_loop_of_a_thousand__not_met() -> None:
    plants = drawn(np.full(1000, 1.2), stable=999)
    assert found(plants, "unstable loops").outcome is Outcome.NOT_MET
    assert found(plants, "unstable loops").value == pytest.approx(0.1)
    assert found(plants, "level error").outcome is Outcome.MET
    assert found(drawn(np.full(1000, 1.2), stable=700), "level error").outcome is Outcome.NOT_MET


def test_judge_drawn__plant_of_which_nothing_is_known__not_judged() -> None:
    for one in judge_drawn([drawn(np.full(1000, 1.2), source="nominal")], paper_alone()):
        assert one.outcome is Outcome.NOT_JUDGED
        assert "the spread of the plant is unknown" in one.remark


@pytest.mark.parametrize(
    ("known", "value", "words"),
    [
        ({"valid_hz": (0.3, 200.0)}, 0.2, "valid_hz"),
        ({"model_error_db": 0.9}, 1.1, "0.90 dB that the plant itself is unsure of"),
    ],
)
def test_judge_drawn__plant_not_known_everywhere_or_not_surely__flatness_not_judged(known, value, words) -> None:
    display = paper_alone()
    display = replace(display, channels=(replace(display.channels[0], **known),))
    flat = next(one for one in judge_drawn([drawn(np.full(1000, 1.2))], display) if one.objective == "i")
    assert flat.outcome is Outcome.NOT_JUDGED
    assert flat.value == pytest.approx(value)
    assert words in flat.remark


def test_drawn_assumptions__shifted_modes__told_once() -> None:
    plants = [drawn(np.ones(9), mode_shift=0.02, load=load) for load in ("none", "finger")]
    assert drawn_assumptions(plants) == ("modes of index: 2 % of standard deviation in frequency (`mode_shift`)",)
    assert drawn_assumptions([drawn(np.ones(9))]) == ()


def test_judge_drawn__a_family_within_and_beyond_the_limit__met_and_not_met() -> None:
    """Three quarters of the plants are stiffer or softer than nominal: the peak that `margins` tells decides."""
    one = channel(family=MODELS, loads=())
    made = replace(paper_controller(), display=replace(paper_alone(), channels=(one,)))
    plants = monte_carlo(made, 500, np.random.default_rng(1))
    for limit, outcome in ((1.9, Outcome.MET), (1.3, Outcome.NOT_MET)):
        asked = replace(one.feedback, sensitivity_peak=limit)
        display = replace(made.display, channels=(replace(one, feedback=asked),))
        (peak,) = (finding for finding in judge_drawn(plants, display) if finding.quantity.startswith("max|S|"))
        assert peak.outcome is outcome


MODELS = tuple(
    ContinuousSystem.from_polynomials([2875.0 * gain], [1.0, 94.0 * damping, 290.0])
    for gain, damping in ((0.8, 1.2), (1.1, 0.9), (1.3, 0.8))
)


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
    with pytest.raises(BadInput, match="; "):
        monte_carlo(paper_controller(), count, np.random.default_rng(0), shift)
