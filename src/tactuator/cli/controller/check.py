"""The verb `check`: the verdict on a controller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import typer
from rich.console import Group
from rich.table import Table
from rich.text import Text

from tactuator.cli.answer import answer, shown, working
from tactuator.experiment.result.confusion import ResultTable
from tactuator.io.controller import read_controller
from tactuator.io.display import read_display
from tactuator.model.verdict import Outcome, Verdict
from tactuator.report.tables import FINDING_COLUMNS, finding_row, remark_lines
from tactuator.synthesis.monte_carlo import DrawnPlants
from tactuator.synthesis.monte_carlo import monte_carlo as draw_plants
from tactuator.synthesis.verdict import whole_verdict


def run(controller: Path, display: Path | None, monte_carlo: int, mode_shift: float, seed: int, as_json: bool) -> None:
    """Judge a controller by the paper's four objectives and by what a board takes; exit status 1 if one fails."""
    made, shown = read_controller(controller), None if display is None else read_display(display)
    drawn: list[DrawnPlants] = []
    if monte_carlo:
        on = made if shown is None else replace(made, display=shown)
        on.require_runs(on.display)
        with working("drawing plants"):
            drawn = draw_plants(on, monte_carlo, np.random.default_rng(seed), mode_shift)
    verdict = whole_verdict(made, shown, drawn)
    found = verdict.document() | ({"monte_carlo": [one.document() for one in drawn]} if drawn else {})
    answer(found, as_json, Group(verdict_table(verdict), *([_plants_table(drawn)] if drawn else [])))
    if verdict.outcome is Outcome.NOT_MET:
        raise typer.Exit(1)


def _plants_table(drawn: Sequence[DrawnPlants]) -> Group:
    """Return the 95 % and greatest values of what was drawn, one row for each channel and load."""
    columns = ("channel", "load", "plants", "from", "unstable", "max|S|", "flatness dB", "felt hum dB SL")
    rows = []
    for one in drawn:
        cells = [one.quantiles(values) for values in (one.sensitivity_peak, one.flatness_db, one.felt_hum_db_sl)]
        told = ("—" if np.isnan(values[1]) else f"{values[1]:.2f}/{values[-1]:.2f}" for values in cells)
        rows.append((one.channel, one.load, str(one.count), one.source, f"{100.0 * one.unstable:.2g} %", *told))
    notes = ("max|S|, flatness, felt hum: what 95 % of the plants keep / the greatest of all",)
    return shown(ResultTable("Monte Carlo", columns, tuple(rows), notes))


def verdict_table(verdict: Verdict) -> Group:
    """Return a table of one row for each objective, channel and quantity, the worst of its loads, models and lines.

    Remarks, which may be long, stand below it.
    """
    table = Table()
    for name in FINDING_COLUMNS:
        table.add_column(name, no_wrap=name in ("objective", "outcome", "allowed", "frequency"))
    worst = [one for objective in verdict.objectives for one in objective.worst()]
    for one in worst:
        table.add_row(*(Text(cell) for cell in finding_row(one)))
    assumed = [f"assumed: {sentence}" for sentence in verdict.assumptions]
    return Group(table, *remark_lines(worst), *dict.fromkeys(assumed), f"verdict: {verdict.sentence}")
