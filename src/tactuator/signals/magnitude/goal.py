"""The goal of a magnitude fit: levels wanted, tolerances, and a ceiling above the band."""

from __future__ import annotations

from dataclasses import dataclass

from tactuator.arrays import FloatArray


@dataclass(frozen=True)
class MagnitudeGoal:
    """Goal of a filter's magnitude.

    frequency_hz, level_db: shape (n,), ascending, zero allowed: the level wanted. allowance_db: shape (n,), how far
    beyond the common error each point may be off (0 in the band proper). ceiling_db: the greatest level of the band;
    at above_hz, shape (m,), and at every frequency beyond, no more than what the filter reaches there. floor_db: shape
    (n,), no error is to be lower than this, where that narrows the tolerance by little (0.19 dB of an error of 0.2 dB,
    nothing of one of 0.5 dB or more); None: no floor. falls_above_hz: from the band to here the ceiling is 6 dB higher.
    """

    frequency_hz: FloatArray
    level_db: FloatArray
    allowance_db: FloatArray
    above_hz: FloatArray
    ceiling_db: float
    floor_db: FloatArray | None = None
    falls_above_hz: float = 0.0
