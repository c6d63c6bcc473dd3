"""A measured frequency response of one channel: values, confidence, and under which circumstances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.signals.decibels import db

Method = Literal["stepped-sine", "multisine"]


@dataclass(frozen=True, eq=False)
class Response:
    """Arrays of shape (m,), frequencies ascending.

    amplitude_v: complex peak volts of y, phase against the reference. confidence_db: 95 % half-width of the magnitude.
    noise_v, distortion_v: peak volts at that frequency of what does not repeat and of what repeats but is not
    linear. saturated: a converter's or the command's limit was reached during that point. reached: the confidence asked
    for was reached in the time allowed. averaged_s: seconds averaged. reference: peak, threshold units (m,).
    """

    channel: str
    load: str
    level_db_sl: float
    method: Method
    frequency_hz: FloatArray
    amplitude_v: ComplexArray
    reference: FloatArray
    confidence_db: FloatArray
    noise_v: FloatArray
    distortion_v: FloatArray
    saturated: NDArray[np.bool_]
    reached: NDArray[np.bool_]
    averaged_s: FloatArray
    controller_hash: str = ""

    def __post_init__(self) -> None:
        shape = self.frequency_hz.shape
        for name in ("amplitude_v", "reference", "confidence_db", "noise_v", "distortion_v", "saturated", "reached"):
            if getattr(self, name).shape != shape:
                raise BadInput(f"response: {name} has shape {getattr(self, name).shape}", f"{shape}")

    @property
    def magnitude_v(self) -> FloatArray:
        """Return the peak of y in volts, (m,)."""
        return np.abs(self.amplitude_v)

    @property
    def magnitude_db(self) -> FloatArray:
        """Return the magnitude in dB of volts of y per threshold unit, (m,)."""
        return db(self.amplitude_v / self.reference)

    @property
    def phase_rad(self) -> FloatArray:
        """Return the phase against the reference, unwrapped from the lowest frequency up, (m,)."""
        return np.unwrap(np.angle(self.amplitude_v))

    @property
    def latency_s(self) -> FloatArray:
        """Return the phase delay in seconds: how much later than the reference a peak of y comes, (m,)."""
        return np.asarray(-self.phase_rad / (2.0 * np.pi * self.frequency_hz))

    @property
    def phase_confidence_rad(self) -> FloatArray:
        """Return the 95 % half-width of the phase, (m,): the noise is alike in both quadratures."""
        return np.minimum(10.0 ** (self.confidence_db / 20.0) - 1.0, np.pi)
