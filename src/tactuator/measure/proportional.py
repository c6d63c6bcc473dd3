"""The paper's probe: a proportional controller whose gain is raised step by step."""

from __future__ import annotations

import numpy as np

from tactuator.errors import BadInput
from tactuator.model.controller import AntiWindup, ChannelController, Controller, Limits
from tactuator.model.description import Channel, Display
from tactuator.signals.loop import FeedbackLoop
from tactuator.synthesis.family import UNLOADED, plant_family


def proportional_controller(display: Display, gain: float) -> Controller:
    """Return the controller u = gain (v - y) on every channel of `display`, v the threshold voltage of the lowest
    frequency times r.

    gain: volts of command per volt of y, positive.
    """
    if not (np.isfinite(gain) and gain > 0.0):
        raise BadInput(f"proportional gain is {gain:g}", "a positive number")
    return Controller(display, tuple(_channel(channel, gain) for channel in display.channels), "proportional probe")


def unstable_channels(controller: Controller, load: str = "none") -> tuple[str, ...]:
    """Return the channels whose loop the display's own models call unstable, without a load or under `load`: loops
    that must not be closed."""
    display = controller.display
    return tuple(
        channel.name
        for own, channel in zip(controller.channels, display.channels, strict=True)
        if not _is_stable(own, channel, display, load)
    )


def _is_stable(own: ChannelController, channel: Channel, display: Display, load: str) -> bool:
    feedback = own.feedback(display.rate_hz)
    if feedback is None:
        return True
    members = plant_family(channel, display.rate_hz, display.delay_samples)
    return all(FeedbackLoop(feedback, one.sampled).is_stable for one in members if one.load in (UNLOADED, load))


def _channel(channel: Channel, gain: float) -> ChannelController:
    voltage = float(channel.threshold_voltage(channel.threshold.band_hz[0]))
    through = np.array([[1.0, 0.0, 0.0, 1.0, 0.0, 0.0]])
    return ChannelController(
        name=channel.name,
        threshold_voltage_dc=voltage,
        prefilter_sos=through * np.array([voltage, 1.0, 1.0, 1.0, 1.0, 1.0]),
        feedback_sos=through * np.array([gain, 1.0, 1.0, 1.0, 1.0, 1.0]),
        anti_windup=AntiWindup(),
        limits=Limits(channel.converter.range_v, channel.sensor_gain_v_per_mm * channel.travel_mm),
        designed_for=(),
        report={"proportional_gain": gain},
    )
