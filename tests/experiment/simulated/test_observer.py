"""Observers against the psychometric function they claim to follow."""

import numpy as np
import pytest
from scipy.stats import norm

from tactuator.errors import BadInput
from tactuator.experiment.simulated.sitting import Observer
from tactuator.perception.curve import curve
from tactuator.perception.psychometric import MaxOfM, Psychometric, Weibull

CURVE = curve("bolanowski-1988")


@pytest.mark.parametrize(("level_db", "lapse"), [(-6.0, 0.05), (0.0, 0.0), (12.0, 0.05)])
def test_observer__many_trials__follows_psi_about_its_own_curve(level_db: float, lapse: float) -> None:
    """Of 2000 trials a share that is 0.045 off is seen (four standard errors)."""
    model, rng = Psychometric(Weibull(2.5), lapse=lapse), np.random.default_rng(2)
    observer, threshold, hits = Observer("x", CURVE, model), float(CURVE.level_db_re_1um_at(10.0)), 0
    for _ in range(2000):
        felt, target = np.full(3, -200.0), rng.integers(3)
        felt[target] = threshold + level_db
        hits += observer.respond(felt, 10.0, rng) == target
    assert hits / 2000 == pytest.approx(float(model.probability(level_db)), abs=0.045)
    picks = [observer.respond(np.full(3, -200.0), 10.0, rng) for _ in range(1500)]  # nothing is felt
    assert np.bincount(picks, minlength=3) / 1500 == pytest.approx(np.full(3, 1.0 / 3.0), abs=0.05)


def test_max_of_m__two_intervals__is_the_textbook_d_prime_over_root_two() -> None:
    # Green & Swets: P(correct) in 2AFC = Phi(d'/sqrt 2).
    model = Psychometric(MaxOfM(2, exponent=1.0), guess=0.5, target=0.75)
    level = np.array([-10.0, 0.0, 6.0])
    d_prime = model.shape.d_prime(level, model.at_threshold)  # type: ignore[attr-defined]
    assert model.probability(level) == pytest.approx(norm.cdf(d_prime / np.sqrt(2.0)), abs=1e-4)


@pytest.mark.parametrize("shape", [Weibull(1.5), MaxOfM(3)])
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
    for shape, amiss in ((Weibull, (0.0,)), (MaxOfM, (1,)), (MaxOfM, (3, 0.0))):
        with pytest.raises(BadInput):
            shape(*amiss)
