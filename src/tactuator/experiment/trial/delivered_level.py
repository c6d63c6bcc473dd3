"""The level that the display delivered, by its sensor, relative to the level that was commanded.

Above FRICTION_HZ a display's gain does not depend on the level, so all stimuli of a run contribute, the loudest most.
Below it friction makes the gain depend on the level, and only stimuli near threshold contribute.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.signals.decibels import from_db

FRICTION_HZ = 25.0
_NEAR_THRESHOLD_DB = 4.0
_LARGEST_SD_DB = 3.0


@dataclass(frozen=True)
class DeliveredLevel:
    """Gain of the display in a run.

    offset_db: level at the sensor above the commanded level. sd_db: its standard deviation. Both NaN where noise hides
    it.
    """

    offset_db: float
    sd_db: float


def delivered_level(
    commanded_db_sl: FloatArray,
    measured_db_sl: FloatArray,
    frequency_hz: float,
    level_db_sl: float,
    near_db: float = _NEAR_THRESHOLD_DB,
) -> DeliveredLevel:
    """Estimate the display's gain at a frequency from intervals played there.

    commanded_db_sl (NaN in blank intervals), measured_db_sl: (intervals,). level_db_sl: the threshold; near_db: how
    near to it a stimulus must be below FRICTION_HZ. The power at the sensor is g^2 c + b (c: commanded; b: hum and
    noise, from the blank intervals) with the variance b^2 + 2 g^2 c b of a sinusoid in noise; g^2 is its weighted
    least-squares estimate. Where the powers scatter more than that, the standard deviation grows with them.
    """
    known = np.isfinite(measured_db_sl)
    blank = known & np.isnan(commanded_db_sl)
    played = known & np.isfinite(commanded_db_sl)
    if frequency_hz < FRICTION_HZ:
        with np.errstate(invalid="ignore"):
            played &= np.abs(commanded_db_sl - level_db_sl) <= near_db
    nothing = DeliveredLevel(float("nan"), float("nan"))
    if not played.any():
        return nothing
    hum = from_db(measured_db_sl[blank]) ** 2
    base, base_sd = (float(hum.mean()), float(hum.std() / np.sqrt(hum.size))) if hum.size else (0.0, 0.0)
    signal = from_db(commanded_db_sl[played]) ** 2
    seen = from_db(measured_db_sl[played]) ** 2 - base
    gain = max(float(seen.sum() / signal.sum()), 1e-3)
    for _ in range(3):
        weight = 1.0 / (base**2 + 2.0 * gain * signal * base + 1e-6 * (gain * signal) ** 2)
        gain = max(float(np.sum(weight * signal * seen) / np.sum(weight * signal**2)), 1e-9)
    scatter = 1.0 / np.sum(weight * signal**2) + (base_sd * np.sum(weight * signal) / np.sum(weight * signal**2)) ** 2
    excess = float(np.sum(weight * (seen - gain * signal) ** 2)) / max(signal.size - 1, 1)
    sd_db = float(10.0 / np.log(10.0) * np.sqrt(scatter * max(excess, 1.0)) / gain)
    if not sd_db <= _LARGEST_SD_DB:
        return nothing
    return DeliveredLevel(float(10.0 * np.log10(gain)), sd_db)
