"""Up-down tracks against tracks written out by hand, Levitt's example, and the paper's own words."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactuator.errors import BadInput
from tactuator.experiment.procedure.up_down import IMECE2004, UpDown, UpDownRule, run_tracks


def track(rule: UpDownRule, start: float, responses: str) -> UpDown:
    run = UpDown(replace(rule, start_db_sl=start))
    for response in responses:
        run.record(response == "+")
    return run


def test_imece2004__track_by_hand__levels_and_reversals_are_as_psychopy_steps_them() -> None:
    # StairHandler with stepSizes=[4,4,4,1], nReversals=15, nUp=1, nDown=3, applyInitialRule=False (facts, section 5).
    responses = "++++++-+++-+++-++-++++++-"
    run = track(IMECE2004, 20.0, responses)
    by_hand = [20, 20, 20, 16, 16, 16, 12, 16, 16, 16, 12, 13, 13, 13, 12, 13, 13, 13, 14, 14, 14, 13, 13, 13, 12]
    assert run.levels == by_hand
    assert run.reversal_levels == [12, 16, 12, 13, 12, 14, 12]
    assert run.level_db_sl == 13


def test_imece2004__whole_run_by_hand__ends_after_fifteen_reversals_and_averages_the_last_twelve() -> None:
    # Down to 12 and up: three reversals at 4 dB; then every +++ and - in turn is a reversal, between 13 and 12.
    run = track(IMECE2004, 20.0, "++++++-+++-" + ("+++-") * 6)
    assert run.placement() is None
    assert run.reversal_levels == [12, 16, 12] + [13, 12] * 6
    estimate = run.estimate()
    assert estimate is not None
    assert estimate.level_db_sl == 12.5
    with pytest.raises(BadInput, match="over after 35 trials"):
        run.record(True)


def test_initial_rule__first_reversal_ends_one_down() -> None:
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
def test_rule__nonsense__is_refused(settings: dict[str, object], message: str) -> None:
    with pytest.raises(BadInput, match=message):
        UpDownRule(**settings)  # type: ignore[arg-type]
