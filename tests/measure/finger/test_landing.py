"""The felt level while a finger lands and is lifted, and its figure."""

from dataclasses import replace

import numpy as np

from tactuator.measure.adaptive import LANDS_S, LIFTED_S, landing
from tactuator.report.controller import landing_plate
from tests.measure.finger.test_weights import adaptive


def test_landing__adaptive__within_a_decibel_where_fixed_loses_it() -> None:
    shown = landing(adaptive(), "index", seed=3)
    touched = (shown.time_s > LANDS_S + 0.1) & (shown.time_s < LIFTED_S - 0.1)
    free = (shown.time_s < LANDS_S - 0.1) | (shown.time_s > LIFTED_S + 0.1)
    assert np.mean(shown.fixed_db[touched]) < -0.6
    assert np.max(np.abs(shown.fixed_db[free])) < 0.1
    assert np.max(np.abs(shown.adaptive_db)) < 0.6
    assert np.max(np.abs(shown.adaptive_db[touched & (shown.time_s > LANDS_S + 0.3)])) < 0.15


def test_landing__feed_forward_taken_away__both_runs_are_one() -> None:
    made = adaptive()
    fixed = replace(made, channels=(replace(made.channels[0], feed_forward=None),))
    shown = landing(fixed, "index", seed=3)
    np.testing.assert_array_equal(shown.adaptive_db, shown.fixed_db)


def test_plate__numbers_of_the_figure__stand_in_table_and_caption() -> None:
    shown = landing(adaptive(), "index")
    plate = landing_plate(shown)
    assert plate.table["adaptive_db"] == shown.adaptive_db.tolist()
    assert f"{shown.fixed_db.min():+.2f}" in plate.caption
    assert plate.svg().startswith("<?xml")
