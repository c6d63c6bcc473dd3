"""Weights that an adaptive display learns, told before a measurement; another finger than the designed one."""

import json
from dataclasses import replace

import numpy as np

from tactuator.cli.main import main
from tactuator.io.controller import write_controller
from tactuator.io.shipped import EXAMPLES
from tactuator.measure.adaptive import LANDS_S, LIFTED_S, landing, settle_weights
from tactuator.model.controller import Controller
from tactuator.report.controller import landing_plate
from tactuator.rig.rig import WrappedRig
from tactuator.rig.simulated import SimulatedRig
from tests.measure.loops import RATE_HZ, controller, display
from tests.runtime import test_touch


def adaptive() -> Controller:
    return Controller(display(), (test_touch.adaptive(),))


def test_settle__fixed_controller__nothing_is_played() -> None:
    with SimulatedRig(display(), 3) as rig:
        rig.load(controller(display()))
        assert settle_weights(rig, controller(display()), 30.0, np.random.default_rng(1)) == ()
        assert rig.rows_played == 0


def test_settle__rig_that_does_not_tell_or_whose_time_goes_on__says_no_weights_or_no_time() -> None:
    made = adaptive()
    inner = SimulatedRig(made.display, 3)
    with WrappedRig(inner) as rig:  # it does not tell its weights
        rig.load(made)
        (mute,) = settle_weights(rig, made, 30.0, np.random.default_rng(1))
    assert (mute.weight, mute.settled_s) == (None, None)
    assert inner.rows_played == 3 * RATE_HZ
    with SimulatedRig(made.display, 3) as rig:
        rig._waits = False  # its time goes on between blocks, and its weights are told while it plays
        rig.load(made)
        (hasty,) = settle_weights(rig, made, 30.0, np.random.default_rng(1))
    assert hasty.settled_s is None
    np.testing.assert_allclose(hasty.weight, [0.0, 0.0], atol=0.15)


def test_measure__other_display_with_this_controller__weights_of_its_finger_are_told(tmp_path, capsys) -> None:
    write_controller(tmp_path / "c.json", adaptive())
    text = (EXAMPLES / "displays" / "tactuator.toml").read_text(encoding="utf-8")
    designed, other = "mass = 0.12, damping = 31.0, stiffness = 360.0", "mass = 0.07, damping = 43.0, stiffness = 500.0"
    assert designed in text
    (tmp_path / "other.toml").write_text(text.replace(designed, other), encoding="utf-8")
    files = ["--display", str(tmp_path / "other.toml"), "--controller", str(tmp_path / "c.json")]
    asked = ["measure", *files, "--load", "finger", "--frequency-hz", "32", "--json"]
    assert main(asked) == 0
    found = json.loads(capsys.readouterr().out)
    (learnt,) = found["learnt"]
    np.testing.assert_allclose(learnt["weight"], [0.07 / 0.12, 43.0 / 31.0], atol=0.15)
    assert learnt["settled_s"] <= 0.3
    (response,) = found["responses"]
    np.testing.assert_allclose(response["sensation_level_db"], response["expected_level_db_sl"], atol=0.2)


def test_landing__adaptive__within_a_decibel_where_fixed_loses_it() -> None:
    shown = landing(adaptive(), "index", seed=3)
    touched = (shown.time_s > LANDS_S + 0.1) & (shown.time_s < LIFTED_S - 0.1)
    free = (shown.time_s < LANDS_S - 0.1) | (shown.time_s > LIFTED_S + 0.1)
    assert np.mean(shown.fixed_db[touched]) < -0.6
    assert np.max(np.abs(shown.fixed_db[free])) < 0.1
    assert np.max(np.abs(shown.adaptive_db)) < 0.6
    assert np.max(np.abs(shown.adaptive_db[touched & (shown.time_s > LANDS_S + 0.3)])) < 0.15
    plate = landing_plate(shown)
    assert plate.table["adaptive_db"] == shown.adaptive_db.tolist()
    assert f"{shown.fixed_db.min():+.2f}" in plate.caption
    assert plate.svg().startswith("<?xml")


def test_landing__feed_forward_taken_away__both_runs_are_one() -> None:
    made = adaptive()
    shown = landing(replace(made, channels=(replace(made.channels[0], feed_forward=None),)), "index", seed=3)
    np.testing.assert_array_equal(shown.adaptive_db, shown.fixed_db)
