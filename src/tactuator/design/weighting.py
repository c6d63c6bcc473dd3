"""The felt reference: position seen through the minimum-phase inverse of the designed H.

W = 1/|H| over the band, minimum phase; above the band it stays near its value at the band's end, since the sensor's
noise is not to be amplified further. What W gives for y = H r is r again (in threshold units), whatever C and F are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactuator.design.cascade import Sections, cascade
from tactuator.design.family import sampled_plant
from tactuator.design.magnitude_fit import MagnitudeGoal, fit_magnitude
from tactuator.digital.controller import ChannelController
from tactuator.loop.feedback import TwoDegreeLoop
from tactuator.plant.display import Channel, Display
from tactuator.signals.decibels import db

POLES = 4
_RISE_ABOVE_BAND_DB = 6.0


def nominal_loop(display: Display, channel: Channel, controller: ChannelController) -> TwoDegreeLoop:
    """The designed loop of a channel on its sampled plant, untouched."""
    plant = sampled_plant(channel.plant, display.rate_hz, display.delay_samples)
    feedback = controller.feedback(display.rate_hz)
    return TwoDegreeLoop(controller.prefilter(display.rate_hz), feedback, plant)


def weighting_sections(display: Display, channel: Channel, controller: ChannelController, rate_hz: float) -> Sections:
    """W as second-order sections, shape (2, 6), at rate_hz: volts of y to felt threshold units.

    Raises BadInput if no stable filter of that order comes near 1/|H|.
    """
    loop = nominal_loop(display, channel, controller)
    low, high = channel.threshold.band_hz
    frequency = np.geomspace(low, high, 160)
    level: NDArray[np.float64] = -db(np.abs(loop.position_response(frequency)))
    above = np.geomspace(1.02 * high, 0.4998 * rate_hz, 50)
    ceiling = float(np.max(level)) + _RISE_ABOVE_BAND_DB
    none = np.zeros_like(frequency)
    goal = MagnitudeGoal(frequency_hz=frequency, level_db=level, allowance_db=none, above_hz=above, ceiling_db=ceiling)
    return cascade(fit_magnitude(goal, rate_hz, POLES))
