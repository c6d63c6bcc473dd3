import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.signals.multisine import multisine, place_lines

RATE_HZ, PERIOD = 4000.0, 10000


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


def test_multisine__detection_lines__are_odd_and_even_and_silent() -> None:
    made = multisine(RATE_HZ, PERIOD, [1, 5, 11], 1.0, np.random.default_rng(3))
    assert made.odd_detection.tolist() == [3, 7, 9]
    assert made.even_detection.tolist() == [2, 4, 6, 8, 10]


def test_place_lines__asked_on_mains__moved_two_hertz_off() -> None:
    bins = place_lines([0.4, 60.0, 120.0, 299.9], RATE_HZ, PERIOD)
    frequency = bins * RATE_HZ / PERIOD
    assert np.all(bins % 2 == 1)
    off = np.abs(frequency[1:] - 60.0 * np.round(frequency[1:] / 60.0))
    assert np.all(off >= 2.0 - 1e-9)


@pytest.mark.parametrize("bins", [[], [0, 1], [1, 1], [5000]])
def test_multisine__impossible_lines__are_refused(bins) -> None:
    with pytest.raises(BadInput, match="allowed"):
        multisine(RATE_HZ, PERIOD, bins, 1.0, np.random.default_rng(0))
