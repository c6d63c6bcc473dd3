"""Per-channel limits on a reference: comfort, travel and command, untouched and under every load.

Comfort, 55 dB SL at each frequency, is kept in two ways. No sample of the felt signal (the displacement weighted by
the inverse threshold curve with zero phase) exceeds the amplitude of 55 dB SL. And no sample of the reference exceeds
pi/4 of it, less the response's own error: of a signal that stays within +/- A, no sinusoidal component found with any
positive window exceeds 4 A / pi (that of a square wave), so no component exceeds 55 dB SL, whatever the waveform.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.measure.prediction import ChannelPrediction
from tactuator.model.controller import Controller
from tactuator.perception.curve import COMFORT_DB_SL
from tactuator.signals.decibels import from_db

SAFETY_DB = 0.25
"""Kept from every limit for what the linear prediction leaves out: friction, hum, noise, word lengths, memory."""

QUIET_ABOVE_HZ = 320.0
"""Every coding is silent above; see the codings."""

BINDING_SHARE = 0.8
"""A limit that the greatest allowed reference reaches to no more than this share is not looked at again."""

COARSE_STRIDE = 3
"""Predictions of quiet stretches are looked at on every third sample only."""


@dataclass(frozen=True, eq=False)
class Constraint:
    """A limit at every sample: |response applied to the reference| <= limit.

    kind: comfort, travel or command. response: at the bins of a transform of `size` samples. norm: sum of the
    magnitudes of its impulse response as far as a reference that is silent above 320 Hz can tell; ceiling: of |r|,
    below which norm * |r| cannot reach the limit. coarse: the response up to 320 Hz, on the bins of a transform of a
    quarter of the length; beyond: its greatest magnitude above.
    """

    kind: str
    response: ComplexArray
    limit: float
    norm: float
    coarse: NDArray[np.complex64]
    beyond: float

    @property
    def ceiling(self) -> float:
        """Return the reference amplitude that cannot reach the limit, whatever its waveform."""
        return self.limit / self.norm


@dataclass(frozen=True, eq=False)
class ChannelLimits:
    """The constraints of one channel, and the greatest |r| that comfort allows."""

    finger: str
    peak: float
    constraints: tuple[Constraint, ...]

    @property
    def harmless(self) -> float:
        """Return the amplitude below which the samples of a reference cannot reach any limit."""
        return min([self.peak, *(constraint.ceiling for constraint in self.constraints)])

    @cached_property
    def coarse(self) -> NDArray[np.complex64]:
        """Return every constraint's coarse response, shape (constraints, bins): one transform for all is twice as
        quick.
        """
        return np.stack([constraint.coarse for constraint in self.constraints])

    @cached_property
    def beyond(self) -> FloatArray:
        """Return every constraint's greatest response above 320 Hz, shape (constraints,)."""
        return np.array([constraint.beyond for constraint in self.constraints])

    @cached_property
    def limit(self) -> FloatArray:
        """Return every constraint's limit, shape (constraints,)."""
        return np.array([constraint.limit for constraint in self.constraints])


def between_samples(rate_hz: float) -> float:
    """Return the factor by which a signal below 320 Hz can exceed every third sample of it: 1/cos(pi f / rate).

    Source: Ehlich & Zeller 1964, Math. Z. 86, 41-44.
    """
    return float(1.0 / np.cos(np.pi * QUIET_ABOVE_HZ * COARSE_STRIDE / rate_hz))


@lru_cache(maxsize=16)
def channel_limits(controller: Controller, name: str, size: int) -> ChannelLimits:
    """Return the limits of a channel for transforms of `size` samples at the controller's rate."""
    channel, designed = controller.display.channel(name), controller.channel(name).limits
    comfort = float(from_db(min(designed.comfort_db_sl, COMFORT_DB_SL) - SAFETY_DB))
    keep = float(from_db(-SAFETY_DB))
    command_v = keep * min(designed.command_v, channel.converter.range_v) - abs(channel.converter.offset_v)
    frequency = fft.rfftfreq(size, 1.0 / controller.rate_hz)
    heard = frequency <= QUIET_ABOVE_HZ
    constraints, gain = [], 1.0
    for load in (None, *(load.name for load in channel.loads)):
        prediction = ChannelPrediction.of(controller, name, load)
        felt = prediction.felt(frequency)
        gain = max(gain, float(np.abs(felt[heard]).max()))
        for kind, response, limit in (
            ("comfort", felt, comfort),
            ("travel", prediction.displacement(frequency), keep * channel.travel_mm),
            ("command", prediction.command(frequency), command_v),
        ):
            norm = _norm(response, frequency, size)
            coarse = np.where(heard, response, 0.0)[: size // COARSE_STRIDE // 2 + 1].astype(np.complex64)
            constraints.append(Constraint(kind, response, limit, norm, coarse, float(np.abs(response[~heard]).max())))
    peak = 0.25 * np.pi * comfort / gain
    binding = [one for one in constraints if BINDING_SHARE * one.ceiling < peak]
    return ChannelLimits(name, peak, tuple(binding))


def _norm(response: ComplexArray, frequency: FloatArray, size: int) -> float:
    """Return the sum of absolute values of the impulse response after a low-pass that is 1 up to 320 Hz: a quiet
    reference cannot tell the difference.
    """
    fall = np.clip((2.5 * QUIET_ABOVE_HZ - frequency) / (1.5 * QUIET_ABOVE_HZ), 0.0, 1.0)
    kernel = fft.irfft(response * (0.5 - 0.5 * np.cos(np.pi * fall)), size)
    return float(np.abs(kernel).sum())
