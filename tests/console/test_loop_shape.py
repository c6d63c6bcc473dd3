"""Shapes: each factor against its own transfer function, and back from a system."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactuator.console.loop_shape import FACTORS_MAX, Factor, LoopShape, shape_of, taken_apart, with_point_at
from tactuator.errors import BadInput
from tactuator.signals.discretise import bilinear, zero_order_hold
from tactuator.signals.systems import ContinuousSystem
from tactuator.synthesis.paper import FEEDBACK

RATE_HZ = 4000.0
FREQUENCIES_HZ = np.geomspace(0.2, 1500.0, 60)
PLANT = zero_order_hold(ContinuousSystem.from_polynomials([2875.0], [1.0, 94.0, 290.0]), RATE_HZ)

HZ = st.floats(0.5, 1500.0)
DAMPING = st.floats(0.05, 0.95) | st.floats(1.05, 5.0)  # at 1 a pair's roots meet, and lie by chance
FACTORS = st.one_of(
    st.just(Factor("integrator")),
    st.builds(lambda hz: Factor("pole", (hz,)), HZ),
    st.builds(lambda hz, damping: Factor("poles", (hz, damping)), HZ, DAMPING),
    st.builds(lambda hz, ratio: Factor("lead", (hz, ratio)), st.floats(1.0, 300.0), st.floats(0.2, 8.0)),
    st.builds(lambda hz, damping, depth: Factor("notch", (hz, damping, depth)), HZ, DAMPING, st.floats(1.0, 20.0)),
)


@settings(max_examples=30)
@given(st.lists(FACTORS, min_size=1, max_size=4), st.floats(-40.0, 40.0), st.sampled_from([-1, 1]))
def test_shape__taken_apart_again__is_the_same_system(factors, gain_db, sign):
    system = LoopShape(gain_db, tuple(factors), sign).system(RATE_HZ)
    again = taken_apart(system).system(RATE_HZ)
    assert np.allclose(again.response(FREQUENCIES_HZ), system.response(FREQUENCIES_HZ), rtol=1e-6)


@pytest.mark.parametrize(
    ("factor", "continuous"),
    [
        (Factor("zero", (3.0,)), lambda s: 1.0 + s / (2.0 * np.pi * 3.0)),
        (Factor("poles", (4.0, 0.7)), lambda s: 1.0 / (1.0 + 1.4 * s / (8.0 * np.pi) + (s / (8.0 * np.pi)) ** 2)),
        (Factor("lead", (4.0, 4.0)), lambda s: (1.0 + s / (4.0 * np.pi)) / (1.0 + s / (16.0 * np.pi))),
        (Factor("integrator"), lambda s: 2.0 * np.pi / s),
    ],
)
def test_factor__far_below_half_the_rate__is_its_continuous_form(factor, continuous):
    frequency = np.geomspace(0.1, 8.0, 20)
    more = Factor("pole", (0.49 * RATE_HZ,))  # a zero alone is not proper
    found = LoopShape(0.0, (factor, more)).system(RATE_HZ).response(frequency)
    found /= LoopShape(0.0, (more,)).system(RATE_HZ).response(frequency)
    assert np.allclose(found, continuous(2j * np.pi * frequency), rtol=0.02)


def test_taken_apart__the_papers_controller__keeps_the_roots_at_minus_one():
    system = bilinear(FEEDBACK, RATE_HZ)
    again = taken_apart(system).system(RATE_HZ)
    assert np.allclose(again.response(FREQUENCIES_HZ), system.response(FREQUENCIES_HZ), rtol=1e-9)


@settings(max_examples=30)
@given(st.floats(0.5, 300.0), st.floats(-40.0, 40.0), st.floats(-20.0, 30.0))
def test_point__dragged__stands_where_it_was_let_go(frequency_hz, turn_deg, level_db):
    before = LoopShape(10.0, (Factor("integrator"), Factor("zero", (5.0,)), Factor("pole", (200.0,))))
    after = with_point_at(before, PLANT, frequency_hz, turn_deg, level_db)
    was, now = (one.system(RATE_HZ).response(frequency_hz) * PLANT.response(frequency_hz) for one in (before, after))
    assert 20.0 * np.log10(abs(now)) == pytest.approx(level_db, abs=1e-9)
    assert np.degrees(np.angle(now / was)) == pytest.approx(turn_deg, abs=1e-6)


def test_point__dragged_in_two_steps_or_too_far__leaves_one_lead_at_its_bound():
    once = with_point_at(LoopShape(0.0), PLANT, 30.0, 10.0, 0.0)
    twice = with_point_at(once, PLANT, 30.0, 10.0, 0.0)
    assert [each.kind for each in twice.factors] == ["lead"]
    assert with_point_at(LoopShape(0.0), PLANT, 30.0, 170.0, 0.0).factors[0]["ratio"] == 50.0


def test_shape__of_values_that_are_none_or_out_of_range__is_refused():
    for document, words in (
        ({"gain_db": 0.0}, "factors is None"),
        ({"gain_db": "loud", "factors": []}, "gain_db is 'loud'"),
        ({"gain_db": float("nan"), "factors": []}, "gain_db is nan"),
        ({"gain_db": 10**400, "factors": []}, "allowed: a finite number"),
        ({"gain_db": 0.0, "factors": [{"kind": "magic"}]}, "allowed: one of integrator"),
        ({"gain_db": 0.0, "factors": [{"kind": ["pole"]}]}, "allowed: one of integrator"),
        ({"gain_db": 0.0, "factors": [{"kind": "pole"}]}, "hz is None"),
        ({"gain_db": 0.0, "factors": ["pole"]}, "factor 'pole'"),
    ):
        with pytest.raises(BadInput, match=words):
            shape_of(document)
    for shape, words in (
        (LoopShape(300.0), "gain_db is 300"),
        (LoopShape(0.0, (Factor("pole", (3000.0,)),)), "hz is 3000; allowed: 0.001 to 1960"),
        (LoopShape(0.0, (Factor("poles", (30.0, 0.0)),)), "damping is 0"),
        (LoopShape(0.0, (Factor("zero", (30.0,)),)), "1 zeros and 0 poles"),
        (LoopShape(0.0, (Factor("integrator"),) * (FACTORS_MAX + 1)), "allowed: up to 16"),
        (LoopShape(0.0, (), 2), "sign is 2"),
    ):
        with pytest.raises(BadInput, match=words):
            shape.system(RATE_HZ)
