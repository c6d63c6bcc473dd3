"""Observers against the psychometric function they claim to follow."""

import numpy as np
import pytest
from scipy.stats import norm

from tactuator.errors import BadInput
from tactuator.experiment.simulated.sitting import Observer, respond
from tactuator.perception.curve import curve
from tactuator.perception.psychometric import Logistic, MaxOfM, Psychometric, Weibull

EVEN = np.full(3, 1.0 / 3.0)


def share_correct(model: Psychometric, level_db: float, weights: np.ndarray = EVEN, runs: int = 6000) -> float:
    rng = np.random.default_rng(2)
    felt = np.full(3, -200.0)
    hits = 0
    for _ in range(runs):
        target = rng.integers(3)
        felt[:] = -200.0
        felt[target] = level_db
        hits += respond(model, felt, weights, rng) == target
    return hits / runs


@pytest.mark.parametrize("shape", [Weibull(2.5), Logistic(0.6), MaxOfM(3)])
@pytest.mark.parametrize("lapse", [0.0, 0.05])
@pytest.mark.parametrize("level_db", [-6.0, 0.0, 12.0])
def test_respond__many_trials__follows_psi(shape: Weibull, lapse: float, level_db: float) -> None:
    model = Psychometric(shape, lapse=lapse)
    assert share_correct(model, level_db) == pytest.approx(float(model.probability(level_db)), abs=0.02)


def test_interval_bias__nothing_felt__guesses_follow_the_weights() -> None:
    rng = np.random.default_rng(0)
    weights = np.array([0.6, 0.3, 0.1])
    picks = [respond(Psychometric(Weibull()), np.full(3, -200.0), weights, rng) for _ in range(5000)]
    assert np.bincount(picks, minlength=3) / 5000 == pytest.approx(weights, abs=0.02)


def test_interval_bias__max_of_m__prefers_the_weighted_interval() -> None:
    rng = np.random.default_rng(0)
    weights = np.array([0.5, 0.3, 0.2])
    picks = [respond(Psychometric(MaxOfM(3)), np.full(3, -200.0), weights, rng) for _ in range(3000)]
    counts = np.bincount(picks, minlength=3)
    assert counts[0] > counts[1] > counts[2]


def test_drift__late_trial__needs_a_higher_level() -> None:
    rng = np.random.default_rng(0)
    drifting = Observer("d", curve("bolanowski-1988"), Psychometric(Weibull(2.5)), drift_db_per_trial=0.2)
    felt = np.array([-99.0, 19.0, -99.0])  # 0 dB SL at 10 Hz
    early = np.mean([drifting.respond(felt, 10.0, 0, rng) == 1 for _ in range(1500)])
    late = np.mean([drifting.respond(felt, 10.0, 100, rng) == 1 for _ in range(1500)])
    assert early == pytest.approx(0.794, abs=0.04)
    assert late == pytest.approx(0.333, abs=0.05)


@pytest.mark.parametrize("bias", [(1.0,), (-1.0, 2.0), (0.0, 0.0, 0.0)])
def test_observer__nonsense_bias__is_refused(bias: tuple[float, ...]) -> None:
    with pytest.raises(BadInput, match="interval_bias"):
        Observer("x", curve("bolanowski-1988"), interval_bias=bias)


def test_observer__bias_for_other_number_of_intervals__is_refused() -> None:
    biased = Observer("x", curve("bolanowski-1988"), interval_bias=(0.5, 0.5))
    with pytest.raises(BadInput, match="2 weights for 3 intervals"):
        biased.respond([0.0, 0.0, 0.0], 10.0, 0, np.random.default_rng(0))


def test_max_of_m__two_intervals__is_the_textbook_d_prime_over_root_two() -> None:
    # Green & Swets: P(correct) in 2AFC = Phi(d'/sqrt 2).
    model = Psychometric(MaxOfM(2, exponent=1.0), guess=0.5, target=0.75)
    level = np.array([-10.0, 0.0, 6.0])
    d_prime = model.shape.d_prime(level, model.at_threshold)  # type: ignore[attr-defined]
    assert model.probability(level) == pytest.approx(norm.cdf(d_prime / np.sqrt(2.0)), abs=1e-4)


@pytest.mark.parametrize("shape", [Weibull(1.5), Logistic(0.4), MaxOfM(3)])
@pytest.mark.parametrize("lapse", [0.0, 0.03])
def test_psychometric__at_threshold__is_the_target_with_lapses_included(shape: Weibull, lapse: float) -> None:
    model = Psychometric(shape, lapse=lapse)
    assert float(model.probability(0.0)) == pytest.approx(model.target, abs=1e-4)
    assert float(model.probability(60.0)) == pytest.approx(1.0 - lapse, abs=1e-4)
    assert float(model.probability(-80.0)) == pytest.approx(1.0 / 3.0, abs=1e-3)


@pytest.mark.parametrize("settings", [{"lapse": 0.3}, {"lapse": -0.1}, {"guess": 0.9}, {"guess": -0.1}])
def test_psychometric__impossible_envelope__is_refused(settings: dict[str, float]) -> None:
    with pytest.raises(BadInput, match=rf"{next(iter(settings))} .*allowed: 0 "):
        Psychometric(Weibull(), **settings)


@pytest.mark.parametrize(
    "make", [lambda: Weibull(0.0), lambda: Logistic(-1.0), lambda: MaxOfM(1), lambda: MaxOfM(3, 0.0)]
)
def test_shape__nonsense__is_refused(make: object) -> None:
    with pytest.raises(BadInput):
        make()  # type: ignore[operator]
