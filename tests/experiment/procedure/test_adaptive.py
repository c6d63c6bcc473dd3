"""QUEST+ and the whole curve as procedures: replay, limits, what is learnt."""

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.experiment.procedure.curve_prior import CurveKind, CurvePrior
from tactuator.experiment.procedure.procedure import Answering
from tactuator.experiment.procedure.quest_plus import QuestPlus, QuestPlusRule
from tactuator.experiment.procedure.whole_curve import WholeCurve, WholeCurveRule


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
        lambda: CurvePrior(notch_db=-1.0),
        lambda: CurvePrior(clearance_hz=40.0),
        lambda: WholeCurveRule(answering=Answering(lapses=(0.3,), lapse_shares=(1.0,))),
        lambda: Answering(slopes=()),
        lambda: CurveKind("odd", wave_decades=0.0),
    ],
)
def test_rule__nonsense__is_refused(make) -> None:
    with pytest.raises(BadInput, match="allowed"):
        make()
