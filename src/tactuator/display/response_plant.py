"""A plant from its frequency response by itself, for a channel without a loop: only its magnitude is equalised.

The system is stable and of least phase, of the fewest poles whose magnitude keeps to every point within what the points
are sure of; beyond the last point it falls. How well it does between them is found by leaving one in four out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.signals.decibels import db
from tactuator.signals.frequency_response import FrequencyResponse
from tactuator.signals.magnitude.fit import fit_within
from tactuator.signals.magnitude.goal import MagnitudeGoal
from tactuator.signals.systems import ContinuousSystem

ORDERS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 16)
_CLOSE_DB, _DEVIATIONS = 0.1, 3.0
_RATE_OVER_TOP = 400.0
"""The sampled fit's rate over the last frequency: so high that the bilinear transform bends nothing."""
_FALLS_AT, _FALL_POLES = 4.0, 4
"""Beyond the last point nothing is known: so steep a fall that no image of the converter's adds to a notch."""
_BETWEEN_DB = 1.0
_TURNS = 4
_WITHIN = (1.0, 1.5, 2.5, 5.0, 10.0, 25.0)
"""Errors that are tried, in terms of what the points are sure of."""


@dataclass(frozen=True)
class ResponsePlant:
    """A plant of a response. error_db: the greatest error at points that were left out, beyond twice their own standard
    error. valid_hz: first and last frequency of the response."""

    system: ContinuousSystem
    error_db: float
    valid_hz: tuple[float, float]


def plant_of_response(given: FrequencyResponse) -> ResponsePlant:
    """Return the plant of a response's magnitudes; a phase, where there is one, is not used.

    Raises BadInput where the magnitudes cannot be followed at all.
    """
    own_db = 8.686 * given.deviation
    close_db = max(_CLOSE_DB, _DEVIATIONS * float(np.median(own_db)))
    room_db = np.maximum(0.0, _DEVIATIONS * own_db - close_db)
    room_db[[0, -1]] = 0.0
    frequency, level = given.frequency_hz, db(given.magnitude)
    orders = [order for order in ORDERS if order <= max(2, frequency.size // 3)]
    for within_db in close_db * np.array(_WITHIN):
        for order in orders:
            system = _followed(frequency, level, room_db, order, float(within_db))
            if system is not None:
                left_out_db = _left_out_db(frequency, level, room_db, order, close_db, own_db)
                return ResponsePlant(system, left_out_db, (float(frequency[0]), float(frequency[-1])))
    raise BadInput(
        f"no stable system of up to {orders[-1]} poles follows the magnitude within {close_db * _WITHIN[-1]:.3g} dB; "
        "allowed: more points where it turns sharply"
    )


def _left_out_db(
    frequency_hz: FloatArray, level_db: FloatArray, room_db: FloatArray, order: int, close_db: float, own_db: FloatArray
) -> float:
    """Return the greatest error at points that the fit has not seen (one in four, in turn), beyond their own; where
    nothing follows the others, all that the level changes.
    """
    worst = 0.0
    for first in range(1, _TURNS + 1):
        left_out = np.zeros(frequency_hz.size, dtype=bool)
        left_out[first:-1:_TURNS] = True
        kept = ~left_out
        fits = (
            _followed(frequency_hz[kept], level_db[kept], room_db[kept], order, times * close_db) for times in _WITHIN
        )
        system = next((one for one in fits if one is not None), None)
        if system is None:
            return float(np.ptp(level_db))
        off_db = np.abs(db(np.abs(system.response(frequency_hz[left_out]))) - level_db[left_out])
        worst = max(worst, float(np.max(off_db - 2.0 * own_db[left_out])))
    return worst


def _followed(
    frequency_hz: FloatArray, level_db: FloatArray, room_db: FloatArray, order: int, within_db: float
) -> ContinuousSystem | None:
    """Return a stable system of least phase, of `order` poles and a fall above, within the error at every point (with
    more room at those that are less sure), or None.
    """
    top = float(frequency_hz[-1])
    corner = 2.0 * np.pi * _FALLS_AT * top
    fall = ContinuousSystem(np.empty(0), np.full(_FALL_POLES, -corner), corner**_FALL_POLES)
    level = level_db - db(np.abs(fall.response(frequency_hz)))
    between = np.sqrt(frequency_hz[1:] * frequency_hz[:-1])
    places = np.append(frequency_hz, between)
    room = np.append(room_db, _BETWEEN_DB + 0.5 * np.abs(np.diff(level)))
    ascending = np.argsort(places, kind="stable")
    goal = MagnitudeGoal(
        frequency_hz=places[ascending],
        level_db=np.append(level, 0.5 * (level[1:] + level[:-1]))[ascending],
        allowance_db=room[ascending],
        above_hz=np.geomspace(1.05 * top, 0.49 * _RATE_OVER_TOP * top, 40),
        ceiling_db=float(np.max(level)),
    )
    rate_hz = _RATE_OVER_TOP * top
    found = fit_within(goal, rate_hz, order, within_db)
    if found is None:
        return None
    zeros, poles = (2.0 * rate_hz * (roots - 1.0) / (roots + 1.0) for roots in (found.zeros, found.poles))
    shape = ContinuousSystem(zeros, np.append(poles, fall.poles), 1.0)
    off_db = db(np.abs(shape.response(frequency_hz))) - level_db
    gain = 10.0 ** (-0.5 * float(np.max(off_db) + np.min(off_db)) / 20.0)
    return ContinuousSystem(shape.zeros, shape.poles, gain)
