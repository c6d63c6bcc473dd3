"""Levels as a person feels them: dB SL, dB re 1 um (peak), and volts of a sensor."""

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.perception.curve import ThresholdCurve
from tactuator.signals.decibels import db, from_db

COMFORT_DB_SL = 55.0
"""The greatest comfortable level: 50-55 dB above threshold (Verrillo & Gescheider 1992, the paper's reference 7)."""
LOWEST_DB_SL = -60.0
"""The least level that may be asked for: far below what is felt and what a sensor can tell from its noise. Below some
-6500 dB SL an amplitude is zero in double precision, and a ratio to it is no number."""


def check_level(level_db_sl: float) -> None:
    """Raise BadInput for a level that is not from LOWEST_DB_SL to COMFORT_DB_SL."""
    if not LOWEST_DB_SL <= level_db_sl <= COMFORT_DB_SL:
        most = f"{COMFORT_DB_SL:g} dB SL, which is still comfortable"
        raise BadInput(f"level (--level) of {level_db_sl:g} dB SL", f"{LOWEST_DB_SL:g} to {most}")


def displacement_mm(level_db_sl: ArrayLike, frequency_hz: ArrayLike, curve: ThresholdCurve) -> FloatArray:
    """Return the peak displacement (mm) of a sinusoid at `level_db_sl`; arguments broadcast."""
    return from_db(level_db_sl) * curve.displacement_mm(frequency_hz)


def level_db_sl(peak_displacement_mm: ArrayLike, frequency_hz: ArrayLike, curve: ThresholdCurve) -> FloatArray:
    """Return the sensation level (dB SL) of a sinusoid of that peak displacement; arguments broadcast."""
    return db(np.asarray(peak_displacement_mm) / curve.displacement_mm(frequency_hz))


def sensor_volts(
    level_db_sl: ArrayLike, frequency_hz: ArrayLike, curve: ThresholdCurve, sensor_gain_v_per_mm: float
) -> FloatArray:
    """Return the peak sensor voltage (V) of a sinusoid at `level_db_sl`; arguments broadcast."""
    return sensor_gain_v_per_mm * displacement_mm(level_db_sl, frequency_hz, curve)
