"""The paper's own design as printed: P, C and F of its sections 3 and 4, for its channel, the index finger."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

import tactuator as tt
from tactuator.api.designed import ControllerResult
from tactuator.model.description import Display

CHANNEL = "index"
PREFILTER_NUM = 565.49 * np.array([1.0, 199.81, 17923.0, 1.786e5])
PREFILTER_DEN = np.array([1.0, 1420.0, 336711.0, 1.12e7, 1.01e8])
"""F(s), of unit gain at rest, in descending powers."""
POLES = PREFILTER_DEN.size - 1


def printed_controller(display: Display) -> ControllerResult:
    """Return C and F as printed, both transformed bilinearly, on every channel of `display`: no finger is fed forward.

    F has unit gain at rest: 0 dB SL is put at the curve's level at its lowest frequency.
    """
    channels = tuple(
        replace(
            channel,
            feedback=replace(channel.feedback, structure="paper"),
            prefilter=replace(channel.prefilter, poles=POLES),
        )
        for channel in display.channels
    )
    designed = tt.design(replace(display, channels=channels, touch=replace(display.touch, adaptive=False)))
    roots = scipy.signal.tf2zpk(PREFILTER_NUM, PREFILTER_DEN)
    sections = scipy.signal.zpk2sos(*scipy.signal.bilinear_zpk(*roots, display.rate_hz))
    parts = []
    for part, channel in zip(designed.channels, display.channels, strict=True):
        scaled = sections.copy()
        scaled[0, :3] *= channel.threshold_voltage(channel.threshold.curve.frequency_hz[:1])
        parts.append(replace(part, prefilter_sos=scaled))
    return ControllerResult.of(replace(designed, channels=tuple(parts)))
