"""Prediction of a controller's effect on a reference: responses from r to the command, the displacement and the felt
amplitude.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import ComplexArray
from tactuator.model.controller import Controller
from tactuator.model.description import Channel
from tactuator.model.load import DERIVATIVES
from tactuator.signals.loop import TwoDegreeLoop
from tactuator.signals.systems import ContinuousSystem, SampledSystem
from tactuator.synthesis.family import sampled_plant


@dataclass(frozen=True)
class ChannelPrediction:
    """One channel under a controller, touched by the load of that name (None: untouched).

    moved: from the command to what the sensor shows, integrated as often as it differentiates.
    """

    channel: Channel
    loop: TwoDegreeLoop
    moved: SampledSystem | None

    @classmethod
    def of(cls, controller: Controller, name: str, load: str | None = None) -> ChannelPrediction:
        """Return the prediction for a channel of `controller`. Raises BadInput for a channel or a load that is not
        there.
        """
        channel, designed = controller.display.channel(name), controller.channel(name)
        rate = controller.rate_hz
        loaded = channel.loaded_plant(None if load is None else channel.load(load))
        integrated = _integrated(loaded, DERIVATIVES[channel.quantity])
        plant = sampled_plant(loaded, rate, controller.delay_samples)
        moved = None if integrated is None else sampled_plant(integrated, rate, controller.delay_samples)
        return cls(channel, TwoDegreeLoop(designed.prefilter(rate), designed.feedback(rate), plant), moved)

    def command(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return the volts of command per threshold unit (the computing delay not counted)."""
        return self.loop.command_response(_off_rest(frequency_hz))

    def displacement(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return the millimetres at the finger per threshold unit: what the sensor shows, integrated as often as it
        differentiates.
        """
        frequency = _off_rest(frequency_hz)
        if self.moved is not None:
            volts = self.loop.command_response(frequency) * self.moved.response(frequency)
            return np.asarray(volts / self.channel.sensor_gain_v_per_mm)
        speed = (2j * np.pi * frequency) ** DERIVATIVES[self.channel.quantity]
        return np.asarray(self.loop.position_response(frequency) / self.channel.sensor_gain_v_per_mm / speed)

    def felt(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return the felt amplitude (threshold units) per threshold unit asked: 1 in magnitude where the design is
        exact.

        The threshold curve's weight has zero phase: the phase is that of the displacement.
        """
        return self.displacement(frequency_hz) / self.channel.threshold.curve.displacement_mm(frequency_hz)


def _integrated(plant: ContinuousSystem, times: int) -> ContinuousSystem | None:
    """Return 1/s^times of a plant by taking zeros at s = 0 away; None where it has fewer.

    What an accelerometer shows at a sample cannot be integrated afterwards: below some hertz it is images of the held
    command from above the rate, which move nothing.
    """
    at_rest = np.flatnonzero(plant.zeros == 0.0)
    if times == 0 or at_rest.size < times:
        return None
    return ContinuousSystem(np.delete(plant.zeros, at_rest[:times]), plant.poles, plant.gain, plant.delay_s)


def _off_rest(frequency_hz: ArrayLike) -> NDArray[np.float64]:
    """Return the frequencies with a microhertz in the place of zero, where an integrator's response is infinite over
    infinite.
    """
    return np.maximum(np.asarray(frequency_hz, dtype=np.float64), 1e-6)
