"""An equaliser and a display's response for other programs: impulse response, sections, points."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import signal

from tactuator.arrays import FloatArray
from tactuator.measure.prediction import ChannelPrediction
from tactuator.model.controller import ChannelController, Controller
from tactuator.signals.decibels import db

_QUIET, _LONGEST_S, _FADE = 1e-4, 1.0, 0.1
_POINTS = 121


def impulse_response(own: ChannelController, rate_hz: float) -> tuple[FloatArray, float]:
    """Return a channel's equaliser as an impulse response (n,) with a peak of 1, and the volts at that peak for a
    threshold unit; its last tenth is faded out, where it is 80 dB below the peak or a second has gone.
    """
    impulse = np.zeros(round(_LONGEST_S * rate_hz))
    impulse[0] = 1.0
    sections = own.prefilter_sos / own.prefilter_sos[:, 3:4]
    answer = signal.sosfilt(sections, impulse)
    peak = float(np.max(np.abs(answer)))
    end = int(np.flatnonzero(np.abs(answer) > _QUIET * peak)[-1]) + 1
    count = min(impulse.size, max(64, round(end / (1.0 - _FADE))))
    line = np.ones(count)
    fade = max(1, round(_FADE * count))
    line[-fade:] = 0.5 + 0.5 * np.cos(np.pi * np.arange(1, fade + 1) / fade)
    return answer[:count] * line / peak, peak


def equaliser_document(own: ChannelController, rate_hz: float) -> dict[str, Any]:
    """Return a channel's equaliser as second-order sections, b0 b1 b2 a0 a1 a2, with what it maps and its limit."""
    return {
        "channel": own.name,
        "rate_hz": rate_hz,
        "maps": "threshold units (1: 0 dB SL) to volts at the motor",
        "sections": own.prefilter_sos.tolist(),
        "columns": ["b0", "b1", "b2", "a0", "a1", "a2"],
        "command_limit_v": own.limits.command_v,
    }


def response_document(controller: Controller, name: str) -> dict[str, Any]:
    """Return what a channel's model answers over its band: mm at the finger for a volt, and felt level less the level
    asked under the equaliser.
    """
    prediction = ChannelPrediction.of(controller, name)
    low, high = prediction.channel.threshold.band_hz
    frequency = np.geomspace(low, high, _POINTS)
    moved = prediction.displacement(frequency) / prediction.command(frequency)
    return {
        "channel": name,
        "frequency_hz": frequency.tolist(),
        "mm_per_v": np.abs(moved).tolist(),
        "threshold_db_re_1um": db(1e3 * prediction.channel.threshold.curve.displacement_mm(frequency)).tolist(),
        "felt_error_db": db(np.abs(prediction.felt(frequency))).tolist(),
    }
