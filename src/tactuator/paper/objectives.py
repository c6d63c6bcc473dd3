"""Step 13: the paper's four objectives (its section 2), judged by what was measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactuator.display.controller import Controller
from tactuator.paper.noise import NoiseProbe
from tactuator.paper.plan import Plan
from tactuator.paper.response import LOADED, UNLOADED, ResponsePoint

Figures = dict[str, float | str]

JUDGED_AT_DB_SL = 30.0
"""The response is judged where neither friction nor saturation interferes."""


@dataclass(frozen=True)
class Objective:
    """An objective of the paper. number: i to iv; what it asks, in words; its figures by name; whether they keep the
    display's tolerances.
    """

    number: str
    asks: str
    figures: Figures
    met: bool


def judge_objectives(
    plan: Plan, controller: Controller, responses: tuple[ResponsePoint, ...], noise: NoiseProbe
) -> tuple[Objective, ...]:
    """Judge each objective over all channels."""
    return (
        _follows(plan, responses),
        _quiet_mains(plan, noise),
        _quiet_loop(plan, controller, noise),
        _bears_load(plan, responses),
    )


def _follows(plan: Plan, responses: tuple[ResponsePoint, ...]) -> Objective:
    asked = plan.display.objectives.flatness_db
    judged = [one for one in responses if (one.load, one.level_db_sl) == (UNLOADED, JUDGED_AT_DB_SL)]
    errors = {one: abs(float(20.0 * np.log10(one.measured_v / one.target_v))) for one in judged}
    worst = max(errors, key=lambda one: errors[one])
    figures: Figures = {
        "max_error_db": errors[worst],
        "at_hz": worst.frequency_hz,
        "channel": worst.channel,
    }
    asks = f"measured response within {asked:g} dB of the curve over the band, at {JUDGED_AT_DB_SL:g} dB SL"
    return Objective("i", asks, figures, errors[worst] <= asked)


def _quiet_mains(plan: Plan, noise: NoiseProbe) -> Objective:
    asked = plan.display.objectives.mains_max_db_sl
    level, line, channel = max(
        (float(level), float(line), one.channel)
        for one in noise.designed
        for line, level in zip(one.line_hz, one.line_db_sl, strict=True)
    )
    figures: Figures = {"worst_line_db_sl": level, "line_hz": line, "channel": channel}
    return Objective("ii", f"every mains line felt at {asked:g} dB SL at most", figures, level <= asked)


def _quiet_loop(plan: Plan, controller: Controller, noise: NoiseProbe) -> Objective:
    tolerance = plan.display.objectives
    level, centre, channel = max(
        (float(level), float(centre), one.channel)
        for one in noise.designed
        for centre, level in zip(one.band_hz, one.band_db_sl, strict=True)
    )
    peak = max(float(one.report["margins"]["complementary_peak"]) for one in controller.channels)
    figures: Figures = {
        "worst_band_db_sl": level,
        "band_hz": centre,
        "channel": channel,
        "complementary_peak": peak,
    }
    asks = (
        f"felt noise {tolerance.noise_max_db_sl:g} dB SL at most in every third octave, "
        f"max|T| {tolerance.resonance_peak:g} at most"
    )
    met = level <= tolerance.noise_max_db_sl and peak <= tolerance.resonance_peak
    return Objective("iii", asks, figures, met)


def _bears_load(plan: Plan, responses: tuple[ResponsePoint, ...]) -> Objective:
    tolerance = plan.display.objectives
    judged = [one for one in responses if one.level_db_sl == JUDGED_AT_DB_SL]
    free = {(one.channel, one.frequency_hz): one.measured_v for one in judged if one.load == UNLOADED}
    differences = [
        (abs(float(20.0 * np.log10(one.measured_v / free[one.channel, one.frequency_hz]))), one)
        for one in judged
        if one.load == LOADED
    ]
    low = max(value for value, one in differences if one.frequency_hz <= tolerance.load_band_hz)
    high, worst = max(differences, key=lambda pair: pair[0])
    figures: Figures = {
        "max_difference_db": low,
        "worst_difference_db": high,
        "worst_hz": worst.frequency_hz,
    }
    asks = f"with a finger within {tolerance.load_max_db:g} dB of without, up to {tolerance.load_band_hz:g} Hz"
    return Objective("iv", asks, figures, low <= tolerance.load_max_db)
