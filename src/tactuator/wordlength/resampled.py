"""A designed controller at another sampling rate: what word length asks of it there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.model.controller import ChannelController, Controller
from tactuator.signals.discretise import bilinear
from tactuator.signals.systems import ContinuousSystem, SampledSystem

_MATCH_HZ = 10.0


def at_rate(controller: Controller, rate_hz: float) -> Controller:
    """Return the same F and C, bilinear, at another rate (their own continuous counterparts, without prewarping).

    The display's delay stays one of samples. Anti-windup gains scale with the period. Raises BadInput for a rate that
    the display cannot have.
    """
    display = replace(controller.display, rate_hz=rate_hz)
    channels = tuple(_channel_at(channel, controller.rate_hz, rate_hz) for channel in controller.channels)
    return Controller(display, channels, controller.tool)


def _channel_at(channel: ChannelController, old_hz: float, new_hz: float) -> ChannelController:
    feedback = channel.feedback_sos
    gains = channel.anti_windup.gains
    ratio = old_hz / new_hz
    return replace(
        channel,
        prefilter_sos=_sections_at(channel.prefilter_sos, old_hz, new_hz),
        feedback_sos=None if feedback is None else _sections_at(feedback, old_hz, new_hz),
        anti_windup=replace(channel.anti_windup, gains=(gains[0] * ratio, gains[1] * ratio**2)),
    )


def _sections_at(sos: FloatArray, old_hz: float, new_hz: float) -> FloatArray:
    """Return the sections at the other rate, each by itself, so that the order (and the integrator's place) stays."""
    return np.stack([_section_at(section, old_hz, new_hz) for section in sos])


def _section_at(section: FloatArray, old_hz: float, new_hz: float) -> FloatArray:
    sampled = SampledSystem.from_sections(section[None, :], old_hz)
    finite = sampled.zeros[np.abs(sampled.zeros + 1.0) > 1e-9]
    zeros = 2.0 * old_hz * (finite - 1.0) / (finite + 1.0)
    poles = 2.0 * old_hz * (sampled.poles - 1.0) / (sampled.poles + 1.0)
    shape = ContinuousSystem(zeros, poles, 1.0)
    before, unit = (system.response(np.array([_MATCH_HZ])) for system in (sampled, bilinear(shape, old_hz)))
    gain = float(np.real(before[0] / unit[0]))
    moved = bilinear(ContinuousSystem(zeros, poles, gain), new_hz)
    row: FloatArray = moved.sections()[0]
    if np.any(poles == 0.0):
        row[4:] = _with_integrator(float(row[5]))
    return row


def _with_integrator(other: float) -> tuple[float, float]:
    """Return a1 and a2 of (z - 1)(z - other): their sum with 1 is exactly 0, else the integrator would leak, or run
    away.
    """
    exact = float(np.ldexp(np.round(np.ldexp(other, 52)), -52))
    return -(1.0 + exact), exact
