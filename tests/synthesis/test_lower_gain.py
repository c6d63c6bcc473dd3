"""Loops at lower gain: a sample of the witness, and the loop that it was seen to catch."""

import pytest

from witnesses.loops.lower_gain import BROKEN_SOS, Drawn, grows_at, run


def test_design__drawn_plants__no_loop_grows_at_a_lower_gain_or_swings_on() -> None:
    for plant, grows, left, _ in run(2, seed=1):
        assert grows == 0.0, plant
        assert left < 0.01, plant


def test_witness__loop_that_a_lower_gain_makes_unstable__is_caught() -> None:
    assert grows_at(Drawn("integrator", (0.0, -50.0), 35530.0, 0.0, 8000.0, 1), BROKEN_SOS) == pytest.approx(
        0.048, rel=0.1
    )
