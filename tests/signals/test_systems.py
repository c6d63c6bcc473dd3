"""Systems against closed forms, mpmath and scipy."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import signal

from tactuator.errors import BadInput
from tactuator.signals.systems import ContinuousSystem, SampledSystem, paired_sections, sections_response
from tests.signals.precisely import level_db

PAPER_PLANT = ContinuousSystem.from_polynomials([2875.0], [1.0, 94.0, 290.0])


@given(st.floats(0.01, 2000.0))
def test_response__paper_plant__is_the_polynomials_ratio(frequency_hz: float) -> None:
    s = 2j * np.pi * frequency_hz
    expected = 2875.0 / (s**2 + 94.0 * s + 290.0)
    assert PAPER_PLANT.response(frequency_hz) == pytest.approx(expected, rel=1e-12)
    late = ContinuousSystem.from_polynomials([2875.0], [1.0, 94.0, 290.0], delay_s=0.001)
    assert late.response(frequency_hz) == pytest.approx(expected * np.exp(-0.001 * s), rel=1e-9)


@pytest.mark.parametrize("rate_hz", [4000.0, 64000.0])
def test_sections_response__low_pass_at_high_rate__agrees_with_fifty_digits(rate_hz: float) -> None:
    sos = np.vstack([signal.butter(2, hz, fs=rate_hz, output="sos") for hz in (0.5, 10.0, 300.0)])
    for frequency in (0.1, 0.4, 3.0, 47.0, 300.0, 1900.0):
        here = 20.0 * np.log10(abs(sections_response(sos, frequency, rate_hz)))
        assert here == pytest.approx(level_db(sos, frequency, rate_hz), abs=1e-6)


@given(st.lists(st.floats(0.1, 0.95), min_size=1, max_size=4), st.floats(0.1, 1999.0))
def test_sampled_response__from_sections__is_sections_response(radii: list[float], frequency_hz: float) -> None:
    sos = np.array([[1.0, 0.4, 0.1, 1.0, -2.0 * r * np.cos(1.0), r * r] for r in radii])
    system = SampledSystem.from_sections(sos, 4000.0)
    assert system.response(frequency_hz) == pytest.approx(sections_response(sos, frequency_hz, 4000.0), rel=1e-9)


def test_sampled_delay__two_samples__is_a_power_of_z() -> None:
    system = SampledSystem(np.empty(0), np.empty(0), 2.0, 4000.0, 2)
    assert system.response(500.0) == pytest.approx(2.0 * np.exp(-2j * np.pi * 2.0 * 500.0 / 4000.0))


def test_series__two_of_a_kind__multiplies_responses() -> None:
    lag = ContinuousSystem.from_polynomials([1.0], [0.01, 1.0])
    frequency = np.array([0.3, 30.0])
    expected = PAPER_PLANT.response(frequency) * lag.response(frequency)
    np.testing.assert_allclose((PAPER_PLANT * lag).response(frequency), expected)


ROOT = st.builds(complex, st.floats(-1.0, 1.0), st.floats(0.01, 1.0))
REAL = st.one_of(st.floats(0.0101, 0.99), st.sampled_from([-1.0, 1.0]))


@given(st.lists(ROOT, max_size=3), st.lists(REAL, max_size=3), st.lists(ROOT, max_size=3), st.lists(REAL, max_size=3))
def test_sections__any_proper_system__are_scipys_to_the_last_bit(zero_pairs, real_zeros, pole_pairs, real_poles):
    zeros = np.array([*zero_pairs, *np.conj(zero_pairs), *real_zeros], dtype=complex)
    poles = np.array([*pole_pairs, *np.conj(pole_pairs), *real_poles], dtype=complex)
    assume(zeros.size <= poles.size and len({abs(root) for root in poles}) >= len(pole_pairs) + len(real_poles))
    distances = np.abs(np.append(zeros[zeros.imag >= 0.0], 0.0)[:, None] - poles[poles.imag >= 0.0])
    assume(all(np.unique(column).size == column.size for column in distances.T))  # of two as near either may be taken
    expected = signal.zpk2sos(zeros, poles, -0.7)
    np.testing.assert_array_equal(paired_sections(zeros, poles, -0.7), expected)


SAMPLED = SampledSystem(np.empty(0), np.empty(0), 1.0, 4000.0)


@pytest.mark.parametrize(
    ("of", "words"),
    [
        (lambda: PAPER_PLANT * SAMPLED, "same kind of time and rate"),
        (lambda: SAMPLED * SampledSystem(np.empty(0), np.empty(0), 1.0, 8000.0), "same kind of time and rate"),
        (lambda: ContinuousSystem.from_polynomials([0.0], [1.0, 1.0]), "num is zero"),
        (lambda: ContinuousSystem.from_polynomials([1.0], [0.0, 0.0]), "den is zero"),
        (lambda: ContinuousSystem.from_polynomials([np.nan], [1.0]), "finite"),
        (lambda: ContinuousSystem.from_polynomials([1.0], [1.0, np.inf]), "finite"),
        (lambda: ContinuousSystem(np.empty(0), np.array([-1.0 + 2.0j]), 1.0), "conjugate pairs"),
        (lambda: SampledSystem(np.array([0.5]), np.empty(0), 1.0, 4000.0).sections(), "no causal sections"),
        (lambda: sections_response(np.ones(6), 10.0, 4000.0), "section"),
        (lambda: sections_response(np.ones((1, 5)), 10.0, 4000.0), "section"),
        (lambda: sections_response(np.array([[1, 0, 0, 0, 0, 0]]), 10.0, 4000.0), "section"),
        (lambda: sections_response(np.full((1, 6), np.nan), 10.0, 4000.0), "section"),
    ],
)
def test_system__that_is_none__is_refused(of, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        of()


def test_is_stable__pole_on_the_border__is_no() -> None:
    assert not ContinuousSystem.from_polynomials([1.0], [1.0, 0.0]).is_stable
    assert not SampledSystem(np.empty(0), np.array([1.0]), 1.0, 4000.0).is_stable
    assert PAPER_PLANT.is_stable
