"""Fractional bits that a filter's coefficients need, by form and sampling rate (the paper's remark, section 5).

Poles crowd towards z = 1 as the rate rises, so coefficients of z^-1 need ever more bits; one direct form of high order
more than second-order sections, and sections in delta form (polynomials in (z - 1) rate, whose coefficients tend to
those of the continuous filter) hardly any.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.model.controller import Controller
from tactuator.signals.decibels import db
from tactuator.signals.discretise import zero_order_hold
from tactuator.signals.systems import SampledSystem
from tactuator.wordlength.quantised import FORMS, Form, is_stable, quantised_rows, rows_response
from tactuator.wordlength.resampled import at_rate

MOST_BITS = 44
"""Coefficients in double precision say nothing about more."""

_HZ = np.geomspace(0.1, 300.0, 120)
_TOLERANCE_DB = 0.1

Needed = dict[str, dict[str, dict[float, "BitsNeeded"]]]
"""By filter, form and rate."""


@dataclass(frozen=True)
class BitsNeeded:
    """Fractional bits from which on every coarser rounding fails no more: to be stable, and to keep 0.1 dB.

    MOST_BITS + 1 where even MOST_BITS are not enough.
    """

    stable: int
    accurate: int


def filter_bits(system: SampledSystem, form: Form, frequency_hz: FloatArray = _HZ) -> BitsNeeded:
    """Return the bits that a filter by itself (the prefilter) needs: poles inside the unit circle; its own response
    within 0.1 dB.
    """
    exact = system.response(frequency_hz)

    def error_db(rows: FloatArray) -> float:
        return float(np.max(np.abs(db(rows_response(rows, frequency_hz, system.rate_hz) / exact))))

    return _needed(system, form, is_stable, error_db)


def loop_bits(
    controller: SampledSystem, plant: SampledSystem, form: Form, frequency_hz: FloatArray = _HZ
) -> BitsNeeded:
    """Return the bits that a feedback controller needs: the closed loop stable; T within 0.1 dB. plant: with the
    computing delay.
    """
    behind = plant.response(frequency_hz)
    loop = controller.response(frequency_hz) * behind
    exact = loop / (1.0 + loop)

    def closes(rows: FloatArray) -> bool:
        numerators = rows[:, : (rows.shape[1] + 1) // 2]
        return bool(np.all(np.any(numerators, axis=1))) and is_stable(rows, plant)

    def error_db(rows: FloatArray) -> float:
        rounded_loop = rows_response(rows, frequency_hz, plant.rate_hz) * behind
        return float(np.max(np.abs(db(rounded_loop / (1.0 + rounded_loop) / exact))))

    return _needed(controller, form, closes, error_db)


def controller_bits(controller: Controller, rates_hz: Sequence[float]) -> Needed:
    """Return the bits for the prefilter and the feedback of a designed controller at those rates: the most that any
    channel needs, over its own band; of prefilters with unity gain at its lower end, as the paper's has.
    """
    needed: Needed = {"prefilter": {form: {} for form in FORMS}}
    for rate_hz in rates_hz:
        moved = at_rate(controller, rate_hz)
        for channel, own in zip(moved.display.channels, moved.channels, strict=True):
            band = np.geomspace(*channel.threshold.band_hz, 120)
            plant = zero_order_hold(channel.plant, rate_hz)
            plant = replace(plant, delay_samples=plant.delay_samples + moved.delay_samples)
            feedback = own.feedback(rate_hz)
            prefilter = own.prefilter(rate_hz)
            unity = replace(prefilter, gain=prefilter.gain / float(abs(prefilter.response(band[0]))))
            for form in FORMS:
                _raise(needed, "prefilter", form, rate_hz, filter_bits(unity, form, band))
                if feedback is not None:
                    _raise(needed, "feedback", form, rate_hz, loop_bits(feedback, plant, form, band))
    return needed


def _raise(needed: Needed, name: str, form: Form, rate_hz: float, bits: BitsNeeded) -> None:
    by_rate = needed.setdefault(name, {}).setdefault(form, {})
    so_far = by_rate.get(rate_hz, bits)
    by_rate[rate_hz] = BitsNeeded(max(bits.stable, so_far.stable), max(bits.accurate, so_far.accurate))


def _needed(
    system: SampledSystem, form: Form, holds: Callable[[FloatArray], bool], error_db: Callable[[FloatArray], float]
) -> BitsNeeded:
    """Search from the finest rounding downwards until one fails: a coarser one that happens to fit does not count."""
    sections = system.sections()
    stable = accurate = MOST_BITS + 1
    still_accurate = True
    for bits in range(MOST_BITS, -1, -1):
        rows = quantised_rows(sections, form, bits, system.rate_hz)
        if not holds(rows):
            break
        stable = bits
        still_accurate = still_accurate and error_db(rows) <= _TOLERANCE_DB
        if still_accurate:
            accurate = bits
    return BitsNeeded(stable, accurate)
