"""Headroom of a display: the greatest reference, in dB SL, before travel, command or comfort stops it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.model.description import Channel
from tactuator.model.load import DERIVATIVES
from tactuator.signals.decibels import db
from tactuator.signals.loop import TwoDegreeLoop

BINDING = ("travel", "command", "comfort")


@dataclass(frozen=True)
class Headroom:
    """At frequency_hz (n,): the greatest sinusoidal reference in dB SL, and which limit stops it."""

    frequency_hz: FloatArray
    level_db_sl: FloatArray
    binding: tuple[str, ...]

    def document(self) -> dict[str, Any]:
        """Return the headroom as it stands in controller.json."""
        return {
            "frequency_hz": self.frequency_hz.tolist(),
            "level": self.level_db_sl.tolist(),
            "binding": list(self.binding),
        }


def headroom(
    channel: Channel,
    loop: TwoDegreeLoop,
    frequency_hz: FloatArray,
    comfort_db_sl: float,
    answer: ComplexArray | None = None,
) -> Headroom:
    """Return the headroom of the channel's loop at `frequency_hz` (hertz, shape (n,)), for one sinusoid at a time.

    travel: displacement at +/- travel_mm. command: the command at the converter's range less the motor's offset.
    comfort: the felt level at comfort_db_sl. answer: H where something is fed forward besides, (n,); the command
    is then what moves the loop's plant so far.
    """
    moved = loop.position_response(frequency_hz) if answer is None else answer
    position = np.abs(moved)
    speed = (2.0 * np.pi * frequency_hz) ** DERIVATIVES[channel.quantity]
    displacement_mm = position / channel.sensor_gain_v_per_mm / speed
    own = loop.command_response(frequency_hz) if answer is None else moved / loop.plant.response(frequency_hz)
    command = np.abs(own)
    room_v = channel.converter.range_v - abs(channel.converter.offset_v)
    felt_error = db(displacement_mm / channel.threshold.curve.displacement_mm(frequency_hz))
    levels = np.vstack([db(channel.travel_mm / displacement_mm), db(room_v / command), comfort_db_sl - felt_error])
    which = np.argmin(levels, axis=0)
    return Headroom(frequency_hz, levels[which, np.arange(which.size)], tuple(BINDING[i] for i in which))
