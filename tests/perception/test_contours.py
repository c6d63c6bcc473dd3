"""Equal-strength contours: interpolation against SciPy's; threshold curves: the library's numbers; refusals."""

from dataclasses import fields

import numpy as np
import pytest
import scipy
from hypothesis import given
from hypothesis import strategies as st

from tactuator.errors import BadInput
from tactuator.perception.contours import Contours
from tactuator.perception.curve import Contact, RelativeCurve, ThresholdCurve, curve, curve_names
from tactuator.plain import plain

HERTZ = np.array([2.0, 8.0, 30.0, 60.0, 100.0, 160.0, 250.0, 300.0])
LEVELS = np.array([10.0, 20.0, 30.0, 45.0])
WAVE = LEVELS[:, None] * (1.0 + 0.2 * np.sin(np.log(HERTZ / 100.0)))
MADE = Contours("made", HERTZ, LEVELS, WAVE, WAVE - 1.0, WAVE + 2.0, provenance="synthetic")


def test_contours__at_their_points__are_given_back() -> None:
    np.testing.assert_allclose(MADE.level_db_sl_at(LEVELS[:, None], HERTZ), WAVE, atol=1e-9)
    assert list(plain(MADE)) == [field.name for field in fields(Contours)]  # what is worked out of them is not written


def test_contours__between_their_points__are_the_monotone_cubic_of_scipy() -> None:
    strength = np.linspace(0.0, 45.0, 91)
    along = scipy.interpolate.PchipInterpolator(np.concatenate(([0.0], LEVELS)), np.concatenate(([0.0], WAVE[:, 2])))
    np.testing.assert_allclose(MADE.level_db_sl_at(strength, 30.0), along(strength), atol=1e-9)
    hertz = np.geomspace(2.0, 300.0, 77)
    across = scipy.interpolate.PchipInterpolator(np.log(HERTZ), WAVE[0])
    np.testing.assert_allclose(MADE.level_db_sl_at(10.0, hertz), across(np.log(hertz)), atol=1e-9)


def test_contours__beyond_their_points__hold_the_distance() -> None:
    top = MADE.level_db_sl_at(45.0, 30.0)
    assert MADE.level_db_sl_at(55.0, 30.0) == pytest.approx(top + 10.0)
    assert MADE.level_db_sl_at(-20.0, 30.0) == pytest.approx(-20.0)
    assert MADE.level_db_sl_at(20.0, [0.0, 2.0]).tolist() == pytest.approx([WAVE[1, 0]] * 2)


@given(
    st.lists(st.floats(0.3, 30.0), min_size=4, max_size=4),
    st.floats(-10.0, 60.0),
    st.floats(0.5, 500.0),
    st.integers(0, 2**32 - 1),
)
def test_contours__any_that_rise__are_monotone(steps, strength, hertz, seed) -> None:
    drawn = np.random.default_rng(seed).uniform(0.3, 30.0, (4, 5))
    drawn[:, 2] = steps
    made = Contours("drawn", [10.0, 30.0, 100.0, 200.0, 300.0], np.cumsum(steps), np.cumsum(drawn, axis=0))
    level = made.level_db_sl_at(strength, hertz)
    assert made.level_db_sl_at(strength + 0.5, hertz) > level


def test_band__at_points_between_and_without_one__is_about_the_contour() -> None:
    low, high = MADE.band_db_sl_at([20.0, 25.0], 45.0)
    centre = MADE.level_db_sl_at([20.0, 25.0], 45.0)
    np.testing.assert_allclose([low - centre, high - centre], [[-1.0, -1.0], [2.0, 2.0]], atol=1e-9)
    assert np.isnan(Contours("bare", HERTZ, LEVELS, WAVE).band_db_sl_at(20.0, 45.0)).all()


@pytest.mark.parametrize(
    ("hertz", "levels", "table", "reference_hz", "words"),
    [
        ([30.0, 100.0], [10.0], [[10.0, 10.0, 1.0]], 100.0, "db_sl is 1 x 3; expected 1 x 2"),
        ([30.0], [10.0], [[10.0]], 100.0, "1 frequencies and 1 contours"),
        ([100.0, 30.0], [10.0], [[10.0, 10.0]], 100.0, "frequencies 100, 30"),
        ([30.0, 100.0], [20.0, 10.0], [[20.0, 20.0], [10.0, 10.0]], 100.0, "strength levels 20, 10"),
        ([30.0, 100.0], [10.0, 20.0], [[12.0, 10.0], [12.0, 20.0]], 100.0, "12 dB SL at 30 Hz on the contour of 20"),
        ([30.0, 100.0], [10.0], [[-1.0, 10.0]], 100.0, "-1 dB SL at 30 Hz"),
        ([30.0, 100.0], [10.0], [[10.0, np.nan]], 100.0, "not a finite number"),
        ([30.0, 100.0], [10.0], [[10.0, 10.0]], 160.0, "reference_hz.*160 Hz; it must be within 30 to 100 Hz"),
        ([30.0, 100.0], [10.0], [[10.0, 12.0]], 100.0, r"\+2.00 dB from the strength level at 100 Hz"),
    ],
)
def test_contours__that_are_none__are_refused(hertz, levels, table, reference_hz, words) -> None:
    with pytest.raises(BadInput, match=words):
        Contours("made", hertz, levels, np.array(table), reference_hz=reference_hz)


def test_contact__where_both_sides_state_it__tells_what_differs() -> None:
    thenar = Contact("thenar", 290.0, "rigid, gap 1 mm", None, (20.0, 30.0))
    tip = Contact("index fingertip", 200.0, "none", 1.0, (25.0, 70.0))
    assert {key for key, *_ in tip.differences(thenar)} == {"site", "surround"}
    assert [*Contact("fingertip").differences(Contact("index fingertip"))] == []
    assert [*Contact().differences(thenar)] == []
    assert [*Contact(area_mm2=7.0).differences(thenar)] == [("area_mm2", "7 mm²", "290 mm²")]


BOLANOWSKI = curve("bolanowski-1988")


def made(frequency: list[float], level: list[float]) -> ThresholdCurve:
    return ThresholdCurve("made", np.array(frequency), np.array(level), "synthetic", "a test")


def test_bolanowski__between_its_points__is_linear_and_held_beyond_them() -> None:
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
        ([1.0, 2.0], [0.0, 0.0], "2 points; expected three or more"),
        ([1.0, 3.0, 2.0], [0.0, 0.0, 0.0], "2 Hz is out of order"),
        ([1.0, 2.0, 2.0], [0.0, 0.0, 0.0], "2 Hz occurs twice"),
        ([-1.0, 2.0, 3.0], [0.0, 0.0, 0.0], "frequency -1 Hz; expected positive"),
        ([1.0, 2.0, 3.0], [0.0, 0.0], "3 frequencies and 2 levels"),
        ([1.0, 2.0, 3.0], [0.0, np.nan, 0.0], "not a finite number"),
    ],
)
def test_curve__not_a_curve__is_refused(frequency: list[float], level: list[float], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        made(frequency, level)


def test_curve__of_unknown_name_or_provenance__is_refused_with_what_is_allowed() -> None:
    with pytest.raises(BadInput, match="'tadoma' is not in the library; expected bolanowski-1988, morioka-griffin"):
        curve("tadoma")
    with pytest.raises(BadInput, match="provenance is 'heard'; it must be \"measured"):
        ThresholdCurve("made", np.arange(1.0, 4.0), np.zeros(3), "heard", "")  # type: ignore[arg-type]
    with pytest.raises(BadInput, match="a level beyond 200 dB"):
        RelativeCurve(np.array([10.0]), np.array([1e300]))
