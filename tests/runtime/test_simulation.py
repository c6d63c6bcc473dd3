"""The simulated display as a whole: exactness without disturbances, figures with them, repeatability, refusals."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tactuator.errors import BadInput
from tactuator.model.description import Converter, Environment
from tactuator.runtime.simulation import Simulation
from tactuator.signals.discretise import zero_order_hold
from tactuator.signals.loop import FeedbackLoop
from tactuator.signals.systems import SampledSystem, sections_response
from tests.runtime import paper_display
from tests.runtime.paper_display import QUIET, RATE_HZ, channel, controller, display, lock_in, tone

FINE = Converter(bits=24, range_v=100.0)


def loop_response(
    frequency_hz: NDArray[np.float64] | float, delay_samples: int, finger: str = "index"
) -> NDArray[np.complex128]:
    """y/r of the paper's design, from the transfer functions."""
    of = channel(finger)
    plant = zero_order_hold(of.plant, RATE_HZ).response(frequency_hz)
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


def test_closed_loop__sensor_noise_or_a_force_alone__reaches_command_and_finger_as_the_loop_says() -> None:
    of = display(replace(channel(), environment=replace(QUIET, noise_v_rms=0.2e-3), converter=FINE))
    simulation = Simulation(of, seed=5)
    simulation.load(controller(of, command_v=90.0))
    loop = FeedbackLoop(
        SampledSystem.from_sections(paper_display.feedback_sections(), RATE_HZ, 1),
        zero_order_hold(of.channels[0].plant, RATE_HZ),
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
    (lambda: Simulation(display()).load(controller(display(channel()))), "channels index; allowed: index, thumb, mid"),
    (lambda: Simulation(display()).load(controller(display(rate_hz=8000.0))), "8000 Hz and a delay of 1; allowed: 400"),
    (lambda: Simulation(display()).drive(np.zeros((10, 3)), np.zeros((9, 3))), "force has 9 samples; allowed: 10"),
    (lambda: Simulation(display()).touch(0, "fist"), "load 'fist' is not described; allowed: none, finger"),
    (lambda: Simulation(display(), -1), "allowed: 0 to 4294967295"),
    (lambda: Simulation(display(), 2**32), "allowed: 0 to 4294967295"),
    (lambda: Simulation(display(channel(environment=MANY))), "9 lines of hum; allowed: at most 8"),
]


@pytest.mark.parametrize(("asked", "words"), REFUSED)
def test_simulation__what_it_cannot_do__is_refused(asked: Callable[[], object], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        asked()
