"""A point of the curve that is dragged: a lead or lag in its place, and the gain, bring it where it is wanted."""

from __future__ import annotations

import cmath
import math
from dataclasses import replace

import numpy as np
from scipy import optimize

from tactuator.console.shaping.factors import HIGHEST_SHARE, Factor, LoopShape
from tactuator.signals.decibels import db
from tactuator.signals.systems import SampledSystem

_RATIOS = (0.02, 50.0)
_SAME_PLACE = 0.02
_LOWEST_HZ = 0.01


def with_point_at(
    shape: LoopShape, plant: SampledSystem, frequency_hz: float, turn_deg: float, level_db: float
) -> LoopShape:
    """Return the shape whose loop, at `frequency_hz`, is turned by `turn_deg` (positive: less lag) and stands at
    `level_db`.

    A lead that is there already in that place is changed, so that a drag of many steps leaves one. A turn beyond what
    one lead or lag gives ends at the most that it gives.
    """
    rate_hz = plant.rate_hz
    frequency_hz = float(np.clip(frequency_hz, _LOWEST_HZ, HIGHEST_SHARE * rate_hz))
    place = _place_of_lead(shape, frequency_hz)
    now = 1.0 if place is None else shape.factors[place]["ratio"]
    ratio = _ratio(frequency_hz, _phase_deg(frequency_hz, now, rate_hz) + turn_deg, rate_hz)
    lead = Factor("lead", (frequency_hz, ratio))
    factors = list(shape.factors)
    if place is not None:
        factors[place] = lead
    elif abs(np.log(ratio)) > 1e-6:
        factors.append(lead)
    turned = replace(shape, factors=tuple(factors))
    there = np.abs(turned.system(rate_hz).response(frequency_hz) * plant.response(frequency_hz))
    return replace(turned, gain_db=turned.gain_db + level_db - float(db(there)))


def _place_of_lead(shape: LoopShape, frequency_hz: float) -> int | None:
    """Return where among the factors a lead stands at this frequency, or None."""
    for place, factor in enumerate(shape.factors):
        if factor.kind == "lead" and abs(np.log(factor["hz"] / frequency_hz)) < _SAME_PLACE:
            return place
    return None


def _phase_deg(frequency_hz: float, ratio: float, rate_hz: float) -> float:
    """Return the phase of a lead at its middle, degrees: that of its zero less that of its pole."""
    turn = 2.0 * math.pi * frequency_hz / rate_hz
    z, apart = cmath.exp(1j * turn), math.sqrt(ratio)
    return math.degrees(cmath.phase((z - math.exp(-turn / apart)) / (z - math.exp(-turn * apart))))


def _ratio(frequency_hz: float, phase_deg: float, rate_hz: float) -> float:
    """Return the ratio of a lead whose phase at its middle is `phase_deg`, or the nearest that there is."""
    low, high = np.log(_RATIOS)
    missing = [_phase_deg(frequency_hz, float(np.exp(end)), rate_hz) - phase_deg for end in (low, high)]
    if missing[0] >= 0.0 or missing[1] <= 0.0:
        return _RATIOS[0] if missing[0] >= 0.0 else _RATIOS[1]
    found = optimize.brentq(
        lambda x: _phase_deg(frequency_hz, float(np.exp(x)), rate_hz) - phase_deg, low, high, xtol=1e-9
    )
    return float(np.exp(found))
