import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from tactuator.errors import BadInput
from tactuator.identification.calibration import fit_line

GAIN = 0.19898
DISPLACEMENT_MM = np.linspace(-12.0, 12.0, 13)


def test_fit_line__paper_gain_with_noise__agrees_with_linregress() -> None:
    rng = np.random.default_rng(3)
    voltage = GAIN * DISPLACEMENT_MM + 0.05 + 1e-3 * rng.standard_normal(13)
    found = fit_line(DISPLACEMENT_MM, voltage)
    line = stats.linregress(DISPLACEMENT_MM, voltage)
    assert found.gain_v_per_mm == pytest.approx(line.slope, rel=1e-12)
    assert found.offset_v == pytest.approx(line.intercept, rel=1e-9)
    assert found.gain_confidence_v_per_mm == pytest.approx(stats.t.isf(0.025, 11) * line.stderr, rel=1e-9)
    assert abs(found.gain_v_per_mm / GAIN - 1.0) < 0.005
    assert found.refused == ()


def test_fit_line__many_calibrations__confidence_covers_95_in_100() -> None:
    rng = np.random.default_rng(4)
    inside = 0
    for _ in range(400):
        found = fit_line(DISPLACEMENT_MM, GAIN * DISPLACEMENT_MM + 2e-3 * rng.standard_normal(13))
        inside += abs(found.gain_v_per_mm - GAIN) < found.gain_confidence_v_per_mm
    assert 0.91 < inside / 400 < 0.985


def test_fit_line__voltmeter_of_few_decimals__says_what_rounding_leaves_unknown() -> None:
    """Nine readings of two decimals often lie on a line of their own: it was told to be known to 0.000000."""
    covered = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        decimals, span = ((2, 5.0), (3, 2.0), (3, 10.0))[seed % 3]
        x = np.round(np.linspace(-span, span, 11) + 0.01 * rng.random(), 2)
        told = fit_line(x, np.round(0.199 * x + 0.03 + 0.01 * rng.random(), decimals))
        covered += abs(told.gain_v_per_mm - 0.199) <= told.gain_confidence_v_per_mm
        assert told.refused == ()
    assert covered >= 57


def test_fit_line__gauge_error__is_taken_out_of_the_slope() -> None:
    rng = np.random.default_rng(5)
    true = np.repeat(np.linspace(-2.0, 2.0, 9), 200)
    read = true + 0.5 * rng.standard_normal(true.size)
    plain = fit_line(read, GAIN * true)
    corrected = fit_line(read, GAIN * true, gauge_error_mm=0.5)
    assert plain.gain_v_per_mm < 0.93 * GAIN
    assert corrected.gain_v_per_mm == pytest.approx(GAIN, rel=0.02)


@settings(max_examples=30, deadline=None)
@given(which=st.integers(0, 12), off=st.sampled_from([-0.5, -0.1, 0.1, 0.5]))
def test_fit_line__one_pair_off__is_refused_by_its_name(which: int, off: float) -> None:
    voltage = GAIN * DISPLACEMENT_MM + 1e-3 * np.random.default_rng(6).standard_normal(13)
    voltage[which] += off
    found = fit_line(DISPLACEMENT_MM, voltage, names=[f"p{k}" for k in range(13)])
    assert [pair.name for pair in found.refused] == [f"p{which}"]
    assert f"p{which}" in str(found.refused[0])
    assert found.gain_v_per_mm == pytest.approx(GAIN, rel=0.005)


@pytest.mark.parametrize(
    ("x", "y", "match"),
    [
        ([1.0, 2.0, 3.0], [1.0, 2.0, 3.0], "4 or more"),
        ([1.0, 2.0, 3.0, np.nan], [1.0, 2.0, 3.0, 4.0], "finite"),
        ([1.0, 1.0, 1.0, 1.0], [1.0, 2.0, 3.0, 4.0], "displacement is the same"),
        ([1.0, 2.0, 3.0, 4.0], [2.0, 2.0, 2.0, 2.0], "voltage is the same"),
        ([1.0, 2.0, 3.0, 4.0], [2.0, 2.0, 2.0], "as many"),
        *(([1.0, 2.0, 3.0, 4.0, n], [1.0, 2.0, 3.0, 4.0, 5.0], "finite numbers up to 1e") for n in (1e200, 1e10)),
        ([0.0, 0.0, 0.0, 1e-300], [1.0, 2.0, 3.0, 4.0], "every displacement is the same"),
        ([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0], [0.0, 1.001, 2.0, 2.999, 4.0, 50.0, -60.0, 70.0], "a quarter"),
    ],
)
def test_fit_line__no_line__is_refused(x, y, match: str) -> None:
    with pytest.raises(BadInput, match=match):
        fit_line(x, y)


@pytest.mark.parametrize("gauge_error_mm", [-1.0, 0.5])
def test_fit_line__gauge_error_that_the_pairs_deny__is_refused(gauge_error_mm: float) -> None:
    voltage = GAIN * DISPLACEMENT_MM + 1e-3 * np.random.default_rng(2).standard_normal(13)
    with pytest.raises(BadInput, match=r"gauge_error_mm is .* by which the pairs scatter"):
        fit_line(DISPLACEMENT_MM, voltage, gauge_error_mm=gauge_error_mm)
