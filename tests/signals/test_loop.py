"""Loops: responses, stability, margins against the paper's loop (facts, section 1), closed forms and python-control."""

import control
import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactuator.errors import BadInput
from tactuator.signals import loop as module
from tactuator.signals.decibels import db
from tactuator.signals.discretise import bilinear, zero_order_hold
from tactuator.signals.loop import FeedbackLoop, Margins, TwoDegreeLoop, UnstableLoop, is_stable, least_gain, margins
from tactuator.signals.systems import ContinuousSystem, SampledSystem
from tactuator.synthesis import paper
from tests.signals.precisely import expanded

UNITY = ContinuousSystem(np.empty(0), np.empty(0), 1.0)


def sampled_paper_loop(rate_hz: float, delay_samples: int = 1) -> FeedbackLoop:
    return FeedbackLoop(bilinear(paper.FEEDBACK, rate_hz), zero_order_hold(paper.PLANT, rate_hz, delay_samples))


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
        assert "phase margin 55.83 deg" in str(found)
        assert "\n" not in str(found)


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


def test_margins__conditionally_stable_loop_or_no_crossover__gain_may_fall_only_so_far_and_no_phase_margin() -> None:
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
    assert least_gain(zero_order_hold(loop, 4000.0)) == pytest.approx(0.4, rel=1e-6)


def test_margins__dead_time__delay_margin_of_an_integrator() -> None:
    """L = w/s e^(-sT): crossover at w, phase margin 90 degrees less w T, stable for w T < pi/2."""
    omega, dead = 10.0, 0.05
    found = margins(FeedbackLoop(ContinuousSystem([], [0.0], omega, dead), UNITY))
    assert found.phase_margin_deg == pytest.approx(90.0 - np.degrees(omega * dead), abs=1e-6)
    assert found.delay_margin_s == pytest.approx(np.pi / 2.0 / omega - dead, rel=1e-6)
    assert not FeedbackLoop(ContinuousSystem([], [0.0], omega, 0.16), UNITY).is_stable
    assert FeedbackLoop(ContinuousSystem([], [0.0], omega, 0.156), UNITY).is_stable


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
    grid = module.analysis_grid_hz(loop)
    assert np.abs(loop.sensitivity(grid) + loop.complementary(grid) - 1.0).max() < 1e-9
    assert np.abs(loop.sensitivity(grid)).max() <= found.sensitivity_peak * (1.0 + 1e-9)
    promised = np.degrees(2.0 * np.arcsin(0.5 / found.sensitivity_peak))
    assert found.phase_margin_deg >= promised - 1e-6
    assert found.phase_margin_deg >= found.disk.phase_deg - 1e-6
    assert found.gain_margin_db >= found.disk.gain_db - 1e-6


@pytest.mark.parametrize("rate_hz", [1250.0, 40_000.0])
def test_margins__sign_that_only_rounding_tells__is_no_crash(rate_hz: float) -> None:
    """A point of the grid where a function is zero but for rounding, told one way there and another here."""
    found, near = margins(sampled_paper_loop(rate_hz)), margins(sampled_paper_loop(rate_hz * 1.001))
    assert found.phase_margin_deg == pytest.approx(near.phase_margin_deg, abs=0.5)
    assert found.crossover_hz == pytest.approx(near.crossover_hz, rel=0.01)


def paper_loop(rate_hz: float) -> TwoDegreeLoop:
    loop = sampled_paper_loop(rate_hz)
    return TwoDegreeLoop(bilinear(paper.PREFILTER, rate_hz), loop.controller, loop.plant)


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


def exact_roots(zeros: list[complex], poles: list[complex], gain: float) -> np.ndarray:
    """Roots of prod(x - poles) + gain prod(x - zeros) with 60 digits."""
    with mpmath.workdps(60):
        above = [*[0] * (len(poles) - len(zeros)), *expanded(zeros)]
        total = [a + gain * b for a, b in zip(expanded(poles), above, strict=True)]
        return np.array([complex(x) for x in mpmath.polyroots(total[::-1], maxsteps=500, extraprec=400, asc=True)])


@pytest.mark.parametrize("rate_hz", [4e3, 64e3])
def test_closed_poles__paper_loop__60_digits_agree(rate_hz: float) -> None:
    delayed = bilinear(paper.FEEDBACK, rate_hz) * zero_order_hold(paper.PLANT, rate_hz, 1)
    found = np.sort_complex(module.closed_poles(delayed))
    shifted = [complex(z) - 1.0 for z in delayed.zeros], [*(complex(p) - 1.0 for p in delayed.poles), -1.0 + 0j]
    wanted = np.sort_complex(exact_roots(*shifted, delayed.gain))
    for root in wanted:
        assert np.min(np.abs(found - root)) < 1e-9 * abs(root) + 1e-15


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
        (lambda: FeedbackLoop(paper.FEEDBACK, zero_order_hold(paper.PLANT, 4000.0)), "cannot be combined"),
    ],
)
def test_loop__that_cannot_be__refused(of, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        of()
