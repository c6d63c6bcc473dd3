"""Systems, zero-order hold, bilinear transforms and decibels against closed forms, mpmath, scipy and 50 digits."""

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from scipy import linalg, signal

from tactuator.errors import BadInput
from tactuator.signals.decibels import half_width_db
from tactuator.signals.discretise import bilinear, matrix_exponential, zero_order_hold
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


MOTOR = ContinuousSystem.from_polynomials([2875.0], [1.0, 94.0, 290.0])


def held_reference(frequency_hz: float, rate_hz: float) -> complex:
    """The paper's motor under a zero-order hold by partial fractions, 50 digits."""
    with mpmath.workdps(50):
        root = mpmath.sqrt(47**2 - 290)
        fast, slow = -47 - root, -47 + root
        z, step = mpmath.expjpi(2 * mpmath.mpf(frequency_hz) / rate_hz), 1 / mpmath.mpf(rate_hz)
        value = mpmath.mpc(0)
        for pole, other in ((fast, slow), (slow, fast)):
            held = mpmath.exp(pole * step)
            value += 2875 / (pole - other) * (held - 1) / pole / (z - held)
        return complex(value)


@pytest.mark.parametrize("rate_hz", [4000.0, 64000.0])
def test_zero_order_hold__paper_motor__agrees_with_fifty_digits(rate_hz: float) -> None:
    sampled = zero_order_hold(MOTOR, rate_hz)
    for frequency in (0.1, 0.4, 10.0, 300.0, 1900.0):
        assert sampled.response(frequency) == pytest.approx(held_reference(frequency, rate_hz), rel=1e-9)


@settings(max_examples=50)
@given(
    st.lists(st.floats(-900.0, -1.0), min_size=2, max_size=5),
    st.lists(st.floats(-500.0, -20.0), min_size=0, max_size=2),
)
def test_zero_order_hold__random_plants__step_responses_meet_at_the_samples(poles, zeros) -> None:
    if len(zeros) >= len(poles):
        zeros = zeros[: len(poles) - 1]
    plant = ContinuousSystem(np.array(zeros), np.array(poles), 1000.0)
    sampled = zero_order_hold(plant, 2000.0)
    times = np.arange(200) / 2000.0
    _, exact = signal.step(signal.ZerosPolesGain(plant.zeros, plant.poles, plant.gain).to_ss(), T=times)
    here = signal.sosfilt(sampled.sections(), np.ones(times.size))
    np.testing.assert_allclose(here, exact, rtol=1e-5, atol=1e-7 * np.abs(exact).max())


def test_zero_order_hold__fractional_dead_time__shifts_the_step_response() -> None:
    late = ContinuousSystem(MOTOR.zeros, MOTOR.poles, MOTOR.gain, 2.3 / 4000.0)
    sampled = zero_order_hold(late, 4000.0)
    assert sampled.delay_samples == 2
    times = np.arange(400) / 4000.0
    here = signal.sosfilt(sampled.sections(), np.ones(400))
    slow, fast = sorted(MOTOR.poles.real)
    after = np.maximum(times - 0.3 / 4000.0, 0.0)
    gain = 2875.0 / (slow * fast)
    exact = gain * (1.0 + (fast * np.exp(slow * after) - slow * np.exp(fast * after)) / (slow - fast))
    np.testing.assert_allclose(here, exact, atol=1e-9)


@pytest.mark.parametrize("far", [1e12, 1e40, 1e300])
def test_zero_order_hold__zero_that_is_as_good_as_at_infinity__is_the_motor_without_it(far: float) -> None:
    """Found in a fitted exciter: the zero came out as infinite, and the system was refused."""
    sampled = zero_order_hold(ContinuousSystem([-far], MOTOR.poles, MOTOR.gain / far), 4000.0)
    far_twice = ContinuousSystem([-far, -far], MOTOR.poles, MOTOR.gain / far**2 if far < 1e100 else 0.0)
    for frequency in (0.4, 30.0, 300.0, 1900.0):
        assert sampled.response(frequency) == pytest.approx(held_reference(frequency, 4000.0), rel=1e-8)
        if far_twice.gain:
            twice = zero_order_hold(far_twice, 4000.0).response(frequency)
            assert twice == pytest.approx(held_reference(frequency, 4000.0), rel=1e-7)


def test_bilinear__paper_controller__is_scipys() -> None:
    controller = ContinuousSystem.from_polynomials(12.264 * np.array([1.0, 111.0, 530.0]), [1.0, 260.0, 0.0])
    num, den = signal.bilinear(12.264 * np.array([1.0, 111.0, 530.0]), [1.0, 260.0, 0.0], 4000.0)
    hz = np.array([0.4, 20.0, 300.0, 1500.0])
    _, expected = signal.freqz(num, den, worN=hz, fs=4000.0)
    np.testing.assert_allclose(bilinear(controller, 4000.0).response(hz), expected, rtol=1e-9)


def test_zero_order_hold__gain_alone__stays_a_gain() -> None:
    static = zero_order_hold(ContinuousSystem(np.empty(0), np.empty(0), 3.0, 1.5 / 4000.0), 4000.0)
    assert (static.gain, static.delay_samples) == (3.0, 2)


@settings(max_examples=60)
@given(hnp.arrays(np.float64, st.integers(1, 9).map(lambda n: (n, n)), elements=st.floats(-0.7, 0.7)))
def test_exponential__any_small_matrix__agrees_with_scipy(matrix: NDArray[np.float64]) -> None:
    expected = linalg.expm(matrix)
    assert matrix_exponential(matrix) == pytest.approx(expected, abs=1e-12 * np.max(np.abs(expected)))


def test_exponential__slow_and_fast_together__keeps_the_slow_ones_digits() -> None:
    matrix = np.array([[0.0, 0.02, 0.0], [-0.02, -8.0, 1.0], [0.0, 0.0, 0.0]])
    with mpmath.workdps(40):
        exact = mpmath.expm(mpmath.matrix(matrix.tolist()))
        expected = np.array([[float(exact[i, j]) for j in range(3)] for i in range(3)])
    assert matrix_exponential(matrix) == pytest.approx(expected, rel=1e-13, abs=1e-16)


IMPROPER = ContinuousSystem(np.array([-1.0, -2.0]), np.array([-3.0]), 1.0)


@pytest.mark.parametrize(
    ("transform", "system", "words"),
    [
        (zero_order_hold, IMPROPER, "2 zeros and 1 poles; allowed: no more zeros than poles"),
        (bilinear, IMPROPER, "2 zeros and 1 poles; allowed: no more zeros than poles"),
        (bilinear, ContinuousSystem(MOTOR.zeros, MOTOR.poles, 1.0, 0.5 / 4000.0), r"dead time is 0\.5 samples"),
        (bilinear, ContinuousSystem(np.empty(0), np.array([8000.0]), 1.0), "twice the rate"),
    ],
)
def test_discretise__what_cannot_be_sampled__is_refused(transform, system: ContinuousSystem, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        transform(system, 4000.0)


def test_half_width__of_a_tenth_of_the_magnitude_or_all_of_it__as_a_ratio_or_infinite() -> None:
    assert half_width_db(-2.0j, 0.2) == pytest.approx(0.828, abs=1e-3)
    assert np.isinf(half_width_db([1.0, 0.0, 1e-320, 1.0], [1.0, 0.0, 1.0, np.inf])).all()
