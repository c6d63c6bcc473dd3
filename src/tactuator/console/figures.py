"""The figures of one channel while its loop is shaped: those of `design` and `check`, by the same functions."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from threadpoolctl import threadpool_limits

from tactuator.console.loop_chart import ChannelPlants
from tactuator.model.controller import ChannelController, Controller
from tactuator.model.verdict import Finding, Verdict, verdict_of
from tactuator.report.tables import FINDING_COLUMNS, design_rows, finding_row
from tactuator.signals.systems import SampledSystem
from tactuator.synthesis.design import assemble
from tactuator.synthesis.prefilter import fit_prefilter
from tactuator.synthesis.verdict import FELT_HUM, FELT_NOISE, RESONANCE, judge_channel
from tactuator.wordlength.assessment import buildable

_TILES = ("error of |H|", FELT_HUM, FELT_NOISE, RESONANCE, "change of |H|")
"""Quantities of a verdict that stand in large figures."""
_BUILD = "build"


def channel_controller(plants: ChannelPlants, feedback: SampledSystem) -> ChannelController:
    """Return the controller of a channel with C as it was shaped, and the prefilter that belongs to it.

    Raises UnstableLoop where the loop is unstable on a plant of the family; BadInput where no prefilter fits.
    """
    display, channel = plants.display, plants.channel
    with threadpool_limits(limits=1):  # as `design` does: the same figures on any machine
        fit = fit_prefilter(channel, feedback, display.rate_hz, display.delay_samples, channel.prefilter.poles)
        return assemble(display, channel, feedback, fit, plants.family)


def settled_figures(
    plants: ChannelPlants, feedback: SampledSystem, known: ChannelController | None
) -> tuple[ChannelController, dict[str, Any]]:
    """Return the controller of a channel (the one that is known already, or one made for C), and its figures."""
    controller = channel_controller(plants, feedback) if known is None else known
    return controller, channel_figures(plants, controller)


def channel_figures(plants: ChannelPlants, controller: ChannelController) -> dict[str, Any]:
    """Return the figures of `design` and the findings of `check` on one channel, as rows of texts, and the large
    figures: name, value and limit as texts, and what came of them.
    """
    alone = Controller(replace(plants.display, channels=(plants.channel,)), (controller,))
    findings = [*judge_channel(controller, plants.channel, plants.display), buildable(alone)]
    return {
        "design": [list(row) for row in design_rows([controller])],
        "verdict": verdict_rows(verdict_of(findings)),
        "tiles": [_margin_tile(plants, controller), *_tiles(verdict_of(findings))],
    }


def verdict_rows(verdict: Verdict) -> dict[str, Any]:
    """Return a verdict as `check` prints it: columns, rows of texts with remarks, its sentence, what was assumed."""
    worst = [finding for objective in verdict.objectives for finding in objective.worst()]
    return {
        "columns": [*FINDING_COLUMNS, "remark"],
        "rows": [[*finding_row(finding), finding.remark] for finding in worst],
        "sentence": verdict.sentence,
        "assumed": list(verdict.assumptions),
    }


def _margin_tile(plants: ChannelPlants, controller: ChannelController) -> dict[str, str]:
    margin = controller.report["margins"]["phase_margin_deg"]
    asked = plants.channel.feedback.phase_margin_deg
    short = asked is not None and margin is not None and margin < asked
    return {
        "name": "phase margin",
        "value": "—" if margin is None else f"{margin:.2f}°",
        "allowed": "" if asked is None else f"{asked:g}° or more",
        "outcome": "not met" if short else "met",
    }


def _tiles(verdict: Verdict) -> list[dict[str, str]]:
    findings = [finding for objective in verdict.objectives for finding in objective.worst()]
    worst = {finding.quantity: finding for finding in findings if finding.objective != _BUILD}
    built = [replace(finding, quantity="word length: float32") for finding in findings if finding.objective == _BUILD]
    return [_tile(finding) for finding in [*(worst[name] for name in _TILES if name in worst), *built]]


def _tile(finding: Finding) -> dict[str, str]:
    unit = f" {finding.unit}" if finding.unit else ""
    return {
        "name": finding.quantity,
        "value": "—" if finding.value is None else f"{finding.value:.2f}{unit}",
        "allowed": "" if finding.allowed is None else f"{finding.allowed:g}{unit} or less",
        "outcome": finding.outcome.value,
    }
