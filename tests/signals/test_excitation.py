"""Signals that excite a mechanism, and multisines."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from tactuator.errors import BadInput
from tactuator.signals import excitation
from tactuator.signals.multisine import multisine, place_lines
from tactuator.signals.systems import ContinuousSystem

RATE_HZ = 4000.0
PAPER = ContinuousSystem.from_polynomials([2875.0], [1.0, 94.0, 290.0])


def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@settings(max_examples=20, deadline=None)
@given(duration_s=st.floats(0.5, 3.0), kind=st.sampled_from(["steps", "prbs", "noise", "chirp"]))
def test_shapes__any_duration__have_their_count_and_a_unit_peak(duration_s: float, kind: str) -> None:
    made = {
        "steps": lambda: excitation.steps(duration_s, RATE_HZ, 0.1, rng()),
        "prbs": lambda: excitation.prbs(duration_s, RATE_HZ, 500.0, rng()),
        "noise": lambda: excitation.noise(duration_s, RATE_HZ, (2.0, 300.0), rng()),
        "chirp": lambda: excitation.log_chirp(duration_s, RATE_HZ, 1.0, 300.0),
    }[kind]()
    assert made.size == round(duration_s * RATE_HZ)
    assert np.max(np.abs(made)) <= 1.0 + 1e-12


def test_noise__band__no_power_outside() -> None:
    made = excitation.noise(4.0, RATE_HZ, (10.0, 100.0), rng())
    power = np.abs(np.fft.rfft(made)) ** 2
    frequency = np.fft.rfftfreq(made.size, 1.0 / RATE_HZ)
    outside = (frequency < 9.0) | (frequency > 101.0)
    # clipping at four standard deviations spills a little
    assert power[outside].sum() < 1e-4 * power.sum()


def test_prbs__two_levels__flat_below_the_clock() -> None:
    made = excitation.prbs(8.0, RATE_HZ, 1000.0, rng())
    assert set(np.unique(made)) == {-1.0, 1.0}
    power = np.abs(np.fft.rfft(made)) ** 2
    low, high = power[80:800].mean(), power[800:2400].mean()
    assert 0.7 < high / low < 1.3


def test_chirp__zero_crossings__as_the_integral_of_its_frequency() -> None:
    made = excitation.log_chirp(10.0, RATE_HZ, 1.0, 100.0)
    crossings = np.count_nonzero(np.diff(np.signbit(made)))
    cycles = 10.0 * 99.0 / np.log(100.0)
    assert crossings == pytest.approx(2.0 * cycles, abs=2)


def test_plan_amplitude__paper_plant__reaches_travel_or_range_and_not_more() -> None:
    shape = excitation.steps(5.0, RATE_HZ, 1.0, rng())
    factor = excitation.plan_amplitude(shape, RATE_HZ, PAPER, 2.4, 10.0)
    position = excitation.periodic_response(np.append(factor * shape, np.zeros(shape.size)), RATE_HZ, PAPER)
    assert np.max(np.abs(position)) == pytest.approx(2.4, rel=1e-6)
    assert excitation.plan_amplitude(shape, RATE_HZ, PAPER, 1e6, 10.0) == pytest.approx(10.0 / np.max(np.abs(shape)))


def test_paper_mix__paper_plant__stays_within_range_and_travel() -> None:
    made = excitation.paper_mix(20.0, RATE_HZ, 10.0, rng(), plant=PAPER, travel_v=2.4)
    position = excitation.periodic_response(np.append(made, np.zeros(made.size)), RATE_HZ, PAPER)
    assert np.max(np.abs(made)) <= 8.0
    assert 0.5 < np.max(np.abs(position)) <= 0.8 * 2.4 * 1.01


def test_known_part__accelerometer__keeps_to_band_travel_and_range() -> None:
    """The travel by SciPy: the mechanism's own displacement, at rest before, in steps of a sample."""
    w, q, drive = 2.0 * np.pi * 80.0, 4.0, 2e4
    plant = ContinuousSystem(np.zeros(2), np.roots([1.0, w / q, w * w]), drive)
    shape = rng().standard_normal(8000)
    for travel, read, range_v in ((0.05, 1e6, 10.0), (50.0, 1e6, 2.0), (50.0, 3e3, 10.0)):
        command = excitation.known_part(shape, RATE_HZ, plant, 2, (10.0, 400.0), (travel, read, range_v))
        lines, place = np.abs(np.fft.rfft(command)), np.fft.rfftfreq(command.size, 1.0 / RATE_HZ)
        assert np.max(lines[(place < 10.0) | (place > 400.0)]) < 1e-9 * np.max(lines)
        t = np.arange(2 * command.size) / RATE_HZ
        _, moved, _ = signal.lsim(([drive], [1.0, w / q, w * w]), np.tile(command, 2), t)
        settled = np.max(np.abs(moved[command.size :]))
        _, sensed, _ = signal.lsim(([drive, 0.0, 0.0], [1.0, w / q, w * w]), np.tile(command, 2), t)
        reached = settled / travel, np.max(np.abs(sensed[command.size :])) / read, np.max(np.abs(command)) / range_v
        assert max(reached) == pytest.approx(1.0, abs=0.02)


PERIOD = 10000


def test_multisine__its_own_spectrum__has_the_lines_and_nothing_else() -> None:
    bins = place_lines(np.geomspace(0.4, 300.0, 30), RATE_HZ, PERIOD)
    made = multisine(RATE_HZ, PERIOD, bins, 0.5, np.random.default_rng(1))
    spectrum = np.fft.rfft(made.one_period()) * 2.0 / PERIOD
    np.testing.assert_allclose(spectrum[bins], 0.5 * np.exp(1j * made.phase_rad), atol=1e-12)
    spectrum[bins] = 0.0
    assert np.max(np.abs(spectrum)) < 1e-12


def test_multisine__clipping_rounds__lower_the_crest_factor() -> None:
    bins = np.arange(1, 121, 2)
    plain = multisine(RATE_HZ, PERIOD, bins, 1.0, np.random.default_rng(2), rounds=1)
    better = multisine(RATE_HZ, PERIOD, bins, 1.0, np.random.default_rng(2), rounds=80)
    periods = plain.one_period(), better.one_period()
    crests = [np.max(np.abs(wave)) / np.sqrt(np.mean(wave**2)) for wave in periods]
    assert crests[1] < 0.85 * crests[0]
    assert crests[1] < 2.2


def test_place_lines__asked_on_mains__moved_two_hertz_off() -> None:
    bins = place_lines([0.4, 60.0, 120.0, 299.9], RATE_HZ, PERIOD)
    frequency = bins * RATE_HZ / PERIOD
    assert np.all(bins % 2 == 1)
    off = np.abs(frequency[1:] - 60.0 * np.round(frequency[1:] / 60.0))
    assert np.all(off >= 2.0 - 1e-9)


def lines(bins):
    return multisine(RATE_HZ, PERIOD, bins, 1.0, rng())


ACCELEROMETER = ContinuousSystem(np.zeros(2), np.roots([1.0, 100.0, 1e5]), 1.0)


@pytest.mark.parametrize(
    "call",
    [
        lambda: excitation.sample_count(0.0, RATE_HZ),
        lambda: excitation.sample_count(float("nan"), RATE_HZ),
        lambda: excitation.noise(1.0, RATE_HZ, (3000.0, 4000.0), rng()),
        lambda: excitation.log_chirp(1.0, RATE_HZ, 0.0, 100.0),
        lambda: excitation.log_chirp(1.0, RATE_HZ, 1.0, 2500.0),
        lambda: excitation.plan_amplitude(np.zeros(10), RATE_HZ, PAPER, 1.0, 1.0),
        lambda: excitation.plan_amplitude(np.ones(10), RATE_HZ, PAPER, -1.0, 1.0),
        lambda: excitation.known_part(np.zeros(100), RATE_HZ, ACCELEROMETER, 2, (10.0, 400.0), (1.0, 1.0, 1.0)),
        *(lambda bins=bins: lines(bins) for bins in ([], [0, 1], [1, 1], [5000])),
    ],
)
def test_excitation__impossible__is_refused(call) -> None:
    with pytest.raises(BadInput, match="allowed"):
        call()
