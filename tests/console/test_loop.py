"""The loop view: shapes by factors against their own transfer functions, and its frames against python-control."""

from dataclasses import replace

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactuator.console.loop_chart import channel_plants, frame, ground
from tactuator.console.loop_shape import FACTORS_MAX, Factor, LoopShape, shape_of, taken_apart, with_point_at
from tactuator.errors import BadInput
from tactuator.io.display import parse_display
from tactuator.signals.discretise import discretise
from tactuator.signals.loop import FeedbackLoop
from tactuator.signals.loop_figures import margins
from tactuator.signals.systems import ContinuousSystem
from tests.three_fingers import three_finger_display

RATE_HZ = 4000.0
FREQUENCIES_HZ = np.geomspace(0.2, 1500.0, 60)
PLANT = discretise(ContinuousSystem.from_polynomials([2875.0], [1.0, 94.0, 290.0]), RATE_HZ, "zoh")

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


@settings(max_examples=30)
@given(st.floats(0.5, 300.0), st.floats(-40.0, 40.0), st.floats(-20.0, 30.0))
def test_point__dragged__stands_where_it_was_let_go(frequency_hz, turn_deg, level_db):
    before = LoopShape(10.0, (Factor("integrator"), Factor("zero", (5.0,)), Factor("pole", (200.0,))))
    after = with_point_at(before, PLANT, frequency_hz, turn_deg, level_db)
    was, now = (one.system(RATE_HZ).response(frequency_hz) * PLANT.response(frequency_hz) for one in (before, after))
    assert 20.0 * np.log10(abs(now)) == pytest.approx(level_db, abs=1e-9)
    assert np.degrees(np.angle(now / was)) == pytest.approx(turn_deg, abs=1e-6)


def test_shape__of_values_that_are_none_or_out_of_range__is_refused():
    for document, words in (
        ({"gain_db": 0.0}, "factors is None"),
        ({"gain_db": "loud", "factors": []}, "gain_db is 'loud'"),
        ({"gain_db": float("nan"), "factors": []}, "gain_db is nan"),
        ({"gain_db": 10**400, "factors": []}, "a finite number"),
        ({"gain_db": 0.0, "factors": [{"kind": "magic"}]}, "one of integrator"),
        ({"gain_db": 0.0, "factors": [{"kind": ["pole"]}]}, "one of integrator"),
        ({"gain_db": 0.0, "factors": [{"kind": "pole"}]}, "hz is None"),
        ({"gain_db": 0.0, "factors": ["pole"]}, "factor 'pole'"),
    ):
        with pytest.raises(BadInput, match=words):
            shape_of(document)
    for shape, words in (
        (LoopShape(300.0), "gain_db is 300"),
        (LoopShape(0.0, (Factor("pole", (3000.0,)),)), "hz is 3000; it must be 0.001 to 1960"),
        (LoopShape(0.0, (Factor("poles", (30.0, 0.0)),)), "damping is 0"),
        (LoopShape(0.0, (Factor("zero", (30.0,)),)), "1 zeros and 0 poles"),
        (LoopShape(0.0, (Factor("integrator"),) * (FACTORS_MAX + 1)), "up to 16"),
        (LoopShape(0.0, (), 2), "sign is 2"),
    ):
        with pytest.raises(BadInput, match=words):
            shape.system(RATE_HZ)


SHAPE = LoopShape(
    20.0, (Factor("integrator"), Factor("zero", (3.0,)), Factor("lead", (25.0, 3.0)), Factor("pole", (200.0,)))
)


@pytest.fixture(scope="module")
def on():
    document = three_finger_display()
    document["feedback"] = {
        "mains_hz": [60.0],
        "mains_max_db": [-6.0],
        "rejection_hz": [1.0],
        "rejection_max_db": [-12.0],
    }
    display = parse_display(document)
    channel = display.channels[0]
    other = ContinuousSystem(channel.plant.zeros, channel.plant.poles, 1.1 * channel.plant.gain)
    return channel_plants(display, replace(channel, family=(other,)))


def oracle(on, place, shape=SHAPE):
    system, plant = shape.system(on.display.rate_hz), on.family[place].sampled
    step = 1.0 / on.display.rate_hz
    late = control.tf([1.0], [1.0, *([0.0] * plant.delay_samples)], step)
    return [control.zpk(one.zeros, one.poles, one.gain, dt=step) for one in (system, plant)], late


def test_frame__curves__are_those_of_python_control(on):
    found = frame(on, SHAPE.system(on.display.rate_hz))
    (system, plant), late = oracle(on, 0)
    loop = (system * plant * late)(np.exp(2j * np.pi * on.frequency_hz / on.display.rate_hz))
    curve = found["curves"][0]
    assert [one["load"] for one in found["curves"]] == ["none", "finger"]
    assert np.allclose(curve["gain_db"], 20.0 * np.log10(np.abs(loop)), atol=2e-3)
    assert np.allclose(np.cos(np.radians(curve["phase_deg"])), np.cos(np.angle(loop)), atol=1e-4)
    assert np.allclose(curve["s_db"], -20.0 * np.log10(np.abs(1.0 + loop)), atol=2e-3)


@pytest.mark.parametrize("place", [0, 1])
def test_frame__steps__are_those_of_python_control(on, place):
    found = frame(on, SHAPE.system(on.display.rate_hz))
    (system, plant), late = oracle(on, place)
    both = control.ss(control.tf(plant) * late)
    for name, closed in (
        ("asked", control.feedback(both * control.ss(control.tf(system)))),
        ("pushed", control.feedback(both, control.ss(control.tf(system)))),
    ):
        time = np.arange(400 * on.stride) / on.display.rate_hz
        _, answer = control.step_response(closed, time)
        wanted = np.squeeze(answer)[:: on.stride][: on.time_s.size]
        assert np.allclose(found["steps"][name]["curves"][place], wanted[: on.time_s.size], atol=2e-4), name


@pytest.mark.parametrize("gain_db", [4, 16, 22, 31, 43])
def test_frame__crossed__agrees_with_the_exact_margins(on, gain_db):
    system = replace(SHAPE, gain_db=float(gain_db)).system(on.display.rate_hz)
    found = frame(on, system)
    loops = [FeedbackLoop(system, member.sampled) for member in on.family]
    assert found["unstable"] == [m.name for m, loop in zip(on.family, loops, strict=True) if not loop.is_stable]
    if found["unstable"]:
        return
    exact = [margins(loop) for loop in loops]
    asked = on.channel.feedback
    wanted = {
        "sensitivity": max(one.sensitivity_peak for one in exact) > asked.sensitivity_peak,
        "resonance": max(one.complementary_peak for one in exact) > on.display.objectives.resonance_peak,
        "phase": min(one.phase_margin_deg for one in exact) < asked.phase_margin_deg,
        "mains 60": max(float(np.abs(loop.complementary(60.0))) for loop in loops) > 10.0 ** (-6.0 / 20.0),
        "rejection 1": max(float(np.abs(loop.sensitivity(1.0))) for loop in loops) > 10.0 ** (-12.0 / 20.0),
    }
    assert set(found["crossed"]) == {name for name, passed in wanted.items() if passed}


def test_ground__regions__lie_on_their_limits(on):
    found = ground(on)
    for name, closed, limit in (
        ("sensitivity", lambda loop: 1.0 / (1.0 + loop), on.channel.feedback.sensitivity_peak),
        ("resonance", lambda loop: loop / (1.0 + loop), on.display.objectives.resonance_peak),
    ):
        phase, gain = np.array(found[name]).T
        loop = 10.0 ** (gain / 20.0) * np.exp(1j * np.radians(phase))
        assert np.allclose(np.abs(closed(loop)), limit, rtol=0.02), name
