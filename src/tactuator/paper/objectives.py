"""Step 13: the paper's four objectives (its section 2), judged by what was measured."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from tactuator.measure.noise import noise_verdict
from tactuator.model.controller import Controller
from tactuator.model.verdict import Finding, Verdict, compared, verdict_of
from tactuator.paper.noise import NoiseProbe
from tactuator.paper.plan import Plan
from tactuator.paper.response import LOADED, UNLOADED, ResponsePoint
from tactuator.signals.decibels import db
from tactuator.synthesis.verdict import RESONANCE, judge

JUDGED_AT_DB_SL = 30.0
"""The response is judged where neither friction nor saturation interferes."""


def judge_objectives(
    plan: Plan, controller: Controller, responses: tuple[ResponsePoint, ...], noise: NoiseProbe
) -> Verdict:
    """Return the verdict by what was measured; max|T|, which nobody can measure at rest, by the controller's model."""
    at_level = [one for one in responses if one.level_db_sl == JUDGED_AT_DB_SL]
    heard = noise_verdict(noise.designed, plan.display)
    modelled = judge(controller, plan.display)
    findings = [
        *_follows(plan, at_level),
        *(one for objective in heard.objectives for one in objective.findings),
        *(one for objective in modelled.objectives for one in objective.findings if one.quantity == RESONANCE),
        *_bears_load(plan, at_level),
    ]
    return verdict_of(findings)


def _follows(plan: Plan, responses: list[ResponsePoint]) -> Iterator[Finding]:
    """Judge objective i of every channel: the greatest error of a measured point against the curve."""
    for channel in plan.display.channels:
        errors = [
            (abs(float(db(one.measured_v / one.target_v))), one)
            for one in responses
            if (one.channel, one.load) == (channel.name, UNLOADED)
        ]
        value, worst = max(errors, key=lambda pair: pair[0])
        allowed = plan.display.objectives.flatness_db
        found = compared("i", channel.name, UNLOADED, "error of |H|", value, allowed, "dB", worst.frequency_hz)
        yield replace(found, remark=f"measured at {JUDGED_AT_DB_SL:g} dB SL, confidence {worst.ci_db:.2f} dB")


def _bears_load(plan: Plan, responses: list[ResponsePoint]) -> Iterator[Finding]:
    """Judge objective iv of every channel: the greatest change by the finger up to `load_band_hz`."""
    tolerance = plan.display.objectives
    free = {(one.channel, one.frequency_hz): one.measured_v for one in responses if one.load == UNLOADED}
    for channel in plan.display.channels:
        changes = [
            (float(db(one.measured_v / free[one.channel, one.frequency_hz])), one.frequency_hz)
            for one in responses
            if (one.channel, one.load) == (channel.name, LOADED)
        ]
        low = max((abs(change), hertz) for change, hertz in changes if hertz <= tolerance.load_band_hz)
        value, at_hz = low
        found = compared("iv", channel.name, LOADED, "change of |H|", value, tolerance.load_max_db, "dB", at_hz)
        change, worst_hz = max(changes, key=lambda pair: abs(pair[0]))
        yield replace(found, remark=f"over the band {change:+.2f} dB at {worst_hz:.3g} Hz")
