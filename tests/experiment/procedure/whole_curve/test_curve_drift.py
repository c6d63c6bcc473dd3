"""Drift of a whole curve: the evidence against an integral over all curves, and who is flagged."""

import numpy as np
import pytest

from tactuator.experiment.procedure.curve_belief import CurveBelief
from tactuator.experiment.procedure.curve_prior import CurvePrior
from tactuator.experiment.procedure.procedure import Answering
from tactuator.experiment.procedure.whole_curve import LEAST_LOG_ODDS, Trials, WholeCurveRule, curve_drift
from tactuator.experiment.simulated.quality import Setting, simulate_curve
from tactuator.perception.psychometric import Logistic, Psychometric

BROAD = {f"{kind}_share": 0.0 for kind in ("normal", "uneven", "steps", "notch", "edge")}
THREE = CurvePrior(points=3, mains_hz=0.0, clearance_hz=0.0, broad_share=1.0, **BROAD)
ONE = Answering(slopes=(2.0,), lapses=(0.02,), lapse_shares=(1.0,))


def learnt(prior: CurvePrior, answering: Answering, trials: Trials) -> CurveBelief:
    belief = CurveBelief(prior, answering, len(trials.point))
    for point, level, correct in zip(trials.point.T, trials.level_db_sl.T, trials.correct.T, strict=True):
        belief.learn(point, level, correct)
    return belief


def by_grid(trials: Trials, drift_db: float) -> float:
    """Log evidence of one run by summing over 101 x 101 x 101 triples of thresholds."""
    kind, g = THREE.kinds[0], np.arange(-40.0, 61.0)
    covariance = kind.covariance(THREE.frequency_hz, THREE.frequency_hz, THREE.middle_hz)
    about = np.stack(np.meshgrid(g, g, g, indexing="ij"), axis=-1) - kind.mean_db
    found = -0.5 * np.einsum("abci,ij,abcj->abc", about, np.linalg.inv(covariance), about)
    count = trials.point.shape[1]
    for trial in range(count):
        point, level = trials.point[0, trial], trials.level_db_sl[0, trial]
        threshold = g + drift_db * (trial / (count - 1) - 0.5)
        psi = ONE.psi(level - threshold, np.array(2.0), np.array(0.02))
        shape = [1, 1, 1]
        shape[point] = g.size
        found = found + np.log(psi if trials.correct[0, trial] else 1.0 - psi).reshape(shape)
    return float(found.max() + np.log(np.exp(found - found.max()).sum()))


def answered(points: int, runs: int, count: int, drift_db: float, seed: int) -> Trials:
    """Trials about smooth curves of people who are logistic in dB; the belief expects a Weibull."""
    rng = np.random.default_rng(seed)
    along = np.linspace(-1.0, 1.0, points)
    curve = rng.normal(0.0, 4.0, (runs, 1)) + rng.normal(0.0, 3.0, (runs, 1)) * along
    point = rng.integers(points, size=(runs, count))
    threshold = np.take_along_axis(curve, point, axis=1) + drift_db * (np.arange(count) / (count - 1) - 0.5)
    level = np.round(2.0 * (np.take_along_axis(curve, point, axis=1) + rng.uniform(-3.0, 7.0, (runs, count)))) / 2.0
    chance = Psychometric(Logistic(0.5), lapse=0.02).probability(level - threshold)
    return Trials(point, level, rng.random(chance.shape) < chance)


@pytest.mark.parametrize(("drift_db", "seed"), [(0.0, 1), (-6.0, 3)])
def test_curve_drift__three_points_one_kind__are_the_odds_of_the_integral_over_all_curves(drift_db, seed) -> None:
    trials = answered(3, 1, 60, drift_db, seed)
    none, up, down = (by_grid(trials, one) for one in (0.0, 6.0, -6.0))
    expected = np.logaddexp(up, down) - np.log(2.0) - none
    found = curve_drift(learnt(THREE, ONE, trials), trials)
    assert float(found.log_odds[0]) == pytest.approx(expected, abs=0.25)


def test_curve_drift__answers_of_another_generator__are_flagged_where_the_curve_moved() -> None:
    prior, answering = CurvePrior(points=14, notch_share=0.0, edge_share=0.0), Answering()
    for drift_db, least, most in ((0.0, 0.0, 0.15), (12.0, 0.8, 1.0), (-12.0, 0.8, 1.0)):
        trials = answered(prior.points, 7, 150, drift_db, seed=7)
        found = curve_drift(learnt(prior, answering, trials), trials)
        assert least <= float(np.mean(found.log_odds > LEAST_LOG_ODDS)) <= most
        assert ((found.power > 0.05) & (found.power < 1.0)).all()


def test_curve_drift__few_trials__say_that_they_cannot_tell() -> None:
    trials = answered(CurvePrior().points, 1, 15, 6.0, seed=1)
    found = curve_drift(learnt(CurvePrior(), Answering(), trials), trials)
    assert (found.power < 0.3).all()


@pytest.mark.soak
@pytest.mark.parametrize(("drift_db", "least", "most"), [(6.0, 0.60, 1.0), (-6.0, 0.60, 1.0), (0.0, 0.0, 0.03)])
def test_curve_drift__two_hundred_runs__figures_of_the_documents(drift_db, least, most) -> None:
    found = simulate_curve(WholeCurveRule(150), Setting(200, lapse=0.02, seed=17, drift_db=drift_db))
    assert least <= found.flags.get("drift", 0.0) <= most
