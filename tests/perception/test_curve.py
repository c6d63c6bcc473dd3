"""Threshold curves: the library's numbers, interpolation, refusals."""

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.perception.curve import RelativeCurve, ThresholdCurve, curve, curve_names

BOLANOWSKI = curve("bolanowski-1988")


def made(frequency: list[float], level: list[float]) -> ThresholdCurve:
    return ThresholdCurve("made", np.array(frequency), np.array(level), "synthetic", "a test")


def test_bolanowski__between_points_of_its_file__is_linear_in_log_frequency_and_held_beyond_them() -> None:
    levels = BOLANOWSKI.level_db_re_1um_at([0.0, 0.1, 0.4, 10.0, 100.0, np.sqrt(100.0 * 150.0), 300.0, 400.0, 2000.0])
    assert levels == pytest.approx([26.0, 26.0, 26.0, 19.0, -4.0, (-4.0 - 10.5) / 2.0, -18.0, -16.0, -16.0])
    # facts: 20-25 uV; -18 dB re 1 um = 0.1259 um, times 0.19898 V/mm
    assert 0.19898 * BOLANOWSKI.displacement_mm(300.0) == pytest.approx(25.05e-6, rel=1e-3)


def test_morioka_griffin__published_acceleration__becomes_peak_displacement() -> None:
    # 0.023 m/s2 rms at 100 Hz: sqrt(2) 0.023 / (2 pi 100)^2 = 8.239e-8 m = -21.68 dB re 1 um, by hand
    assert curve("morioka-griffin-2006").level_db_re_1um_at(100.0) == pytest.approx(-21.682, abs=1e-3)


def test_library__every_curve__tells_its_provenance() -> None:
    assert {curve(name).provenance for name in curve_names()} == {"inferred", "digitised"}
    assert all(curve(name).source for name in curve_names())


@pytest.mark.parametrize(
    ("frequency", "level", "words"),
    [
        ([1.0, 2.0], [0.0, 0.0], "2 points; allowed: three or more"),
        ([1.0, 3.0, 2.0], [0.0, 0.0, 0.0], "2 Hz is out of order"),
        ([1.0, 2.0, 2.0], [0.0, 0.0, 0.0], "2 Hz stands twice"),
        ([-1.0, 2.0, 3.0], [0.0, 0.0, 0.0], "frequency -1 Hz; allowed: positive"),
        ([1.0, 2.0, 3.0], [0.0, 0.0], "3 frequencies and 2 levels"),
        ([1.0, 2.0, 3.0], [0.0, np.nan, 0.0], "not a finite number"),
    ],
)
def test_curve__not_a_curve__is_refused(frequency: list[float], level: list[float], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        made(frequency, level)


def test_curve__of_unknown_name_or_provenance__is_refused_with_what_is_allowed() -> None:
    with pytest.raises(BadInput, match="'tadoma' is not in the library; allowed: bolanowski-1988, morioka-griffin"):
        curve("tadoma")
    with pytest.raises(BadInput, match="provenance is 'heard'; allowed: \"measured"):
        ThresholdCurve("made", np.arange(1.0, 4.0), np.zeros(3), "heard", "")  # type: ignore[arg-type]
    with pytest.raises(BadInput, match="a level beyond 200 dB"):
        RelativeCurve(np.array([10.0]), np.array([1e300]))


def test_content_hash__same_points__is_the_same() -> None:
    first, second = made([1.0, 2.0, 3.0], [3.0, 2.0, 1.0]), made([1.0, 2.0, 3.0], [3.0, 2.0, 1.0])
    assert first == second
    assert first.content_hash != made([1.0, 2.0, 3.0], [3.0, 2.0, 1.5]).content_hash
