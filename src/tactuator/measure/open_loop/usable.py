"""The band over which an actuator without loop can be used at a level, and what ends it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.description import Channel
from tactuator.model.load import DERIVATIVES
from tactuator.signals.decibels import db
from tactuator.signals.systems import ContinuousSystem

RANGE_SHARE, TRAVEL_SHARE = 0.9, 0.9
_GRID = 600


@dataclass(frozen=True, eq=False)
class UsableBand:
    """Band of one channel. band_hz: where `level_db_sl` can be reached; frequency_hz, reach_db_sl: (n,), the greatest
    level by command and travel; ends: what binds at either end: "asked", "command" or "travel".
    """

    band_hz: tuple[float, float]
    level_db_sl: float
    frequency_hz: FloatArray
    reach_db_sl: FloatArray
    ends: tuple[str, str]


def usable_band(
    channel: Channel, plant: ContinuousSystem, asked_hz: tuple[float, float], level_db_sl: float
) -> UsableBand:
    """Return the widest band (in octaves) within `asked_hz` in which a tone at level_db_sl needs at most 0.9 of the
    range and of the travel, by `plant`. Raises BadInput where there is none of half an octave.
    """
    frequency = np.geomspace(*asked_hz, _GRID)
    threshold_mm = channel.threshold.curve.displacement_mm(frequency)
    speed = (2.0 * np.pi * frequency) ** DERIVATIVES[channel.quantity]
    mm_for_volt = np.abs(plant.response(frequency)) / channel.sensor_gain_v_per_mm / speed
    by_command = db(RANGE_SHARE * channel.converter.range_v * mm_for_volt / threshold_mm)
    by_travel = db(TRAVEL_SHARE * channel.travel_mm / threshold_mm)
    reach = np.minimum(by_command, by_travel)
    enough = np.concatenate([[False], reach >= level_db_sl, [False]])
    edges = np.flatnonzero(enough[1:] != enough[:-1])
    stretches = [(first, last - 1) for first, last in list(pairwise(edges))[::2]]
    if not stretches:
        raise BadInput(
            f"channel {channel.name!r} reaches {float(np.max(reach)):.1f} dB SL at most",
            f"a lower level than {level_db_sl:g} dB SL, or more volts",
        )
    first, last = (int(index) for index in max(stretches, key=lambda ends: ends[1] - ends[0]))
    if frequency[last] < np.sqrt(2.0) * frequency[first]:
        raise BadInput(
            f"channel {channel.name!r} reaches {level_db_sl:g} dB SL from {frequency[first]:.4g} to "
            f"{frequency[last]:.4g} Hz only",
            "half an octave or more (a lower level, or more volts)",
        )

    def end(index: int, outermost: int) -> str:
        if index == outermost:
            return "asked"
        return "command" if by_command[index] <= by_travel[index] else "travel"

    ends = (end(first, 0), end(last, _GRID - 1))
    return UsableBand((float(frequency[first]), float(frequency[last])), level_db_sl, frequency, reach, ends)
