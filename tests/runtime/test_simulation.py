"""The simulated display as a whole, and its plant by itself, against python-control, scipy and closed forms."""

from collections.abc import Callable
from dataclasses import replace

import control
import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import integrate

from tactuator.errors import BadInput
from tactuator.model.description import Channel, Converter, Environment
from tactuator.model.plant import Load
from tactuator.runtime.simulation import Simulation
from tactuator.signals.discretise import discretise
from tactuator.signals.loop import FeedbackLoop
from tactuator.signals.systems import ContinuousSystem, SampledSystem, sections_response
from tests.runtime import paper_display
from tests.runtime.paper_display import QUIET, RATE_HZ, channel, controller, display, lock_in, tone
from tests.signals.precisely import expanded

FINE = Converter(bits=24, range_v=100.0)


def loop_response(
    frequency_hz: NDArray[np.float64] | float, delay_samples: int, finger: str = "index"
) -> NDArray[np.complex128]:
    """y/r of the paper's design, from the transfer functions."""
    of = channel(finger)
    plant = discretise(of.plant, RATE_HZ, "zoh").response(frequency_hz)
    c = SampledSystem.from_sections(paper_display.feedback_sections(), RATE_HZ, delay_samples).response(frequency_hz)
    f = sections_response(paper_display.prefilter_sections(float(of.threshold_voltage(0.4))), frequency_hz, RATE_HZ)
    return np.asarray(f * c * plant / (1.0 + c * plant))


@pytest.mark.parametrize("delay_samples", [0, 1, 3])
def test_closed_loop__nothing_disturbs__has_the_response_of_the_transfer_functions(delay_samples: int) -> None:
    of = display(replace(channel(), environment=QUIET, converter=FINE), delay_samples=delay_samples)
    simulation = Simulation(of)
    simulation.load(controller(of, command_v=90.0))
    frequencies = np.array([1.0, 10.0, 40.0, 125.0, 250.0])
    reference = sum(tone(f, 5.0, 30.0) for f in frequencies)
    felt = simulation.play(np.asarray(reference)[:, None]).displacement_mm[12000:, 0]
    measured = np.array([lock_in(felt, f) for f in frequencies]) * 0.19898
    # 3 s are whole periods of each; the lock-in's phase is the cosine's
    turned = measured * 1j * 10.0 ** (-30.0 / 20.0)
    assert turned == pytest.approx(loop_response(frequencies, delay_samples), rel=1e-4)


def test_closed_loop__sensor_noise_or_a_force_alone__is_felt_as_the_loop_says() -> None:
    of = display(replace(channel(), environment=replace(QUIET, noise_v_rms=0.2e-3), converter=FINE))
    simulation = Simulation(of, seed=5)
    simulation.load(controller(of, command_v=90.0))
    loop = FeedbackLoop(
        SampledSystem.from_sections(paper_display.feedback_sections(), RATE_HZ, 1),
        discretise(of.channels[0].plant, RATE_HZ, "zoh"),
    )
    block = simulation.play(np.zeros((400_000, 1)))
    grid = (np.arange(20_000) + 0.5) * RATE_HZ / 40_000
    command_gain = np.sqrt(np.mean(np.abs(loop.command_sensitivity(grid)) ** 2))
    felt_gain = np.sqrt(np.mean(np.abs(loop.complementary(grid)) ** 2))
    assert command_gain == pytest.approx(12.0, abs=0.5)  # facts, section 1
    assert np.std(block.command_v) == pytest.approx(0.2e-3 * command_gain, rel=0.01)
    assert np.std(block.displacement_mm) * 0.19898 == pytest.approx(0.2e-3 * felt_gain, rel=0.05)
    for frequency_hz in (2.0, 100.0):
        push = tone(frequency_hz, 6.0)[:, None]
        felt = simulation.play(np.zeros(push.shape), force_v=push).displacement_mm[16000:, 0]
        expected = abs(loop.load_sensitivity(frequency_hz))
        assert abs(lock_in(felt, frequency_hz)) * 0.19898 == pytest.approx(expected, rel=3e-3)


def felt_error_db(frequency_hz: float, level_db_sl: float, finger: str, load: str | None) -> float:
    """Level at the finger re the design's, whole display, the paper's C and F."""
    of = display(channel(finger))
    simulation = Simulation(of, seed=2)
    simulation.load(controller(of))
    simulation.touch(0, load)
    duration_s = 4.0 + 20.0 / frequency_hz
    felt = simulation.play(tone(frequency_hz, duration_s, level_db_sl)[:, None]).displacement_mm[:, 0]
    periods = felt[-round(20.0 / frequency_hz * RATE_HZ) :]
    expected_mm = abs(loop_response(frequency_hz, 1, finger)) / of.channels[0].sensor_gain_v_per_mm
    return float(20.0 * np.log10(abs(lock_in(periods, frequency_hz)) / expected_mm) - level_db_sl)


def test_display__ten_db_sl_low_frequencies__friction_takes_up_to_0_6_db() -> None:
    errors = [felt_error_db(f, 10.0, "index", None) for f in (2.0, 4.0, 5.0, 8.0, 10.0)]
    assert -0.75 < min(errors) < -0.45  # design.md, "The simulated display": up to -0.6 dB
    assert max(errors) < 0.1


def test_display__thirty_to_fifty_db_sl__errs_by_less_than_0_1_db() -> None:
    for frequency_hz, level_db_sl in ((2.0, 30.0), (8.0, 30.0), (125.0, 30.0), (2.0, 50.0), (25.0, 50.0)):
        assert abs(felt_error_db(frequency_hz, level_db_sl, "index", None)) < 0.1


@pytest.mark.parametrize("finger", ["index", "thumb", "middle"])
def test_display__finger_above_20_hz__takes_one_to_two_db(finger: str) -> None:
    errors = [felt_error_db(f, 30.0, finger, "finger") for f in (25.0, 32.0, 50.0, 100.0, 200.0)]
    assert min(errors) > -2.3
    assert max(errors) < -0.85
    if finger == "thumb":
        assert felt_error_db(25.0, 30.0, "thumb", "finger") == pytest.approx(-2.2, abs=0.15)


def test_display__sensor_spectrum_at_rest__shows_noise_and_hum_as_described() -> None:
    simulation = Simulation(display(channel(converter=Converter(bits=24))), seed=4)
    position = simulation.drive(np.zeros((40_000, 1))).position_v[:, 0]
    lines = [abs(lock_in(position, f)) for f in (60.0, 120.0, 180.0)]
    assert lines == pytest.approx([1.0e-3, 0.3e-3, 0.2e-3], abs=1.5e-5)
    time_s = np.arange(40_000) / RATE_HZ
    hum = sum(a * np.sin(2.0 * np.pi * f * time_s) for f, a in ((60.0, 1e-3), (120.0, 3e-4), (180.0, 2e-4)))
    assert np.std(position - hum) == pytest.approx(0.2e-3, rel=0.02)


def test_saturated__marks_command_and_position_beyond_the_converters() -> None:
    simulation = Simulation(display(channel(travel_mm=100.0)))
    block = simulation.drive(np.concatenate([np.full((3000, 1), 9.0), np.full((10, 1), 11.0), np.zeros((3000, 1))]))
    assert not block.saturated[:10].any()
    assert block.saturated[2900:3010].all()  # 9 V times the motor's 9.9: the sensor is at its rail
    assert not block.saturated[-1].any()
    assert np.max(block.command_v) == 10.0 - 20.0 / 65536
    assert np.max(np.abs(block.position_v)) <= 10.0


@settings(max_examples=8)
@given(st.lists(st.integers(1, 700), min_size=1, max_size=6), st.integers(0, 2**32 - 1))
def test_blocks__however_cut__give_the_same_bits_and_another_seed_gives_others(cuts: list[int], seed: int) -> None:
    of = display()
    reference = 100.0 * np.random.default_rng(seed).standard_normal((sum(cuts), 3))
    whole, pieces = Simulation(of, seed), Simulation(of, seed)
    for simulation in (whole, pieces):
        simulation.load(controller(of))
        simulation.touch(1, "finger")
    rest = np.zeros((1000, 3))
    assert not np.array_equal(*(Simulation(of, each).drive(rest).position_v for each in (seed, seed ^ 1)))
    at_once = whole.play(reference)
    parts = [pieces.play(part) for part in np.split(reference, np.cumsum(cuts)[:-1])]
    for name in ("command_v", "position_v", "displacement_mm", "saturated"):
        assert np.array_equal(getattr(at_once, name), np.concatenate([getattr(part, name) for part in parts]))


def test_unstable_controller__breaks__says_so_and_gives_zero() -> None:
    of = display(channel())
    unstable = controller(of)
    bad = np.array([[1.0, 0.0, 0.0, 1.0, -3.0, 2.0]])
    simulation = Simulation(of)
    simulation.load(replace(unstable, channels=(replace(unstable.channels[0], feedback_sos=bad),)))
    block = simulation.play(np.full((2000, 1), 1.0))
    assert block.broken[-1, 0]
    assert block.command_v[-1, 0] == 0.0


def test_wiring__polarity_and_offset__change_nothing_but_rounding() -> None:
    reference = tone(10.0, 1.0, 30.0)[:, None]
    felt = []
    for converter in (Converter(), Converter(polarity=-1, offset_v=0.731)):
        of = display(channel(converter=converter))
        simulation = Simulation(of, seed=1)
        simulation.load(controller(of))
        felt.append(simulation.play(reference).displacement_mm)
    assert felt[0] == pytest.approx(felt[1], abs=3e-3)


MANY = Environment(hum_hz=tuple(60.0 * i for i in range(1, 10)), hum_v_peak=(1e-3,) * 9)
REFUSED = [
    (lambda: Simulation(display()).play(np.zeros((10, 3))), "no controller is loaded"),
    (lambda: Simulation(display()).load(controller(display(channel()))), "channels index; expected index, thumb, mid"),
    (lambda: Simulation(display()).load(controller(display(rate_hz=8000.0))), "8000 Hz and a delay of 1; expected 400"),
    (lambda: Simulation(display()).drive(np.zeros((10, 3)), np.zeros((9, 3))), "force has 9 samples; expected 10"),
    (lambda: Simulation(display(), -1), "0 to 4294967295"),
    (lambda: Simulation(display(), 2**32), "0 to 4294967295"),
    (lambda: Simulation(display(channel(environment=MANY))), "9 lines of hum; expected at most 8"),
]


@pytest.mark.parametrize(("asked", "words"), REFUSED)
def test_simulation__what_it_cannot_do__is_refused(asked: Callable[[], object], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        asked()


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


def test_load__that_raises_the_order__agrees_with_the_loaded_plant() -> None:
    plant = ContinuousSystem(np.array([-500.0]), np.array([-10.0, -90.0]), 6.0)
    of = channel(plant=plant, loads=(Load("mass", 0.01, 1.0, 10.0, 6.0),), sensor_gain_v_per_mm=1.0)
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


REFUSED_PLANTS = [
    ([], -np.arange(1.0, 10.0), 0.0, 1, "order 9 here; expected 1 to 8"),
    ([-5.0], [-3.0], 0.0, 0, "answers at once and delay_samples is 0"),
    ([], [-3.0], 0.1, 1, "dead time is 400 samples; expected below 256"),
]


@pytest.mark.parametrize(("zeros", "poles", "delay_s", "delay_samples", "words"), REFUSED_PLANTS)
def test_simulation__plant_that_it_cannot_hold__is_refused(zeros, poles, delay_s, delay_samples, words) -> None:
    of = channel(plant=ContinuousSystem(np.array(zeros), np.array(poles), 1.0, delay_s), loads=())
    with pytest.raises(BadInput, match=words):
        Simulation(display(of, delay_samples=delay_samples))
