"""Equal velocity at high magnitudes (Griffin 2012) on the example's curve, as contours."""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tactuator.perception.contours import Contours
from tactuator.perception.curve import curve

HERTZ = np.array([2.0, 4.0, 8.0, 16.0, 30.0, 60.0, 100.0, 160.0, 250.0, 300.0])
LEVELS = np.array([10.0, 20.0, 30.0, 40.0, 50.0])


def distance_db(frequency_hz: ArrayLike, level_db_sl: ArrayLike) -> Any:
    """From equal sensation level to equal velocity, dB re 100 Hz; in parts below 20 dB SL, so that 0 is threshold."""
    level = curve("bolanowski-1988").level_db_re_1um_at
    velocity = 20.0 * np.log10(np.asarray(frequency_hz) / 100.0) + level(frequency_hz) - level(100.0)
    return -velocity * np.clip(np.asarray(level_db_sl) / 20.0, 0.0, 1.0)


@cache
def griffin() -> Contours:
    table = LEVELS[:, None] + distance_db(HERTZ, LEVELS[:, None])
    return Contours("griffin", HERTZ, LEVELS, table, provenance="synthetic")
