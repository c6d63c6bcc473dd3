"""QUEST+ and the whole curve as procedures, flags of runs at one frequency, up-down tracks written by hand."""

import dataclasses
import tomllib
from collections import Counter
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactuator.errors import BadInput
from tactuator.experiment.procedure.curve_prior import CurveKind, CurvePrior
from tactuator.experiment.procedure.procedure import Answering
from tactuator.experiment.procedure.quest_plus import QuestPlus, QuestPlusRule, tables
from tactuator.experiment.procedure.refit import RefitPrior, refit
from tactuator.experiment.procedure.up_down import IMECE2004, UpDown, UpDownRule, run_tracks
from tactuator.experiment.procedure.whole_curve import WholeCurve, WholeCurveRule
from tactuator.perception.psychometric import Psychometric
from tests.experiment.conftest import Logistic
from witnesses.people.flags import LOUD_SHARE, judged


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


def test_flags__of_the_witness_s_people__are_seldom_wrong_and_mostly_right() -> None:
    """A sample of `witnesses.people.flags`: seven of 100 flagged wrongly are seen."""
    for kind in ("curve", "imece2004", "quest-plus", "up-down"):  # its rates are those of what is shipped
        text = files("tactuator.io.examples.protocols").joinpath(f"{kind}.toml").read_text()
        assert tomllib.loads(text)["catch"]["loud_share"] == LOUD_SHARE
    counts = {
        name: Counter(flag for flags in judged("imece2004", name, people, 1, []) for flag in flags)
        for name, people in (("normal", 100), ("lapsing", 50), ("guessing", 20))
    }
    assert max(counts["normal"].values(), default=0) <= 4
    assert counts["lapsing"]["lapses"] >= 30
    assert counts["guessing"]["chance"] == 20


def test_quest_plus__estimate__is_of_the_product_of_prior_and_all_answers() -> None:
    rule, rng = QuestPlusRule(trials=25), np.random.default_rng(2)
    run, table = QuestPlus(rule), tables(rule)
    weight = table.prior.copy()
    while (placement := run.placement()) is not None:
        right, psi = bool(rng.random() < 0.7), table.psi[:, np.flatnonzero(table.levels == placement.level_db_sl)[0]]
        weight *= psi if right else 1.0 - psi
        run.record(right)
    mean = np.average(table.parameter_threshold, weights=weight)
    sd = np.sqrt(np.average((table.parameter_threshold - mean) ** 2, weights=weight))
    assert dataclasses.astuple(run.estimate()) == pytest.approx((mean, sd), rel=1e-6)


@pytest.mark.parametrize("target", [0.5**0.5, 0.5 ** (1.0 / 3.0)])
def test_refit__target_of_the_procedure__is_where_psi_reaches_it(target: float) -> None:
    rng, model = np.random.default_rng(4), Psychometric(Logistic(), target=target)
    levels = rng.integers(-6, 7, (40, 300)).astype(float)
    found = refit(levels, rng.random(levels.shape) < model.probability(levels), RefitPrior(target=target))
    assert float(np.mean(found.threshold_db)) == pytest.approx(0.0, abs=0.35)


def track(rule: UpDownRule, start: float, responses: str) -> UpDown:
    run = UpDown(replace(rule, start_db_sl=start))
    for response in responses:
        run.record(response == "+")
    return run


def test_imece2004_and_initial_rule__tracks_by_hand__step_and_end_as_psychopys_do() -> None:
    # StairHandler with stepSizes=[4,4,4,1], nReversals=15, nUp=1, nDown=3, applyInitialRule=False (facts, section 5).
    responses = "++++++-+++-+++-++-++++++-"
    run = track(IMECE2004, 20.0, responses)
    by_hand = [20, 20, 20, 16, 16, 16, 12, 16, 16, 16, 12, 13, 13, 13, 12, 13, 13, 13, 14, 14, 14, 13, 13, 13, 12]
    assert run.levels == by_hand
    assert run.reversal_levels == [12, 16, 12, 13, 12, 14, 12]
    assert run.level_db_sl == 13
    # Down to 12 and up: three reversals at 4 dB; then every +++ and - in turn is a reversal, between 13 and 12.
    run = track(IMECE2004, 20.0, "++++++-+++-" + ("+++-") * 6)
    assert run.placement() is None
    assert run.reversal_levels == [12, 16, 12] + [13, 12] * 6
    estimate = run.estimate()
    assert estimate is not None
    assert estimate.level_db_sl == 12.5
    with pytest.raises(BadInput, match="over after 35 trials"):
        run.record(True)
    rule = UpDownRule(steps_db=(4.0, 2.0), reversals=4, averaged=2, initial_rule=True)
    run = track(rule, 20.0, "+++-+++")
    assert run.levels == [20, 16, 12, 8, 10, 10, 10]
    assert run.level_db_sl == 8


def test_simple_up_down__levitts_example__runs_end_where_he_counts_them() -> None:
    # Levitt (1971), figure 4, as remembered: trials 1 to 2 are the first run, 2 to 6 the second, 6 to 8 the third. The
    # text of the paper was not at hand; what is certain is that a run is a series of steps in one direction.
    rule = UpDownRule(down=1, up=1, steps_db=(1.0,), reversals=4, averaged=4, average="mid-runs", start_db_sl=0.0)
    run = UpDown(rule)
    turned_at = []
    for trial, response in enumerate("+----++--+", start=1):
        before = len(run.reversal_levels)
        run.record(response == "+")
        turned_at += [trial] * (len(run.reversal_levels) - before)
    assert turned_at[:3] == [2, 6, 8]
    assert run.levels[:8] == [0, -1, 0, 1, 2, 3, 2, 1]
    assert run.reversal_levels == [-1, 3, 1, 3]
    estimate = run.estimate()
    assert estimate is not None
    assert estimate.level_db_sl == 1.5  # mid-runs two and four: (-1 + 3)/2 and (1 + 3)/2


@pytest.mark.parametrize(
    ("down", "up", "target"),
    [(1, 1, 0.5), (2, 1, 0.7071), (3, 1, 0.7937), (4, 1, 0.8409), (1, 2, 0.2929), (1, 3, 0.2063)],
)
def test_target__levitts_table_one__is_met(down: int, up: int, target: float) -> None:
    assert UpDownRule(down=down, up=up).target == pytest.approx(target, abs=1e-4)


@pytest.mark.parametrize(
    ("limits", "responses", "level_db_sl", "flag"),
    [
        ({"floor_db_sl": 18.0}, "+++", 18.0, "floor"),
        ({"ceiling_db_sl": 22.0}, "-", 22.0, "ceiling"),
        ({"trial_limit": 5}, "+++++", 16.0, "trial-limit"),
    ],
)
def test_limit__track_wants_beyond__is_held_and_flagged(limits, responses, level_db_sl, flag) -> None:
    run = track(UpDownRule(**limits), 20.0, responses)
    assert (run.level_db_sl, run.flags, run.estimate()) == (level_db_sl, (flag,), None)
    assert (run.placement() is None) == (flag == "trial-limit")


@given(st.lists(st.booleans(), min_size=1, max_size=120), st.booleans())
def test_batch__any_responses__gives_the_single_track(responses: list[bool], initial: bool) -> None:
    rule = UpDownRule(initial_rule=initial, floor_db_sl=-5.0, trial_limit=len(responses), start_db_sl=10.0)
    run = UpDown(rule)
    for response in responses:
        if run.placement() is not None:
            run.record(response)
    answers = iter(responses)
    tracks = run_tracks(
        rule, np.array([10.0]), lambda _, __, ___: np.array([float(next(answers))]), np.random.default_rng(0)
    )
    assert tracks.levels_db_sl[0].tolist() == run.levels
    estimate = run.estimate()
    own = tracks.estimates_db_sl[0]
    assert np.isnan(own) if estimate is None else own == pytest.approx(estimate.level_db_sl)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"down": 0}, "down is 0; allowed: a whole number, 1 or more"),
        ({"steps_db": ()}, "steps_db"),
        ({"steps_db": (4.0, -1.0)}, "steps_db.1 is -1; allowed: .*above 0"),
        ({"averaged": 20}, "averages 20 of 15"),
        ({"average": "median"}, "'median'"),
        ({"floor_db_sl": 40.0, "ceiling_db_sl": 30.0}, "not below the ceiling"),
        ({"trial_limit": 0}, "trial_limit"),
        ({"average": "mid-runs", "averaged": 1}, "mid-runs of 1"),
        ({"floor_db_sl": 25.0}, "start_db_sl is 20; allowed: 25 to 55"),
    ],
)
def test_up_down_rule__nonsense__is_refused(settings: dict[str, object], message: str) -> None:
    with pytest.raises(BadInput, match=message):
        UpDownRule(**settings)  # type: ignore[arg-type]
