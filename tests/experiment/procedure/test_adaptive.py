"""QUEST+ and the whole curve as procedures: replay, limits, what is learnt."""

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.experiment.procedure.curve_prior import CurvePrior
from tactuator.experiment.procedure.quest_plus import QuestPlus, QuestPlusRule
from tactuator.experiment.procedure.whole_curve import WholeCurve, WholeCurveRule
from tactuator.experiment.simulated.curve_quality import simulate_curve
from tactuator.experiment.simulated.procedure_quality import Setting


@pytest.mark.parametrize(
    "make", [lambda: QuestPlus(QuestPlusRule(trials=12)), lambda: WholeCurve(WholeCurveRule(trials=12))]
)
def test_procedure__replayed__lands_on_the_same_trials(make) -> None:
    outcomes = [True, True, False, True, True, False, True, True, True, False, True, True]
    first, second = make(), make()
    placed = []
    for outcome in outcomes:
        placed.append(first.placement())
        first.record(outcome)
    for outcome, place in zip(outcomes, placed, strict=True):
        assert second.placement() == second.placement() == place
        second.record(outcome)
    assert first.placement() is None
    assert (first.trials, first.progress) == (12, 1.0)
    with pytest.raises(BadInput, match="over after 12"):
        first.record(True)


@pytest.mark.parametrize(("correct", "flag"), [(True, "floor"), (False, "ceiling")])
def test_quest_plus__always_the_same_answer__is_flagged(correct: bool, flag: str) -> None:
    run = QuestPlus(QuestPlusRule(trials=40))
    for _ in range(40):
        run.record(correct)
    assert flag in run.flags


@pytest.mark.parametrize(("slope", "limit"), [(2.5, 1.3), (1.5, 1.7)])
def test_whole_curve__hundred_and_fifty_trials__knows_the_curve(slope: float, limit: float) -> None:
    found = simulate_curve(WholeCurveRule(), Setting(64, (slope, slope), 0.02, seed=3))
    assert found.rms_error_db <= limit
    assert 0.88 <= found.coverage95 <= 0.995
    assert abs(found.bias_db) <= 0.25


def test_whole_curve__before_any_trial__is_the_prior() -> None:
    prior = CurvePrior()
    mean, sd = WholeCurve(WholeCurveRule()).curve([1.0, 11.0, 200.0])
    assert mean == pytest.approx(np.zeros(3))
    assert sd == pytest.approx(np.sqrt(np.diag(prior.covariance([1.0, 11.0, 200.0], [1.0, 11.0, 200.0]))), rel=1e-3)


def test_points__keep_away_from_mains() -> None:
    for points in (8, 20, 61):
        frequency = CurvePrior(points=points).frequency_hz
        nearest = np.maximum(np.round(frequency / 60.0), 1.0) * 60.0
        assert np.min(np.abs(frequency - nearest)) >= 2.0 - 1e-9
        assert 0.4 - 1e-9 <= frequency.min() < frequency.max() <= 300.0


@pytest.mark.parametrize(
    "make",
    [
        lambda: QuestPlusRule(trials=0),
        lambda: QuestPlusRule(low_db_sl=10.0, high_db_sl=5.0),
        lambda: QuestPlusRule(slopes=(1.0,)),
        lambda: QuestPlusRule(aim="fun"),  # type: ignore[arg-type]
        lambda: QuestPlusRule(expected_sd_db=0.0),
        lambda: QuestPlusRule(guess=0.9),
        lambda: WholeCurveRule(trials=0),
        lambda: WholeCurveRule(floor_db_sl=50.0),
        lambda: CurvePrior(band_hz=(3.0, 1.0)),
        lambda: CurvePrior(points=2),
        lambda: CurvePrior(wave_db=0.0),
    ],
)
def test_rule__nonsense__is_refused(make) -> None:
    with pytest.raises(BadInput, match="allowed"):
        make()
