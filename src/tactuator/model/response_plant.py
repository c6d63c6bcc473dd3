"""A plant from its frequency response by itself, for a channel without a loop: only its magnitude is equalised.

The system is stable and of least phase, of the fewest poles whose magnitude keeps to every point within what the points
are sure of; beyond the last point it falls. How the curve may run between its points is estimated by other systems that
use fewer points or more poles: four fitted with one point in four left out, and one of the next number of poles. The
greatest distance of any of them, anywhere, is what the plant may be off: it widens with the spacing of the points.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.plant_model import DB
from tactuator.model.plausibility import response_doubts
from tactuator.plain import brief
from tactuator.signals.decibels import db
from tactuator.signals.magnitude import MagnitudeGoal, fit_within
from tactuator.signals.record import FrequencyResponse
from tactuator.signals.systems import ContinuousSystem

ORDERS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 16)
"""Numbers of poles that are tried."""
_CLOSE_DB, _DEVIATIONS = 0.1, 3.0
"""Error that is asked of a fit, dB: a tenth of what is felt; standard errors of a point that it may be off."""
_RATE_OVER_TOP = 400.0
"""The sampled fit's rate over the last frequency: so high that the bilinear transform bends nothing."""
_FALLS_AT, _FALL_POLES = 4.0, 4
"""Beyond the last point nothing is known: so steep a fall that no image of the converter's adds to a notch."""
_BETWEEN_DB = 1.0
"""Room between two points beyond half of what the level changes there, dB."""
_TURNS, _BETWEEN = 4, 8
"""One point in four is left out in turn; at eight places a gap systems are compared."""
_WITHIN = (1.0, 1.5, 2.5, 5.0, 10.0, 25.0)
"""Errors that are tried, in terms of what the points are sure of."""


@dataclass(frozen=True)
class ResponsePlant:
    """A plant of a response. error_db: what its magnitude may be off anywhere between first and last point. unsure_hz:
    the two points between which it is the least sure. valid_hz: first and last frequency of the response. doubts:
    what of its figures can hardly be."""

    system: ContinuousSystem
    error_db: float
    unsure_hz: tuple[float, float]
    valid_hz: tuple[float, float]
    doubts: tuple[str, ...] = ()

    __repr__ = brief


def plant_of_response(given: FrequencyResponse) -> ResponsePlant:
    """Return the plant of a response's magnitudes; a phase, where there is one, is not used.

    Raises BadInput where the magnitudes cannot be followed at all.
    """
    own_db = DB * given.deviation
    close_db = max(_CLOSE_DB, _DEVIATIONS * float(np.median(own_db)))
    room_db = np.maximum(0.0, _DEVIATIONS * own_db - close_db)
    room_db[[0, -1]] = 0.0
    frequency, level = given.frequency_hz, db(given.magnitude)
    orders = [order for order in ORDERS if order <= max(2, frequency.size // 3)]
    for within_db in close_db * np.array(_WITHIN):
        for order in orders:
            system = _followed(frequency, level, room_db, order, float(within_db))
            if system is not None:
                points = _Points(frequency, level, room_db)
                others = [*_with_less(points, order, close_db), _with_more(points, order, orders, float(within_db))]
                apart_db, unsure_hz = _farthest(points, system, others)
                # standard errors of the points that the error holds (95 %)
                error_db = apart_db + 2.0 * float(np.median(own_db))
                valid_hz = float(frequency[0]), float(frequency[-1])
                return ResponsePlant(system, error_db, unsure_hz, valid_hz, response_doubts(given))
    raise BadInput(
        f"no stable system of up to {orders[-1]} poles follows the magnitude within {close_db * _WITHIN[-1]:.3g} dB",
        "more points where it turns sharply",
    )


@dataclass(frozen=True)
class _Points:
    """Points of a response: hertz, dB, and the room that each has beyond the common error, dB; (n,) each."""

    frequency_hz: FloatArray
    level_db: FloatArray
    room_db: FloatArray

    def followed(self, kept: NDArray[np.bool_], order: int, within_db: float) -> ContinuousSystem | None:
        """Return a system through the points that are kept, (n,), or None."""
        return _followed(self.frequency_hz[kept], self.level_db[kept], self.room_db[kept], order, within_db)


def _with_less(points: _Points, order: int, close_db: float) -> Iterator[ContinuousSystem | None]:
    """Yield systems of the same order that do not know one point in four, each in turn; None where nothing follows."""
    for first in range(1, _TURNS + 1):
        kept = np.ones(points.frequency_hz.size, dtype=bool)
        kept[first:-1:_TURNS] = False
        fits = (points.followed(kept, order, times * close_db) for times in _WITHIN)
        yield next((system for system in fits if system is not None), None)


def _with_more(points: _Points, order: int, orders: Sequence[int], within_db: float) -> ContinuousSystem | None:
    """Return a system through all points with the next number of poles that gives one, or None."""
    kept = np.ones(points.frequency_hz.size, dtype=bool)
    fits = (points.followed(kept, more, within_db) for more in orders if more > order)
    return next((system for system in fits if system is not None), None)


def _farthest(
    points: _Points, system: ContinuousSystem, others: Sequence[ContinuousSystem | None]
) -> tuple[float, tuple[float, float]]:
    """Return the greatest distance (dB) of the others from the system, and the two points between which it lies.

    Where one of those that know less is missing, anything is possible: all that the level changes.
    """
    edges = points.frequency_hz
    ends = (float(edges[0]), float(edges[-1]))
    if any(system is None for system in others[:_TURNS]):
        return float(np.ptp(points.level_db)), ends
    share = np.linspace(0.0, 1.0, _BETWEEN, endpoint=False)
    dense = np.append((edges[:-1, None] * (edges[1:] / edges[:-1])[:, None] ** share).ravel(), edges[-1])
    level_db = db(np.abs(system.response(dense)))
    apart = np.max(
        [np.abs(db(np.abs(other.response(dense))) - level_db) for other in others if other is not None], axis=0
    )
    worst = int(np.argmax(apart))
    gap = min(worst // _BETWEEN, edges.size - 2)
    return float(apart[worst]), (float(edges[gap]), float(edges[gap + 1]))


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
    fit = fit_within(goal, rate_hz, order, within_db)
    if fit is None:
        return None
    zeros, poles = (2.0 * rate_hz * (roots - 1.0) / (roots + 1.0) for roots in (fit.zeros, fit.poles))
    shape = ContinuousSystem(zeros, np.append(poles, fall.poles), 1.0)
    off_db = db(np.abs(shape.response(frequency_hz))) - level_db
    gain = 10.0 ** (-0.5 * float(np.max(off_db) + np.min(off_db)) / 20.0)
    return ContinuousSystem(shape.zeros, shape.poles, gain)
