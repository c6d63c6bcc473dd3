"""Prediction of a controller's effect on a reference: responses from r to the command, the displacement and the felt
amplitude.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import ComplexArray
from tactuator.display.controller import Controller
from tactuator.display.description import Channel
from tactuator.display.load import DERIVATIVES
from tactuator.loop.feedback import TwoDegreeLoop
from tactuator.signals.discretise import zero_order_hold
from tactuator.signals.systems import SampledSystem


@dataclass(frozen=True)
class ChannelPrediction:
    """One channel under a controller, touched by the load of that name (None: untouched)."""

    channel: Channel
    loop: TwoDegreeLoop

    @classmethod
    def of(cls, controller: Controller, name: str, load: str | None = None) -> ChannelPrediction:
        """Return the prediction for a channel of `controller`. Raises BadInput for a channel or a load that is not
        there.
        """
        channel, designed = controller.display.channel(name), controller.channel(name)
        rate = controller.rate_hz
        held = zero_order_hold(channel.loaded_plant(None if load is None else channel.load(load)), rate)
        delay = held.delay_samples + controller.delay_samples
        plant = SampledSystem(held.zeros, held.poles, held.gain, rate, delay)
        return cls(channel, TwoDegreeLoop(designed.prefilter(rate), designed.feedback(rate), plant))

    def command(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return the volts of command per threshold unit (the computing delay not counted)."""
        return self.loop.command_response(_off_rest(frequency_hz))

    def displacement(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return the millimetres at the finger per threshold unit: what the sensor shows, integrated as often as it
        differentiates.
        """
        frequency = _off_rest(frequency_hz)
        speed = (2j * np.pi * frequency) ** DERIVATIVES[self.channel.quantity]
        return np.asarray(self.loop.position_response(frequency) / self.channel.sensor_gain_v_per_mm / speed)

    def felt(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return the felt amplitude (threshold units) per threshold unit asked: 1 in magnitude where the design is
        exact.

        The threshold curve's weight has zero phase: the phase is that of the displacement.
        """
        return self.displacement(frequency_hz) / self.channel.threshold.curve.displacement_mm(frequency_hz)


def _off_rest(frequency_hz: ArrayLike) -> NDArray[np.float64]:
    """Return the frequencies with a microhertz in the place of zero, where an integrator's response is infinite over
    infinite.
    """
    return np.maximum(np.asarray(frequency_hz, dtype=np.float64), 1e-6)
