"""The felt reference: position seen through the minimum-phase inverse of the designed H.

H is designed to equal the channel's threshold voltage over the band, so its inverse is known from the display alone:
W = 1/threshold voltage, minimum phase. Above the band it stays near its value at the band's end, since the sensor's
noise is not to be amplified further. What W gives for y = H r is r again (threshold units), whatever C and F are.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.model.description import Channel
from tactuator.signals.decibels import db, from_db
from tactuator.signals.magnitude import MagnitudeGoal, fit_magnitude
from tactuator.synthesis.prefilter.cascade import cascade

POLES = 4
_RISE_ABOVE_BAND_DB = 6.0


def weighting_sections(channel: Channel, rate_hz: float) -> FloatArray:
    """Return W as second-order sections, shape (2, 6), at rate_hz: volts of y to felt threshold units.

    Channels whose sensors differ in gain alone share one fit. Raises BadInput if no stable filter of that order comes
    near it.
    """
    frequency = np.geomspace(*channel.threshold.band_hz, 160)
    level: FloatArray = -db(channel.threshold_voltage(frequency))
    least = float(np.min(level))
    sections = _fitted(tuple(np.round(level - least, 9).tolist()), channel.threshold.band_hz, rate_hz).copy()
    sections[0, :3] *= from_db(least)
    return sections


@lru_cache(maxsize=64)
def _fitted(level_db: tuple[float, ...], band_hz: tuple[float, float], rate_hz: float) -> FloatArray:
    """Return the sections that follow a level over the band, and stay near its greatest value above it."""
    low, high = band_hz
    frequency, level = np.geomspace(low, high, len(level_db)), np.array(level_db)
    goal = MagnitudeGoal(
        frequency_hz=frequency,
        level_db=level,
        allowance_db=np.zeros_like(frequency),
        above_hz=np.geomspace(1.02 * high, 0.4998 * rate_hz, 50),
        ceiling_db=float(np.max(level)) + _RISE_ABOVE_BAND_DB,
    )
    return cascade(fit_magnitude(goal, rate_hz, POLES))
