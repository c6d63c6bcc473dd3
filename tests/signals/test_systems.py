"""Systems, their loops, hold and bilinear transforms against closed forms, mpmath, scipy and 50 digits."""

import control
import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from tactuator.errors import BadInput
from tactuator.signals import loop as module
from tactuator.signals.decibels import db
from tactuator.signals.discretise import discretise
from tactuator.signals.loop import FeedbackLoop, TwoDegreeLoop, UnstableLoop, is_stable
from tactuator.signals.loop_figures import LoopFigures, Margins, analysis_grid_hz, least_gain, margins
from tactuator.signals.systems import ContinuousSystem, SampledSystem, sections_response
from tactuator.synthesis import paper
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
def test_discretise__paper_motor__agrees_with_fifty_digits(rate_hz: float) -> None:
    sampled = discretise(MOTOR, rate_hz, "zoh")
    for frequency in (0.1, 0.4, 10.0, 300.0, 1900.0):
        assert sampled.response(frequency) == pytest.approx(held_reference(frequency, rate_hz), rel=1e-9)


@settings(max_examples=50)
@given(
    st.lists(st.floats(-900.0, -1.0), min_size=2, max_size=5),
    st.lists(st.floats(-500.0, -20.0), min_size=0, max_size=2),
)
def test_discretise__random_plants__step_responses_meet_at_the_samples(poles, zeros) -> None:
    if len(zeros) >= len(poles):
        zeros = zeros[: len(poles) - 1]
    plant = ContinuousSystem(np.array(zeros), np.array(poles), 1000.0)
    sampled = discretise(plant, 2000.0, "zoh")
    times = np.arange(200) / 2000.0
    _, exact = signal.step(signal.ZerosPolesGain(plant.zeros, plant.poles, plant.gain).to_ss(), T=times)
    here = signal.sosfilt(sampled.sections(), np.ones(times.size))
    np.testing.assert_allclose(here, exact, rtol=1e-5, atol=1e-7 * np.abs(exact).max())


@pytest.mark.parametrize("seed", range(40))
def test_sections__random_roots__pair_as_scipy_pairs_them(seed: int) -> None:
    rng = np.random.default_rng(seed)

    def roots(count: int) -> list[complex]:
        pairs = [
            rng.uniform(0.3, 1.1) * np.exp(1j * rng.uniform(0.0, np.pi)) for _ in range(rng.integers(count // 2 + 1))
        ]
        real = rng.uniform(-1.0, 1.2, count - 2 * len(pairs)).tolist()
        return [*pairs, *np.conj(pairs), *real]

    poles = rng.integers(1, 9)
    system = SampledSystem(roots(rng.integers(poles + 1)), roots(poles), rng.uniform(-2.0, 2.0), 1000.0)
    expected = signal.zpk2sos(system.zeros, system.poles, system.gain)
    frequency = rng.uniform(1.0, 400.0, 20)
    here = system.sections()
    np.testing.assert_allclose(here[:, 3:], expected[:, 3:], rtol=1e-12, atol=1e-14)
    missing = poles - system.zeros.size  # zeros at the origin are delays of the whole cascade
    late = np.exp(-2j * np.pi * missing * frequency / 1000.0)
    then = sections_response(expected, frequency, 1000.0) * late
    np.testing.assert_allclose(sections_response(here, frequency, 1000.0), then, rtol=1e-9)
    if missing == 0:
        np.testing.assert_allclose(here, expected, rtol=1e-12, atol=1e-14)


def test_discretise__fractional_dead_time__shifts_the_step_response() -> None:
    late = ContinuousSystem(MOTOR.zeros, MOTOR.poles, MOTOR.gain, 2.3 / 4000.0)
    sampled = discretise(late, 4000.0, "zoh")
    assert sampled.delay_samples == 2
    times = np.arange(400) / 4000.0
    here = signal.sosfilt(sampled.sections(), np.ones(400))
    slow, fast = sorted(MOTOR.poles.real)
    after = np.maximum(times - 0.3 / 4000.0, 0.0)
    gain = 2875.0 / (slow * fast)
    exact = gain * (1.0 + (fast * np.exp(slow * after) - slow * np.exp(fast * after)) / (slow - fast))
    np.testing.assert_allclose(here, exact, atol=1e-9)


@pytest.mark.parametrize("far", [1e12, 1e40, 1e300])
def test_discretise__zero_all_but_infinite__is_the_motor_without_it(far: float) -> None:
    """Found in a fitted exciter: the zero came out as infinite, and the system was refused."""
    sampled = discretise(ContinuousSystem([-far], MOTOR.poles, MOTOR.gain / far), 4000.0, "zoh")
    far_twice = ContinuousSystem([-far, -far], MOTOR.poles, MOTOR.gain / far**2 if far < 1e100 else 0.0)
    for frequency in (0.4, 30.0, 300.0, 1900.0):
        assert sampled.response(frequency) == pytest.approx(held_reference(frequency, 4000.0), rel=1e-8)
        if far_twice.gain:
            twice = discretise(far_twice, 4000.0, "zoh").response(frequency)
            assert twice == pytest.approx(held_reference(frequency, 4000.0), rel=1e-7)


def test_bilinear__paper_controller__is_scipys() -> None:
    controller = ContinuousSystem.from_polynomials(12.264 * np.array([1.0, 111.0, 530.0]), [1.0, 260.0, 0.0])
    num, den = signal.bilinear(12.264 * np.array([1.0, 111.0, 530.0]), [1.0, 260.0, 0.0], 4000.0)
    hz = np.array([0.4, 20.0, 300.0, 1500.0])
    _, expected = signal.freqz(num, den, worN=hz, fs=4000.0)
    np.testing.assert_allclose(discretise(controller, 4000.0, "bilinear").response(hz), expected, rtol=1e-9)


def test_discretise__gain_alone__stays_a_gain() -> None:
    static = discretise(ContinuousSystem(np.empty(0), np.empty(0), 3.0, 1.5 / 4000.0), 4000.0, "zoh")
    assert static.response(100.0) == pytest.approx(3.0 * np.exp(-2j * np.pi * 100.0 * 2.0 / 4000.0))


IMPROPER = ContinuousSystem(np.array([-1.0, -2.0]), np.array([-3.0]), 1.0)


@pytest.mark.parametrize(
    ("method", "system", "words"),
    [
        ("zoh", IMPROPER, "2 zeros and 1 poles; expected no more zeros than poles"),
        ("bilinear", IMPROPER, "2 zeros and 1 poles; expected no more zeros than poles"),
        ("bilinear", ContinuousSystem(MOTOR.zeros, MOTOR.poles, 1.0, 0.5 / 4000.0), r"dead time is 0\.5 samples"),
        ("bilinear", ContinuousSystem(np.empty(0), np.array([8000.0]), 1.0), "twice the rate"),
    ],
)
def test_discretise__what_cannot_be_sampled__is_refused(method, system: ContinuousSystem, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        discretise(system, 4000.0, method)


UNITY = ContinuousSystem(np.empty(0), np.empty(0), 1.0)


def sampled_paper_loop(rate_hz: float, delay_samples: int = 1) -> FeedbackLoop:
    return FeedbackLoop(
        discretise(paper.FEEDBACK, rate_hz, "bilinear"), discretise(paper.PLANT, rate_hz, "zoh", delay_samples)
    )


def test_margins__paper_continuous__facts_section_1() -> None:
    found = margins(FeedbackLoop(paper.FEEDBACK, paper.PLANT))
    assert found.crossover_hz == pytest.approx(20.48, abs=0.005)
    assert found.phase_margin_deg == pytest.approx(58.59, abs=0.005)
    assert found.gain_margin_db == np.inf
    assert found.sensitivity_peak == pytest.approx(1.334, abs=0.0005)
    assert found.complementary_peak == pytest.approx(1.067, abs=0.0005)
    assert found.disk.alpha == pytest.approx(1.043, abs=0.0005)
    assert found.disk.gain_db == pytest.approx(10.0, abs=0.05)
    assert found.disk.phase_deg == pytest.approx(55.1, abs=0.05)
    assert found.bandwidth_hz == pytest.approx(32.7, abs=0.05)
    assert found.delay_margin_samples is None


@pytest.mark.parametrize(("rate_hz", "phase_margin_deg"), [(2000, 53.06), (4000, 55.83), (8000, 57.21)])
def test_margins__paper_sampled__facts_section_1(rate_hz: float, phase_margin_deg: float) -> None:
    loop = sampled_paper_loop(rate_hz)
    found = margins(loop)
    assert found.phase_margin_deg == pytest.approx(phase_margin_deg, abs=0.005)
    assert found.crossover_hz == pytest.approx(20.48, abs=0.01)
    if rate_hz == 4000.0:
        assert found.gain_margin_db == pytest.approx(25.4, abs=0.05)
        assert found.sensitivity_peak == pytest.approx(1.4048, abs=0.00005)
        assert found.complementary_peak == pytest.approx(1.10, abs=0.006)
        assert db(loop.complementary([60.0, 120.0, 180.0])) == pytest.approx([-11.95, -24.10, -31.20], abs=0.006)
        assert db(loop.sensitivity([1.0, 5.0, 10.0])) == pytest.approx([-29.08, -13.69, -6.86], abs=0.006)
        assert str(found).startswith("crossover")
        assert "phase margin: 55.83 deg" in str(found)


def test_delay_and_gain_margin__that_much_more__on_the_edge_of_stability() -> None:
    loop = sampled_paper_loop(4000.0)
    spare = margins(loop).delay_margin_samples
    assert sampled_paper_loop(4000.0, 1 + int(np.floor(spare))).is_stable
    assert not sampled_paper_loop(4000.0, 1 + int(np.ceil(spare))).is_stable

    factor = 10.0 ** (margins(loop).gain_margin_db / 20.0)
    c = loop.controller
    for share, stable in ((0.999, True), (1.001, False)):
        stronger = SampledSystem(c.zeros, c.poles, c.gain * factor * share, c.rate_hz)
        assert FeedbackLoop(stronger, loop.plant).is_stable is stable


def test_margins__unstable_loop_that_python_control_gives_margins__refused() -> None:
    """10/(s^3 + s^2 + s): python-control's disk_margins does not look (facts, section 2)."""
    loop = FeedbackLoop(ContinuousSystem.from_polynomials([10.0], [1.0, 1.0, 1.0, 0.0]), UNITY)
    with pytest.raises(UnstableLoop, match="unstable"):
        margins(loop)


def test_margins__conditionally_stable_or_no_crossover__least_gain_or_none() -> None:
    """L = K (s + 1)^2/s^3 is stable for K > 1/2 (Routh): at K = 2 the gain may fall by 12.04 dB, and rise for ever."""
    found = margins(FeedbackLoop(ContinuousSystem([-1.0, -1.0], [0.0, 0.0, 0.0], 2.0), UNITY))
    assert found.gain_reduction_db == pytest.approx(-12.0412, abs=1e-3)
    assert found.gain_margin_db == np.inf
    low = margins(FeedbackLoop(ContinuousSystem([], [-1.0], 0.5), UNITY))
    assert np.isnan(low.crossover_hz)
    assert low.phase_margin_deg == np.inf


@given(
    natural=st.floats(2e-3, 1.0),
    damping=st.floats(0.01, 1.0),
    zeros=st.floats(2e-3, 0.5),
    integrators=st.integers(1, 3),
    delay=st.integers(0, 2),
    crossover=st.floats(2e-3, 0.05),
)
def test_least_gain__any_stable_loop__is_where_roots_leave_the_circle(
    natural: float, damping: float, zeros: float, integrators: int, delay: int, crossover: float
) -> None:
    """Against the closed poles at 60 gains, and just above and below the least gain itself."""
    pair = np.exp(natural * (-damping + 1j * np.array([1.0, -1.0]) * np.sqrt(1.0 - damping**2)))
    unit = SampledSystem([np.exp(-zeros)] * 2, [*pair, *[1.0] * integrators], 1.0, 1.0, delay)
    loop = SampledSystem(unit.zeros, unit.poles, 1.0 / abs(complex(unit.response(crossover))), 1.0, delay)

    def is_stable_at(gain: float) -> bool:
        return is_stable(SampledSystem(loop.zeros, loop.poles, loop.gain * gain, 1.0, delay))

    if not is_stable(loop):
        return
    least = least_gain(loop)
    assert all(is_stable_at(gain) for gain in np.geomspace(max(1.001 * least, 1e-4), 1.0, 60))
    if least > 1e-4:
        assert not is_stable_at(0.999 * least)


def test_least_gain__plant_that_falls_over__is_the_gain_that_holds_it() -> None:
    """L(0) = -2.5 of g / (s^2 - a^2) with a lead: below 0.4 of its gain the spring wins."""
    loop = ContinuousSystem([-20.0], [10.0, -10.0, -400.0], 2.5 * 100.0 * 400.0 / 20.0)
    assert least_gain(loop) == pytest.approx(0.4)
    assert least_gain(discretise(loop, 4000.0, "zoh")) == pytest.approx(0.4, rel=1e-6)


@given(damping=st.floats(0.02, 1.5), corner=st.floats(2.0, 400.0), gain=st.floats(0.1, 5.0))
def test_margins__random_second_order_loop__python_control_agrees(damping: float, corner: float, gain: float) -> None:
    num, den = [gain * corner**2], [1.0, 2.0 * damping * corner, corner**2]
    loop = FeedbackLoop(ContinuousSystem.from_polynomials(num, [*den, 0.0]), UNITY)
    if not loop.is_stable:
        assert np.max(np.roots(np.polyadd([*den, 0.0], num)).real) > -1e-9 * corner
        return
    found = margins(loop)
    gain_margin, phase_margin, *_ = control.margin(control.tf(num, [*den, 0.0]))
    assert 10.0 ** (found.gain_margin_db / 20.0) == pytest.approx(gain_margin, rel=1e-6)
    assert found.phase_margin_deg <= phase_margin + 1e-6
    _identities(loop, found)


def _identities(loop: FeedbackLoop, found: Margins) -> None:
    """S + T = 1; classical margins are at least what max|S| and the disk promise (Seiler et al. 2020)."""
    grid = analysis_grid_hz(loop)
    assert np.abs(loop.sensitivity(grid) + loop.complementary(grid) - 1.0).max() < 1e-9
    assert np.abs(loop.sensitivity(grid)).max() <= found.sensitivity_peak * (1.0 + 1e-9)
    promised = np.degrees(2.0 * np.arcsin(0.5 / found.sensitivity_peak))
    assert found.phase_margin_deg >= promised - 1e-6
    assert found.phase_margin_deg >= found.disk.phase_deg - 1e-6
    assert found.gain_margin_db >= found.disk.gain_db - 1e-6


def test_loop_figures__paper_loops_on_a_grid__are_the_refined_ones() -> None:
    loops = [
        FeedbackLoop(discretise(paper.FEEDBACK, rate, "bilinear"), discretise(paper.PLANT, rate, "zoh", 1))
        for rate in (4e3, 8e3, 20e3)
    ]
    figures = LoopFigures(np.array([loop.open_response(np.geomspace(1e-3, 0.4999 * 4e3, 4000)) for loop in loops]))
    refined = [margins(loop) for loop in loops]
    assert figures.sensitivity_peak == pytest.approx([each.sensitivity_peak for each in refined], rel=1e-4)
    assert figures.phase_margin_deg()[0] == pytest.approx([each.phase_margin_deg for each in refined], abs=0.01)
    assert figures.turned == pytest.approx([0.5 * np.pi] * len(loops), abs=0.05)  # one pole at rest, and stable
    assert LoopFigures(40.0 * figures.loop).turned[0] < -np.pi  # beyond its gain margin


def paper_loop(rate_hz: float) -> TwoDegreeLoop:
    loop = sampled_paper_loop(rate_hz)
    return TwoDegreeLoop(discretise(paper.PREFILTER, rate_hz, "bilinear"), loop.controller, loop.plant)


def test_position_response__paper__facts_sections_1_and_2() -> None:
    """python-control gives -80.8 dB at 10 Hz (4 kHz) and -65.3 dB at 60 Hz (8 kHz), where polynomials lose all digits;
    the true values are about -6.0 and -20.0 (with the sample of delay |T| is 0.1 dB more)."""
    assert db(paper_loop(4000.0).position_response(10.0)) == pytest.approx(-6.0, abs=0.2)
    assert db(paper_loop(8000.0).position_response(60.0)) == pytest.approx(-20.0, abs=0.2)
    loop = TwoDegreeLoop(paper.PREFILTER, paper.FEEDBACK, paper.PLANT)
    frequency = [1, 2, 5, 10, 20, 30, 50, 100, 150, 200, 250, 300, 400]
    wanted = [0.32, 0.41, -1.91, -5.94, -9.45, -11.57, -17.33, -28.73, -36.59, -42.68, -47.68, -51.92, -58.86]
    level = db(loop.position_response(frequency)) - db(loop.position_response(1e-6))
    assert level == pytest.approx(wanted, abs=0.006)


def test_responses__hold_together() -> None:
    loop = paper_loop(4000.0)
    f = np.geomspace(0.1, 1900.0, 50)
    plant = loop.plant.response(f)
    assert np.allclose(loop.command_response(f) * plant, loop.position_response(f), rtol=1e-12)
    assert np.allclose(loop.feedback.load_sensitivity(f), plant * loop.feedback.sensitivity(f), rtol=1e-12)
    alone = TwoDegreeLoop(loop.prefilter, None, loop.plant)
    assert alone.feedback is None
    assert np.allclose(alone.position_response(f), plant * loop.prefilter.response(f))
    assert np.allclose(alone.command_response(f), loop.prefilter.response(f))


@pytest.mark.parametrize("loop", [FeedbackLoop(paper.FEEDBACK, paper.PLANT), sampled_paper_loop(4000.0, 0)])
def test_loop__at_zero_frequency_under_an_integrator__follows_and_rejects_exactly(loop: FeedbackLoop) -> None:
    assert loop.complementary(0.0) == pytest.approx(1.0, abs=1e-12)
    assert abs(loop.sensitivity(0.0)) == pytest.approx(0.0, abs=1e-12)
    # the command that holds a volt of position: 290/2875
    assert loop.command_sensitivity(0.0) == pytest.approx(290.0 / 2875.0, rel=1e-9)
    assert abs(loop.load_sensitivity(0.0)) == pytest.approx(0.0, abs=1e-12)


def test_is_stable__hidden_unstable_cancellation__not_stable() -> None:
    """A controller that cancels an unstable pole leaves it in the loop."""
    assert not is_stable(ContinuousSystem([2.0], [0.0], 1.0) * ContinuousSystem([], [2.0, -3.0], 5.0))


def test_is_stable__dead_time__as_the_closed_form_says() -> None:
    """e^(-sT) k/(s + 1), k = 2: stable while T < arccos(-1/k)/sqrt(k^2 - 1) = 1.2092 s; k e^(-sT)/(s - 1): 0.6046 s."""
    assert is_stable(ContinuousSystem([], [-1.0], 2.0, 1.20))
    assert not is_stable(ContinuousSystem([], [-1.0], 2.0, 1.22))
    assert is_stable(ContinuousSystem([], [-1.0], 0.9, 50.0))
    assert is_stable(ContinuousSystem([], [1.0], 2.0, 0.60))
    assert not is_stable(ContinuousSystem([], [1.0], 2.0, 0.61))


@pytest.mark.parametrize(
    ("of", "words"),
    [
        (lambda: module.closed_poles(ContinuousSystem([], [-1.0], 1.0, 0.1)), "dead time"),
        (
            lambda: module.closed_roots(np.array([-1.0 + 0j, -2.0]), np.array([-3.0 + 0j]), 1.0),
            "no more zeros than poles",
        ),
        (lambda: module.closed_roots(np.array([-1.0 + 0j]), np.array([-3.0 + 0j]), -1.0), "direct gain"),
        (lambda: is_stable(ContinuousSystem([-1.0], [-2.0], 0.5, 0.1)), "strictly proper"),
        (lambda: FeedbackLoop(paper.FEEDBACK, discretise(paper.PLANT, 4000.0, "zoh")), "cannot be combined"),
    ],
)
def test_loop__that_cannot_be__refused(of, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        of()
