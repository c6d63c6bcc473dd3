"""Actuator configuration files: read as maps, written, and what a clip becomes by one."""

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.patterns.acf import acf_text, read_acf
from tactuator.patterns.clip import Tap
from tests.patterns.formats import ACF


def read(tmp_path, text=ACF):
    path = tmp_path / "a.acf"
    path.write_text(text)
    return read_acf(path)


def test_acf__as_json5__is_the_map_that_it_states(tmp_path) -> None:
    mapping = read(tmp_path)
    assert (mapping.band_hz, mapping.gain, mapping.ducking) == ((55.0, 200.0), 0.8, 0.75)
    assert (mapping.tap_hz, mapping.tap_s) == ((55.0, 165.0), pytest.approx((0.0364, 0.0121)))
    assert (mapping.tap_gain, mapping.tap_fade, mapping.tap_shape) == (1.0, 0.5, ("sine", "square"))


def test_acf__written_and_read__is_the_same_map(tmp_path) -> None:
    mapping = read(tmp_path)
    assert read(tmp_path, acf_text(mapping, "a device", "2026-01-02")) == mapping


def test_acf__square_emphasis__has_the_fundamental_of_a_square_wave(tmp_path) -> None:
    mapping = read(tmp_path)
    time = np.arange(4096) / 4096
    square = np.where(time % 0.125 < 0.0625, 1.0, -1.0)  # eight periods: its line in the spectrum is the eighth
    fundamental = 2.0 * np.abs(np.fft.rfft(square)[8]) / square.size
    sine, sharp = (mapping.tap_amplitude(Tap(0.0, 1.0, pitch), 100.0) for pitch in (0.0, 1.0))
    assert sharp / sine == pytest.approx(fundamental, rel=1e-4)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("gain: .8", "gain: 1.8", "continuous: gain is 1.8; allowed: 0 to 1"),
        ("gain: .8, ", "", "continuous: gain is missing"),
        ("frequency_min: 55,", "frequency_min: 300,", "frequency_max is 200; allowed: 300 or more"),
        ("'sine'", "'round'", "shape is 'round'; allowed: sine, square, triangle, saw"),
        ("duration_ms: 36.4", "duration_ms: 0", "duration_ms is 0"),
        ("fade_out_percent: 50", "fade_out_percent: 150", "fade_out_percent is 150; allowed: 0 to 100"),
        ("emphasis: {", "emphases: {", "emphasis is missing"),
        ("frequency_min: {", "frequency_min: 3, a: {", "frequency_min is 3; allowed: a table"),
        ("gain: .8", "gain: NaN", "it holds NaN"),
        ("{", "{,", "it is not JSON"),
    ],
)
def test_acf__rule_broken__is_refused_with_it(tmp_path, old, new, said) -> None:
    with pytest.raises(BadInput, match=f"a.acf: .*{said}"):
        read(tmp_path, ACF.replace(old, new, 1))
