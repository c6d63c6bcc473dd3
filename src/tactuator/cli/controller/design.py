"""The verb `design`: a controller from a display file."""

from __future__ import annotations

from pathlib import Path

import typer
from rich.console import Group
from rich.table import Table

from tactuator.cli.answer import answer, working, written
from tactuator.cli.controller.check import verdict_table
from tactuator.io.controller import write_controller
from tactuator.io.curve import resolve_curve
from tactuator.io.display import read_display, with_curve
from tactuator.model.controller import ChannelController, Controller
from tactuator.model.description import Display
from tactuator.model.verdict import Outcome, Verdict
from tactuator.report.tables import design_rows, printed_factors
from tactuator.signals.systems import SampledSystem
from tactuator.synthesis.design import design_controller
from tactuator.synthesis.exchange import continuous_form
from tactuator.synthesis.verdict import whole_verdict


def run(
    display: Path,
    out: Path,
    curve: str | None,
    poles: int | None,
    error_db: float | None,
    figures: Path | None,
    as_json: bool,
) -> None:
    """Design loop and prefilter of every channel, and write them as a controller file; exit status 1 if not met."""
    described = _with_curve(read_display(display), curve)
    with working("designing"):
        controller = design_controller(described, poles, error_db)
    if figures is not None:
        from tactuator.report.controller import save_design_plates  # drawing takes a second to load

        save_design_plates(controller, figures)
    write_controller(out, controller)
    verdict = whole_verdict(controller)
    reports = {channel.name: dict(channel.report) for channel in controller.channels}
    answer(
        reports | {"verdict": verdict.document()}, as_json, Group(_shown(controller, verdict), *written(figures, out))
    )
    if verdict.outcome is Outcome.NOT_MET:
        raise typer.Exit(1)


def _with_curve(display: Display, curve: str | None) -> Display:
    return display if curve is None else with_curve(display, resolve_curve(curve))


def _shown(controller: Controller, verdict: Verdict) -> Group:
    table = Table("figure (worst over the loads)", *(one.name for one in controller.channels), title="Design")
    for row in design_rows(controller.channels):
        table.add_row(*row)
    lines = [line for one in controller.channels for line in _printed(one, controller.rate_hz)]
    return Group(table, *lines, verdict_table(verdict))


def _printed(channel: ChannelController, rate_hz: float) -> list[str]:
    """Return C and F in continuous form (whose bilinear transform the sections are), in factors, as a paper does."""
    systems: dict[str, SampledSystem | None] = {"C": channel.feedback(rate_hz), "F": channel.prefilter(rate_hz)}
    return [
        f"{channel.name}: {letter}(s) = {printed_factors(continuous_form(system))}"
        for letter, system in systems.items()
        if system is not None
    ]
