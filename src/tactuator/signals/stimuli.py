"""Tones as they are played: sinusoids that begin and end without a click."""

from __future__ import annotations

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput


def ramps(count: int, rate_hz: float, ramp_s: float) -> FloatArray:
    """Return a gain of shape (count,) that rises over `ramp_s` as (1 - cos)/2, stays 1, and falls the same way."""
    length = round(ramp_s * rate_hz)
    if ramp_s < 0.0 or 2 * length > count:
        raise BadInput(f"ramps of {ramp_s:g} s in {count / rate_hz:g} s", "zero or more, half the duration at most")
    gain = np.ones(count)
    if length:
        rise = 0.5 - 0.5 * np.cos(np.pi * (np.arange(length) + 0.5) / length)
        gain[:length] = rise
        gain[count - length :] = rise[::-1]
    return gain


def tone(
    frequency_hz: float,
    amplitude: float,
    duration_s: float,
    rate_hz: float,
    *,
    ramp_s: float = 0.0,
    phase_rad: float = 0.0,
) -> FloatArray:
    """Return the sinusoid amplitude * sin(2 pi f t + phase), shape (n,), with ramps at both ends.

    Raises BadInput for a frequency outside 0 < f < rate/2 or a duration of less than one sample.
    """
    if not 0.0 < frequency_hz < rate_hz / 2.0:
        raise BadInput(f"tone of {frequency_hz:g} Hz at {rate_hz:g} Hz", f"between 0 and {rate_hz / 2.0:g} Hz")
    count = round(duration_s * rate_hz)
    if count < 1:
        raise BadInput(f"tone of {duration_s:g} s at {rate_hz:g} Hz", "one sample or more")
    time = np.arange(count) / rate_hz
    wave = amplitude * np.sin(2.0 * np.pi * frequency_hz * time + phase_rad)
    return wave * ramps(count, rate_hz, ramp_s)
