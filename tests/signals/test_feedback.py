"""Loop responses against each other and against the sampled truth that naive arithmetic misses."""

import numpy as np
import pytest

from tactuator.signals.discretise import bilinear, zero_order_hold
from tactuator.signals.loop import FeedbackLoop, TwoDegreeLoop, UnstableLoop
from tactuator.signals.systems import ContinuousSystem, SampledSystem
from tactuator.synthesis import paper


def paper_loop(rate_hz: float) -> TwoDegreeLoop:
    delay = SampledSystem(np.empty(0), np.empty(0), 1.0, rate_hz, 1)
    plant = zero_order_hold(paper.PLANT, rate_hz) * delay
    return TwoDegreeLoop(bilinear(paper.PREFILTER, rate_hz), bilinear(paper.FEEDBACK, rate_hz), plant)


def test_position_response__where_polynomials_lose_all_digits__is_right() -> None:
    """facts, section 2: python-control gives -80.8 dB at 10 Hz (4 kHz) and -65.3 dB at 60 Hz (8 kHz); the true values
    are about -6.0 and -20.0 (with the sample of delay |T| is 0.1 dB more)."""
    at_10 = 20.0 * np.log10(abs(paper_loop(4000.0).position_response(10.0)))
    at_60 = 20.0 * np.log10(abs(paper_loop(8000.0).position_response(60.0)))
    assert at_10 == pytest.approx(-6.0, abs=0.2)
    assert at_60 == pytest.approx(-20.0, abs=0.2)


def test_position_response__paper_continuous__facts_section_1() -> None:
    loop = TwoDegreeLoop(paper.PREFILTER, paper.FEEDBACK, paper.PLANT)
    frequency = [1, 2, 5, 10, 20, 30, 50, 100, 150, 200, 250, 300, 400]
    wanted = [0.32, 0.41, -1.91, -5.94, -9.45, -11.57, -17.33, -28.73, -36.59, -42.68, -47.68, -51.92, -58.86]
    level = 20.0 * np.log10(np.abs(loop.position_response(frequency)) / abs(loop.position_response(1e-6)))
    assert level == pytest.approx(wanted, abs=0.006)


def test_responses__hold_together() -> None:
    loop = paper_loop(4000.0)
    assert loop.feedback is not None
    f = np.geomspace(0.1, 1900.0, 50)
    plant = loop.plant.response(f)
    assert np.allclose(loop.command_response(f) * plant, loop.position_response(f), rtol=1e-12)
    assert np.allclose(loop.feedback.load_sensitivity(f), plant * loop.feedback.sensitivity(f), rtol=1e-12)


def test_open_loop_display__prefilter_ahead_of_the_plant() -> None:
    plant, prefilter = ContinuousSystem([], [-5.0], 5.0), ContinuousSystem([-5.0], [-50.0], 10.0)
    loop = TwoDegreeLoop(prefilter, None, plant)
    assert loop.feedback is None
    assert np.allclose(loop.position_response(3.0), plant.response(3.0) * prefilter.response(3.0))
    assert np.allclose(loop.command_response(3.0), prefilter.response(3.0))


def test_require_stable__unstable__says_so() -> None:
    loop = FeedbackLoop(ContinuousSystem([], [0.0, -1.0, -1.0], 10.0), ContinuousSystem([], [], 1.0))
    with pytest.raises(UnstableLoop, match="unstable"):
        loop.require_stable()
