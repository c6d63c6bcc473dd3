"""Loop responses where an integrator makes L infinite."""

import numpy as np
import pytest

from tactuator.signals.discretise import bilinear, zero_order_hold
from tactuator.signals.loop import FeedbackLoop
from tactuator.synthesis import paper

SAMPLED = FeedbackLoop(bilinear(paper.FEEDBACK, 4000.0), zero_order_hold(paper.PLANT, 4000.0))


@pytest.mark.parametrize("loop", [FeedbackLoop(paper.FEEDBACK, paper.PLANT), SAMPLED])
def test_loop__at_zero_frequency_under_an_integrator__follows_and_rejects_exactly(loop: FeedbackLoop) -> None:
    assert loop.complementary(0.0) == pytest.approx(1.0, abs=1e-12)
    assert abs(loop.sensitivity(0.0)) == pytest.approx(0.0, abs=1e-12)
    # the command that holds a volt of position: 290/2875
    assert loop.command_sensitivity(0.0) == pytest.approx(290.0 / 2875.0, rel=1e-9)
    assert abs(loop.load_sensitivity(0.0)) == pytest.approx(0.0, abs=1e-12)


def test_loop__everywhere__sensitivities_add_up_to_one() -> None:
    hertz = np.geomspace(0.01, 1999.0, 50)
    np.testing.assert_allclose(SAMPLED.sensitivity(hertz) + SAMPLED.complementary(hertz), 1.0, rtol=1e-12)
