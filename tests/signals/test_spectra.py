"""Lock-in amplitudes and third octaves against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactuator.errors import BadInput
from tactuator.signals.decibels import db, from_db
from tactuator.signals.excitation import ramps, tone
from tactuator.signals.spectra import lock_in, mains_multiples, off_mains, power_spectrum, third_octave_bands

RATE_HZ = 4000.0


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


def test_db__hand_numbers__are_met() -> None:
    np.testing.assert_allclose(db([1.0, 10.0, -2.0, 1j]), [0.0, 20.0, 6.020599913, 0.0], atol=1e-9)
    assert db(0.0) == -np.inf
    np.testing.assert_allclose(from_db([0.0, 20.0, -6.020599913]), [1.0, 10.0, 0.5], rtol=1e-9)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: lock_in(np.zeros(100), 2000.0, RATE_HZ), "allowed"),
        (lambda: lock_in(np.zeros(4), [10.0, 20.0], RATE_HZ), "samples"),
        (lambda: power_spectrum(np.zeros(100), RATE_HZ, 1.0), "allowed"),
        (lambda: tone(0.0, 1.0, 1.0, RATE_HZ), "allowed"),
        (lambda: tone(9.0, 1.0, 0.0, RATE_HZ), "allowed"),
        (lambda: ramps(10, RATE_HZ, 1.0), "allowed"),
        (lambda: third_octave_bands(0.0, 10.0), "allowed: 0 < low"),
        (lambda: third_octave_bands(-1.0, 10.0), "allowed: 0 < low"),
        (lambda: third_octave_bands(20.0, 10.0), "allowed: 0 < low"),
    ],
)
def test_spectra__impossible__is_refused(call, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        call()
