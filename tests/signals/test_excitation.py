"""Signals that excite a mechanism, multisines; lock-in amplitudes and third octaves against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from tactuator.errors import BadInput
from tactuator.signals import excitation
from tactuator.signals.excitation import ramps, tone
from tactuator.signals.multisine import multisine, over_the_band, place_lines
from tactuator.signals.spectra import (
    frequency_response,
    lock_in,
    mains_multiples,
    mean_of_blocks,
    mean_over_frequency,
    off_mains,
    power_spectrum,
    third_octave_bands,
)
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


def test_paper_mix__delimited__is_the_mix_between_two_marks_within_the_same_limits() -> None:
    made = excitation.paper_mix(20.4, RATE_HZ, 10.0, rng(), plant=PAPER, travel_v=2.4, delimited=True)
    assert made.size == 81600
    np.testing.assert_array_equal(
        made[800:-800], excitation.paper_mix(20.0, RATE_HZ, 10.0, rng(), plant=PAPER, travel_v=2.4)
    )
    first, last = made[:800].reshape(4, 200), made[-800:]
    np.testing.assert_array_equal(first.ravel(), last)
    assert np.all(first == first[:, :1])
    assert first[0, 0] == -first[1, 0] > 0.0 == first[2, 0] == first[3, 0]
    position = excitation.periodic_response(np.append(made, np.zeros(made.size)), RATE_HZ, PAPER)
    assert np.max(np.abs(position)) <= 2.4


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
    with pytest.raises(BadInput, match="; "):
        call()


@settings(max_examples=25, deadline=None)
@given(hertz=st.floats(5.0, 1900.0), phase=st.floats(-3.0, 3.0), start=st.integers(0, 100000))
def test_lock_in__line_beside_hum_and_drift__is_found_exactly(hertz: float, phase: float, start: int) -> None:
    frequency = np.array([hertz, 60.0 if abs(hertz - 60.0) > 2.0 else 120.0])
    k = np.arange(start, start + 4000)
    angle = 2.0 * np.pi * np.outer(k, frequency) / RATE_HZ
    values = 0.3 * np.cos(angle[:, 0] + phase) + 2.0 * np.cos(angle[:, 1]) + 5.0 + 1e-4 * k
    found = lock_in(values, frequency, RATE_HZ, start=start)
    np.testing.assert_allclose(found, [0.3 * np.exp(1j * phase), 2.0], atol=2e-6)


@given(hertz=st.floats(0.4, 1000.0))
def test_off_mains__any_frequency__keeps_two_hertz_from_multiples(hertz: float) -> None:
    moved = float(off_mains(hertz)[0])
    nearest = 60.0 * max(round(moved / 60.0), 1)
    assert abs(moved - nearest) >= 2.0 - 1e-9
    assert abs(moved - hertz) <= 4.0
    chosen = over_the_band((hertz, hertz + 70.0), 60.0)  # an edge of the band may lie beside mains
    assert np.min(np.abs(chosen - 60.0 * np.maximum(np.round(chosen / 60.0), 1.0))) >= 2.0 - 1e-9
    assert hertz <= chosen.min() <= chosen.max() <= hertz + 70.0 + 1e-9
    assert mains_multiples(None, hertz).size == 0
    assert mains_multiples(60.0, 300.0).tolist() == [60.0, 120.0, 180.0, 240.0, 300.0]


def test_power_spectrum__white_noise__integrates_to_its_variance() -> None:
    values = np.random.default_rng(0).standard_normal(80000)
    spectrum = power_spectrum(values, RATE_HZ, 2.0)
    assert spectrum.power(0.0, 2000.0) == pytest.approx(1.0, rel=0.02)
    assert spectrum.power(100.0, 200.0) == pytest.approx(100.0 / 2000.0, rel=0.05)


def test_power_spectrum__line_left_out__band_keeps_the_rest() -> None:
    rng = np.random.default_rng(1)
    noise = rng.standard_normal(80000)
    hum = 3.0 * np.sin(2.0 * np.pi * 60.0 * np.arange(80000) / RATE_HZ)
    with_hum = power_spectrum(noise + hum, RATE_HZ, 1.0).power(50.0, 70.0, [60.0], 2.0)
    assert with_hum == pytest.approx(20.0 / 2000.0, rel=0.2)


@given(st.floats(0.0, 0.4), st.integers(1, 12), st.integers(0, 5))
def test_mean_over_frequency__any_window__is_the_mean_of_what_lies_in_it(share: float, fewest: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    hertz, values = np.cumsum(rng.uniform(0.5, 2.0, 40)), 10.0 ** rng.uniform(-12.0, 3.0, (2, 40))
    means = mean_over_frequency(values, hertz, hertz[3:30:7], share, fewest)
    for mean, at in zip(means.T, hertz[3:30:7], strict=True):
        inside = np.abs(hertz - at) <= share * at
        if np.sum(inside) >= fewest:
            np.testing.assert_allclose(mean, values[:, inside].mean(axis=1), rtol=1e-12)
        else:
            start = np.flatnonzero(hertz == at)[0] - np.arange(fewest)
            windows = [values[:, first : first + fewest].mean(axis=1) for first in np.clip(start, 0, 40 - fewest)]
            assert any(np.allclose(mean, window, rtol=1e-12) for window in windows)


def test_frequency_response__noise_beside_a_repeated_command__errs_by_its_own_variance() -> None:
    rng = np.random.default_rng(1)
    command = np.tile(rng.standard_normal(4000) + 1j * rng.standard_normal(4000), (4, 1))
    noise = rng.standard_normal((2, 4, 4000))
    value, variance = frequency_response(command, 3.0 * command + noise[0] + 1j * noise[1])
    assert np.mean(np.abs(value - 3.0) ** 2 / variance) == pytest.approx(1.5, rel=0.15)  # F(2, 6)
    amplitude, half_width, rms = mean_of_blocks(1.0 + noise[0] + 1j * noise[1])
    assert np.mean(np.abs(np.abs(amplitude) - 1.0) <= half_width) == pytest.approx(0.95, abs=0.02)
    assert np.mean(rms**2) == pytest.approx(2.0, rel=0.05)


def test_tone__ramps__begin_and_end_in_silence() -> None:
    made = tone(250.0, 2.0, 0.5, RATE_HZ, ramp_s=0.05)
    assert made.size == 2000
    assert abs(made[0]) < 1e-3
    assert np.max(np.abs(made)) == pytest.approx(2.0, rel=1e-3)
    np.testing.assert_allclose(ramps(100, RATE_HZ, 0.01), ramps(100, RATE_HZ, 0.01)[::-1])


NOMINAL = [2, 2.5, 3.15, 4, 5, 6.3, 8, 10, 12.5, 16, 20, 25, 31.5, 40, 50, 63, 80, 100, 125, 160, 200, 250]


def test_third_octave_bands__two_to_250__are_the_nominal_ones_edge_by_edge() -> None:
    bands = third_octave_bands(2.0, 250.0)
    np.testing.assert_allclose([band.centre_hz for band in bands], NOMINAL, rtol=0.02)
    np.testing.assert_allclose([b.high_hz for b in bands[:-1]], [b.low_hz for b in bands[1:]])


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: lock_in(np.zeros(100), 2000.0, RATE_HZ), "; "),
        (lambda: lock_in(np.zeros(4), [10.0, 20.0], RATE_HZ), "samples"),
        (lambda: power_spectrum(np.zeros(100), RATE_HZ, 1.0), "; "),
        (lambda: tone(0.0, 1.0, 1.0, RATE_HZ), "; "),
        (lambda: tone(9.0, 1.0, 0.0, RATE_HZ), "; "),
        (lambda: ramps(10, RATE_HZ, 1.0), "; "),
        (lambda: third_octave_bands(0.0, 10.0), "0 < low"),
        (lambda: third_octave_bands(-1.0, 10.0), "0 < low"),
        (lambda: third_octave_bands(20.0, 10.0), "0 < low"),
    ],
)
def test_spectra__impossible__is_refused(call, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        call()
