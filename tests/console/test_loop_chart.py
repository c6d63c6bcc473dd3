"""Frames of the loop view against python-control, and what is crossed against the exact margins."""

from dataclasses import replace

import control
import numpy as np
import pytest

from tactuator.console.loop_chart import channel_plants, frame, ground
from tactuator.console.loop_shape import Factor, LoopShape
from tactuator.io.display import parse_display
from tactuator.signals.loop import FeedbackLoop, margins
from tactuator.signals.systems import ContinuousSystem
from tests.three_fingers import three_finger_display

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
    """The open loop of one plant as python-control has it."""
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
