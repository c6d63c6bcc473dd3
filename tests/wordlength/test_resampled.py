"""A controller at another rate: the same continuous filters, bilinear, integrator and all."""

from dataclasses import replace

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.model.controller import AntiWindup
from tactuator.runtime.coefficients import delta_coefficients
from tactuator.runtime.image import FORMATS, ImageRefusal, build_image, check_image
from tactuator.signals.sections import sections_response
from tactuator.wordlength.bits import at_rate
from tests.runtime.paper_display import channel, controller, display, feedback_sections, prefilter_sections

MADE = controller(display(channel()))
DC = MADE.channels[0].threshold_voltage_dc
HZ = np.geomspace(0.4, 300.0, 40)


@pytest.mark.parametrize("rate_hz", [1200.0, 4000.0, 8000.0, 64_000.0, 250_000.0])
def test_at_rate__papers_filters__are_those_designed_at_that_rate(rate_hz: float) -> None:
    moved = at_rate(MADE, rate_hz).channels[0]
    for found, expected in (
        (moved.prefilter_sos, prefilter_sections(DC, rate_hz)),
        (moved.feedback_sos, feedback_sections(rate_hz)),
    ):
        assert found is not None
        responses = [sections_response(sos, HZ, rate_hz) for sos in (found, expected)]
        np.testing.assert_allclose(*responses, rtol=1e-7)


def test_at_rate__any_rate__the_integrator_is_exact_and_the_core_takes_the_image() -> None:
    for rate_hz in np.linspace(1200.0, 64_000.0, 41):
        moved = at_rate(MADE, float(rate_hz))
        assert moved.channels[0].feedback_sos is not None
        assert delta_coefficients(moved.channels[0].feedback_sos)[-1, 4] == 0.0
        for name in FORMATS:
            image = build_image(moved, name)
            assert check_image(image, float(np.float32(rate_hz)), 1, 1) is ImageRefusal.GOOD


def test_at_rate__anti_windup__acts_at_the_same_speed() -> None:
    wound = replace(MADE, channels=(replace(MADE.channels[0], anti_windup=AntiWindup((0.04, 0.002))),))
    assert at_rate(wound, 8000.0).channels[0].anti_windup.gains == (0.02, 0.0005)


@pytest.mark.parametrize(
    ("rate_hz", "words"),
    [
        (0.0, "rate_hz is 0; allowed: up to 1e"),
        (-4000.0, "rate_hz is -4000; allowed"),
        (float("nan"), "rate_hz is nan; allowed"),
        (float("inf"), "rate_hz is inf; allowed"),
        (1e7, r"rate_hz is 1e\+07; allowed"),
        (700.0, "rate_hz is 700 for a band up to 300 Hz; allowed: 1200 or more"),
    ],
)
def test_at_rate__rate_that_a_display_cannot_have__is_refused(rate_hz: float, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        at_rate(MADE, rate_hz)
