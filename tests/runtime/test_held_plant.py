"""The simulated plant, freed of everything else, against python-control, scipy and closed forms."""

from dataclasses import replace

import control
import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import integrate, signal

from tactuator.errors import BadInput
from tactuator.model.coupling import Coupling
from tactuator.model.description import Channel, Converter, Display
from tactuator.model.plant import Load
from tactuator.runtime.simulation import Simulation
from tactuator.signals.systems import ContinuousSystem
from tests.runtime.paper_display import QUIET, RATE_HZ, channel, controller, display
from tests.signals.precisely import expanded


def three(coupling: Coupling | None = None) -> Display:
    one = replace(channel(), environment=QUIET, converter=FINE)
    channels = tuple(replace(one, name=name, finger=name) for name in ("index", "thumb", "middle"))
    of = replace(display(one), channels=channels)
    return of if coupling is None else replace(of, coupling=coupling)


def test_coupling__of_a_frame__moves_the_neighbours_as_scipy_computes_it() -> None:
    coupling = Coupling(level_db=-20.0, resonance_hz=90.0, damping=0.2)
    command = np.zeros((2000, 3))
    command[:, 1] = np.random.default_rng(1).normal(0.0, 2.0, 2000)
    moved = Simulation(three(coupling)).drive(command).displacement_mm * 0.19898
    omega = 2.0 * np.pi * 90.0
    held = signal.cont2discrete(([omega**2], [1.0, 0.4 * omega, omega**2]), 1.0 / RATE_HZ)
    plant = signal.cont2discrete(([2875.0], [1.0, 94.0, 290.0]), 1.0 / RATE_HZ)
    arrived = 0.1 * signal.lfilter(held[0].ravel(), held[1], command[:, 1])
    for source, at in ((command[:, 1], 1), (arrived, 0), (arrived, 2)):
        told = signal.lfilter(plant[0].ravel(), plant[1], source)
        assert moved[:, at] == pytest.approx(told, abs=2e-5 * np.max(np.abs(told)) + 1e-5)


def test_coupling__none__leaves_every_bit_and_a_frame_changes_them() -> None:
    reference = np.random.default_rng(2).normal(0.0, 3.0, (1000, 3))
    played = []
    for of in (three(), three(Coupling()), three(Coupling(level_db=-40.0))):
        simulation = Simulation(of)
        simulation.load(controller(of, command_v=90.0))
        played.append(simulation.play(reference).displacement_mm)
    assert np.array_equal(played[0], played[1])
    assert not np.array_equal(played[0], played[2])


@pytest.mark.parametrize("level_db", [0.0, 3.0])
def test_coupling__as_strong_as_the_motor_itself__is_refused(level_db: float) -> None:
    with pytest.raises(BadInput, match="level_db"):
        Coupling(level_db=level_db)


FINE = Converter(bits=24, range_v=100.0)


def driven(of: Channel, command_v: NDArray[np.float64], load: str | None = None) -> NDArray[np.float64]:
    """Displacement (mm) of a channel without friction, noise and coarse converters."""
    simulation = Simulation(display(replace(of, environment=QUIET, converter=FINE)))
    simulation.touch(0, load)
    return simulation.drive(command_v[:, None]).displacement_mm[:, 0]


def coded(command_v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Commands that the fine converter holds exactly."""
    return np.asarray(np.round(command_v * 2**23 / 100.0) * 100.0 / 2**23)


def forty_digits(system: ContinuousSystem, command: NDArray[np.float64]) -> list[float]:
    """Output of the held plant from its companion matrix, the exponential and the recursion in 40 digits."""
    with mpmath.workdps(40):
        den, num, order = expanded(system.poles)[::-1], expanded(system.zeros)[::-1], system.poles.size
        block = mpmath.zeros(order + 1)
        for i in range(order - 1):
            block[i, i + 1] = 1
        for i in range(order):
            block[order - 1, i] = -den[i]
        block[order - 1, order] = 1
        held = mpmath.expm(block / 4000)
        x, outputs = mpmath.zeros(order + 1, 1), []
        for u in command:
            outputs.append(float(system.gain * mpmath.fsum(c * x[i] for i, c in enumerate(num))))
            x[order] = float(u)
            x = held * x
        return outputs


@settings(max_examples=8)
@given(
    st.lists(st.floats(-2000.0, -2.0), min_size=1, max_size=3),
    st.lists(st.tuples(st.floats(-300.0, -10.0), st.floats(20.0, 3000.0)), min_size=0, max_size=2),
    st.integers(0, 2),
)
def test_plant__any_stable_one__agrees_with_forty_digits(real, pairs, zero_count) -> None:
    poles = np.array([*real, *(complex(re, sign * im) for re, im in pairs for sign in (1, -1))], dtype=complex)
    zeros = -np.array([150.0, 800.0])[: min(zero_count, poles.size - 1)]
    system = ContinuousSystem(zeros, poles, float(np.abs(np.prod(poles)) / np.abs(np.prod(zeros))))
    command = coded(np.random.default_rng(1).standard_normal(60))
    ours = driven(channel(plant=system, loads=(), sensor_gain_v_per_mm=1.0), command)
    assert ours == pytest.approx(forty_digits(system, command), rel=1e-9, abs=1e-13)


@pytest.mark.parametrize("delay_samples", [0.0, 0.25, 2.6, 255.5])
def test_plant__dead_time__shifts_the_response_by_it(delay_samples: float) -> None:
    poles = np.roots([1.0, 94.0, 290.0])
    delayed = channel(plant=ContinuousSystem(np.empty(0), poles, 2875.0, delay_samples / RATE_HZ))
    step = coded(np.ones(1200))
    time_s = np.maximum(np.arange(1200) / RATE_HZ - delay_samples / RATE_HZ, 0.0)
    fast, slow = poles.real
    expected = 2875.0 * (
        1.0 / (fast * slow)
        + np.exp(fast * time_s) / (fast * (fast - slow))
        + np.exp(slow * time_s) / (slow * (slow - fast))
    )
    assert driven(delayed, step) * 0.19898 == pytest.approx(expected * step[0], rel=1e-9, abs=1e-12)


def test_load__put_on_in_motion__position_and_velocity_go_on() -> None:
    of = replace(channel(), environment=QUIET, converter=FINE)
    simulation = Simulation(display(of))
    simulation.drive(coded(3.0 * np.ones(400))[:, None])
    simulation.touch(0, "finger")
    after = simulation.drive(coded(3.0 * np.ones(400))[:, None]).displacement_mm[:, 0]
    load = of.loads[0]

    def motion(_: float, x: NDArray[np.float64], mass: float, damping: float, stiffness: float) -> list[float]:
        force = 2875.0 * coded(np.array([3.0]))[0] / 0.19898
        return [x[1], (force - (94.0 + damping) * x[1] - (290.0 + stiffness) * x[0]) / (1.0 + mass)]

    free = integrate.solve_ivp(motion, (0.0, 0.1), [0.0, 0.0], args=(0.0, 0.0, 0.0), rtol=1e-11, atol=1e-13)
    taken = integrate.solve_ivp(
        motion,
        (0.0, 399 / RATE_HZ),
        free.y[:, -1],
        args=(load.mass, load.damping, load.stiffness),
        t_eval=np.arange(400) / RATE_HZ,
        rtol=1e-11,
        atol=1e-13,
    )
    assert after == pytest.approx(taken.y[0], rel=1e-8)


def test_load__that_raises_the_order__agrees_with_the_loaded_plant_and_is_put_on_smoothly() -> None:
    plant = ContinuousSystem(np.array([-500.0]), np.array([-10.0, -90.0]), 6.0)
    of = channel(plant=plant, loads=(Load("mass", 0.01, 1.0, 10.0),), sensor_gain_v_per_mm=1.0)
    loaded = of.loaded_plant(of.loads[0])
    assert loaded.poles.size == 3
    command = coded(np.random.default_rng(2).standard_normal(300))
    peer = control.c2d(control.ss(control.zpk(loaded.zeros, loaded.poles, loaded.gain)), 1.0 / RATE_HZ, "zoh")
    assert driven(of, command, "mass") == pytest.approx(control.forced_response(peer, U=command).outputs, rel=1e-6)
    simulation = Simulation(display(replace(of, environment=QUIET, converter=FINE)))
    steady = coded(np.ones((8000, 1)))
    before = simulation.drive(steady).displacement_mm[-1, 0]
    simulation.touch(0, "mass")
    assert simulation.drive(steady).displacement_mm[0, 0] == pytest.approx(before, rel=1e-6)


@pytest.mark.parametrize(("quantity", "order"), [("velocity", 1), ("acceleration", 2)])
def test_quantity__other_than_displacement__finger_still_gets_the_displacement(quantity: str, order: int) -> None:
    position = channel()
    zeros = np.zeros(order)
    derived = ContinuousSystem(zeros, position.plant.poles, position.plant.gain)
    command = coded(np.sin(np.arange(800) / 50.0))
    other = channel(plant=derived, quantity=quantity, loads=position.loads)
    assert driven(other, command) == pytest.approx(driven(position, command), rel=1e-9, abs=1e-12)
    assert driven(other, command, "finger") == pytest.approx(driven(position, command, "finger"), rel=1e-9, abs=1e-12)


def test_quantity__velocity_without_a_zero_at_rest__is_integrated() -> None:
    motor = ContinuousSystem(np.empty(0), np.array([-50.0]), 100.0)
    of = channel(plant=motor, quantity="velocity", loads=(), sensor_gain_v_per_mm=2.0)
    time_s, one = np.arange(400) / RATE_HZ, coded(np.ones(400))
    expected = one[0] * (2.0 * time_s - 2.0 * (1.0 - np.exp(-50.0 * time_s)) / 50.0) / 2.0
    assert driven(of, one) == pytest.approx(expected, rel=1e-8, abs=1e-12)


REFUSED = [
    ([-1.0, -2.0], [-3.0], 0.0, 1, "2 zeros and 1 poles; allowed: no more zeros than poles"),
    ([], -np.arange(1.0, 10.0), 0.0, 1, "order 9 here; allowed: 1 to 8"),
    ([-5.0], [-3.0], 0.0, 0, "answers at once and delay_samples is 0"),
    ([], [-3.0], 0.1, 1, "dead time is 400 samples; allowed: below 256"),
]


@pytest.mark.parametrize(("zeros", "poles", "delay_s", "delay_samples", "words"), REFUSED)
def test_simulation__plant_that_it_cannot_hold__is_refused(zeros, poles, delay_s, delay_samples, words) -> None:
    of = channel(plant=ContinuousSystem(np.array(zeros), np.array(poles), 1.0, delay_s), loads=())
    with pytest.raises(BadInput, match=words):
        Simulation(display(of, delay_samples=delay_samples))
