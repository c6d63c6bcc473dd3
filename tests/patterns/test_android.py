"""What Android 16 makes of an intensity on a device, held to the published formula on the profile of its own unit test.

Profile and thresholds: Android Open Source Project, `BasicToPwleSegmentAdapterTest`, `BasicToPwleSegmentAdapter`. The
oracle has the thresholds on either side of the frequencies that are asked for, and its own interpolation.
"""

import math
from itertools import pairwise

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.patterns.android import FrequencyProfile, profile_text, read_profile, threshold_db_g
from tactuator.patterns.rendering import android_map
from tactuator.perception.curve import curve

HERTZ = [90.0, 120.0, 150.0, 60.0, 30.0, 210.0, 270.0, 300.0, 240.0, 180.0]
GS = [1.2, 1.8, 2.4, 0.6, 0.1, 2.2, 1.0, 0.5, 1.9, 3.0]
BESIDE = {  # threshold at a frequency, or at the two beside it
    30: [(30.0, -34.31)], 60: [(60.0, -31.77)], 90: [(90.0, -31.73)], 120: [(103.68, -31.77), (124.42, -31.70)],
    135: [(124.42, -31.70), (149.3, -31.38)], 150: [(150.0, -31.35)], 180: [(179.16, -31.02), (200.0, -30.86)],
    210: [(200.0, -30.86), (215.0, -30.35)], 240: [(215.0, -30.35), (250.0, -28.98)],
    270: [(258.0, -28.68), (300.0, -26.81)], 300: [(300.0, -26.81)],
}  # fmt: skip


@pytest.fixture
def profile(tmp_path):
    path = tmp_path / "phone.csv"
    rows = "".join(f"{hertz},{g}\n" for hertz, g in zip(HERTZ, GS, strict=True))
    path.write_text("frequency_hz,acceleration_g\n" + rows)
    return read_profile(path)


def between(points, hertz):
    if len(points) == 1:
        return points[0][1]
    (f, a), (g, b) = points
    return a + (b - a) * (hertz - f) / (g - f)


def greatest_g(hertz):
    known = sorted(zip(HERTZ, GS, strict=True))
    pair = next(((p, q) for p, q in pairwise(known) if p[0] <= hertz <= q[0]))
    return between(pair, hertz)


def test_intensity__on_the_published_profile__becomes_the_published_amplitude(profile) -> None:
    """amplitude = min(1, 10^((I SLmax + thr)/20) / FOAM), SLmax = 20 log10(3.0) - thr(180 Hz), within 0.1 %."""
    full = 20.0 * math.log10(3.0) - between(BESIDE[180], 180.0)
    assert profile.full_db_sl == pytest.approx(full, abs=1e-9)
    assert full == pytest.approx(40.6, abs=0.05)
    for intensity in (0.0, 0.05, 0.25, 0.5, 0.75, 0.9, 1.0):
        for hertz, points in BESIDE.items():
            wanted_g = 10.0 ** ((intensity * full + between(points, hertz)) / 20.0)
            amplitude = min(1.0, wanted_g / greatest_g(hertz)) if intensity else 0.0
            assert float(profile.amplitude(intensity, hertz)) == pytest.approx(amplitude, rel=1e-3)


@pytest.mark.parametrize(
    ("intensity", "hertz", "missing_db"), [(1.0, 30.0, 26.0), (1.0, 60.0, 13.0), (1.0, 300.0, 20.0), (0.5, 30.0, 6.0)]
)
def test_intensity__of_1__falls_short_where_the_device_is_weak(profile, intensity, hertz, missing_db) -> None:
    missing = intensity * profile.full_db_sl - float(profile.headroom_db_sl(hertz))
    assert missing == pytest.approx(missing_db, abs=0.5)


def test_profile__as_the_unit_test_has_it__spreads_sharpness_from_30_to_300_hz(profile) -> None:
    assert profile.band_hz == (30.0, 300.0)
    asked = android_map(profile, "android-basic")
    assert (asked.strength, asked.band_hz, asked.full_db_sl) == ("level", (30.0, 300.0), profile.full_db_sl)


def test_profile__weak_at_its_ends__has_the_band_between() -> None:
    """The platform's test of a device that is too weak below and above: the band begins and ends between points."""
    profile = FrequencyProfile(np.array([50.0, 100.0, 200.0, 300.0]), np.array([0.01, 1.0, 1.0, 0.01]))
    low, high = profile.band_hz
    assert 50.0 < low < 100.0
    assert 200.0 < high < 300.0
    assert low == pytest.approx(50.0 + 50.0 * (10.0 ** ((10.0 - 31.90) / 20.0) - 0.01) / 0.99, abs=1e-9)


def test_profile__too_weak_everywhere__is_refused() -> None:
    weak = FrequencyProfile(np.array([50.0, 100.0]), np.array([0.01, 0.02]))
    with pytest.raises(BadInput, match="dB SL at most; allowed: 10 dB SL somewhere"):
        android_map(weak, "android-basic")


def test_threshold__of_the_platform__is_our_curve_as_an_acceleration() -> None:
    hertz = np.array([0.4, 3.0, 10.0, 30.0, 60.0, 100.0, 200.0, 300.0, 400.0])
    peak_g = curve("bolanowski-1988").displacement_mm(hertz) * 1e-3 * (2.0 * np.pi * hertz) ** 2 / 9.80665
    np.testing.assert_allclose(threshold_db_g(hertz), 20.0 * np.log10(peak_g), atol=0.02)


def test_profile__written_and_read__is_the_same(tmp_path, profile) -> None:
    (tmp_path / "b.csv").write_text(profile_text(profile, ["of a phone"]))
    np.testing.assert_allclose(read_profile(tmp_path / "b.csv").acceleration_g, profile.acceleration_g, rtol=1e-5)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("frequency_hz,g\n1,2\n3,4\n", "columns frequency_hz, g; allowed: frequency_hz and acceleration_g"),
        ("frequency_hz,acceleration_g\n1,2\n", "1 frequencies"),
        ("frequency_hz,acceleration_g\n1,2\n1,3\n", "not in order"),
        ("frequency_hz,acceleration_g\n1,2\n2,0\n", "an acceleration of 0 g"),
        ("frequency_hz,acceleration_g\n1,2\n2,x\n", "a cell that is no number"),
        ("", "columns nothing"),
    ],
)
def test_profile__that_is_none__is_refused_with_the_reason(tmp_path, text, said) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(BadInput, match=f"a.csv: .*{said}"):
        read_profile(tmp_path / "a.csv")
