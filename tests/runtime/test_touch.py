"""What the core learns of a finger, and what is felt: on the simulated display, and on fingers it does not contain."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from tactuator.model.controller import ChannelController, Controller
from tactuator.model.plant import Load
from tactuator.runtime._core import ffi, lib
from tactuator.runtime.simulation import Simulation
from tactuator.runtime.tables import controller_table
from tactuator.signals.decibels import db
from tactuator.signals.loop import TwoDegreeLoop
from tactuator.synthesis.family import plant_family
from tactuator.synthesis.touch import design_feed_forward
from tests.runtime.paper_display import RATE_HZ, channel, controller, display

FIVE_HZ = np.array([3.0, 9.0, 27.0, 85.0, 250.0])
SECOND = int(RATE_HZ)


def tones(samples: int, frequency_hz: NDArray[np.float64] = FIVE_HZ, level_db_sl: float = 30.0) -> NDArray[np.float64]:
    phase = 2.0 * np.pi * np.outer(np.arange(samples) / RATE_HZ, frequency_hz) + frequency_hz
    return np.asarray(10.0 ** (level_db_sl / 20.0) * np.sin(phase).sum(axis=1))


def amplitudes(signal: NDArray[np.float64], frequency_hz: NDArray[np.float64] = FIVE_HZ) -> NDArray[np.float64]:
    phase = 2.0 * np.pi * np.outer(np.arange(signal.size) / RATE_HZ, frequency_hz)
    basis = np.hstack([np.cos(phase), np.sin(phase), np.ones((signal.size, 1))])
    found = np.linalg.lstsq(basis, signal, rcond=None)[0][:-1].reshape(2, -1)
    return np.asarray(np.hypot(*found))


@cache
def adaptive(finger: str = "index") -> ChannelController:
    of = channel(finger)
    own = display(of)
    fixed = controller(own).channels[0]
    plant = plant_family(of, RATE_HZ, 1)[0].sampled
    loop = TwoDegreeLoop(fixed.prefilter(RATE_HZ), fixed.feedback(RATE_HZ), plant)
    return replace(fixed, feed_forward=design_feed_forward(own, of, loop))


def feeding_whole() -> ChannelController:
    """One that feeds forward all of the mass that it has learnt, not the designed share."""
    return replace(adaptive(), feed_forward=replace(adaptive().feed_forward, mass_fed=1.0))


def touching(own: ChannelController, load: str | None, touched: Load | None = None) -> Simulation:
    """A simulated display with that controller, under a load of its own or another of that name."""
    simulation = Simulation(display(channel() if touched is None else channel(loads=(touched,))), 7)
    simulation.load(Controller(display(channel()), (own,)))
    simulation.touch(0, load)
    return simulation


def played(
    own: ChannelController, load: str | None, seconds: int, touched: Load | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The last second of what was felt, mm, and the weights."""
    simulation = touching(own, load, touched)
    felt = simulation.play(tones(seconds * SECOND)).displacement_mm[-SECOND:, 0]
    return felt, simulation.weights()[0]


def test_adaptation__finger_with_friction_hum_and_noise__felt_as_free() -> None:
    free, no_weight = played(adaptive(), None, 3)
    loaded, weight = played(adaptive(), "finger", 3)
    fixed, _ = played(replace(adaptive(), feed_forward=None), "finger", 3)
    assert np.max(np.abs(db(amplitudes(fixed) / amplitudes(free)))) > 1.5
    assert np.max(np.abs(db(amplitudes(loaded) / amplitudes(free)))) < 0.45
    whole, _ = played(feeding_whole(), "finger", 3)
    assert np.max(np.abs(db(amplitudes(whole) / amplitudes(free)))) < 0.25
    assert np.max(np.abs(db(amplitudes(whole) / amplitudes(loaded)))) > 0.1  # a share of the mass is fed, not all
    np.testing.assert_allclose(weight, [1.0, 1.0], atol=0.15)
    np.testing.assert_allclose(no_weight, [0.0, 0.0], atol=0.15)


@pytest.mark.parametrize(("mass", "damping"), [(0.5, 1.5), (1.5, 0.5)])
def test_adaptation__finger_of_another_shape__is_found(mass: float, damping: float) -> None:
    other = Load("finger", 0.12 * mass, 31.0 * damping, 360.0 * damping)
    felt, weight = played(feeding_whole(), "finger", 3, other)
    free, _ = played(adaptive(), None, 3)
    np.testing.assert_allclose(weight, [mass, damping], atol=0.2)
    assert np.max(np.abs(db(amplitudes(felt) / amplitudes(free)))) < 0.3


def test_adaptation__lifted_as_a_sound_becomes_quiet__learnt_from_the_quiet_one() -> None:
    simulation = touching(adaptive(), "finger")
    asked = tones(SECOND + SECOND // 10)
    simulation.play(2.0 * asked[:SECOND])
    assert np.all(simulation.weights()[0] > 0.8)
    simulation.touch(0, None)
    simulation.play(0.5 * asked[SECOND:])
    assert np.all(simulation.weights()[0] < 0.4)


def test_adaptation__silence__weights_stay_and_fade_slowly() -> None:
    simulation = touching(adaptive(), "finger")
    simulation.play(np.append(tones(2 * SECOND), np.zeros(SECOND)))
    learnt = simulation.weights()[0]
    simulation.play(np.zeros(10 * SECOND))
    assert adaptive().feed_forward.fading_s == 30.0  # type: ignore[union-attr]
    np.testing.assert_allclose(simulation.weights()[0] / learnt, np.exp(-10.0 / 30.0), atol=0.03)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e38])
def test_estimator__fed_what_is_no_number__adds_nothing_and_goes_on(bad: float) -> None:
    controller, _ = controller_table(adaptive(), RATE_HZ, 0)
    table, state = ffi.addressof(controller, "touch"), ffi.new("tact_touch_state *")
    lib.tact_touch_reset(table, state)
    rng = np.random.default_rng(2)
    wanted = (0.01 * rng.standard_normal(SECOND)).astype(np.float32)
    position = wanted.copy()
    position[500:520] = bad
    added = []
    for sample in zip(wanted, position, strict=True):
        added.append(lib.tact_touch_step(table, state, controller.feedback, controller.feedback_count, *sample))
        lib.tact_touch_put(table, state, 0.0)
    weight = np.array(list(state.weight))
    assert np.all(np.isfinite(added))
    assert np.max(np.abs(added)) <= table.push_max_v
    assert np.all((weight >= 0.0) & (weight <= table.weight_max))


def test_push__beyond_its_bound__everything_is_reset() -> None:
    own = replace(adaptive(), feed_forward=replace(adaptive().feed_forward, push_max_v=0.01))  # type: ignore[type-var]
    _, weight = played(own, "finger", 1)
    unbounded = played(adaptive(), "finger", 1)[1]
    assert np.max(weight) < 0.5 < np.max(unbounded)
