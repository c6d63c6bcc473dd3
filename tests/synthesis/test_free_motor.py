"""A motor without a spring, as identification finds it from its equation of motion: slow, and of little gain."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from tactuator.errors import NoDesign
from tactuator.model.description import Display, Threshold
from tactuator.model.requirements import FeedbackRequirements
from tactuator.perception.curve import curve
from tactuator.signals.systems import ContinuousSystem
from tactuator.synthesis.design import design_controller
from tests.synthesis.displays import channel

MODELS = tuple(
    ContinuousSystem.from_polynomials([gain], [1.0, damping, 0.0])
    for gain, damping in ((1.5545, 1.0575), (1.5534, 1.0648), (1.5555, 1.0502))
)


def display(noise_gain: float) -> Display:
    """A display to 30 Hz around the motor, for the models that its record does not exclude."""
    limits = FeedbackRequirements(command_noise_gain_max=noise_gain)
    made = channel(plant=MODELS[0], loads=(), sensor_gain_v_per_mm=0.05, feedback=limits)
    made = replace(made, family=MODELS[1:], threshold=Threshold(curve("bolanowski-1988"), (0.4, 30.0)))
    return Display("motor", 4000.0, 1, (made,))


@pytest.mark.slow
def test_design__motor_without_a_spring__finds_a_loop() -> None:
    margins = design_controller(display(3000.0)).channels[0].report["margins"]
    assert margins["phase_margin_deg"] >= 50.0
    assert margins["command_noise_gain"] <= 3000.0


@pytest.mark.soak
def test_design__noise_gain_that_the_motor_cannot_keep__is_told_with_one_that_it_can() -> None:
    with pytest.raises(NoDesign, match="command_noise_gain_max 30") as refused:
        design_controller(display(30.0))
    possible = re.search(r"all others kept: command_noise_gain_max (\S+)", str(refused.value))
    assert possible is not None
    assert design_controller(display(float(possible.group(1)))).channels
