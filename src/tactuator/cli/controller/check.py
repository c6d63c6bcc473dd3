"""The verb `check`: the verdict on a controller."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from tactuator.cli.answer import answer
from tactuator.cli.options import AsJson
from tactuator.files.controller import read_controller
from tactuator.files.display import read_display
from tactuator.synthesis.verdict import Verdict, judge

_SHOWN = ("max_error_db", "worst_band_db_sl", "resonance_peak", "max_change_db", "worst_change_db", "worst_hz")


def register(app: typer.Typer) -> None:
    """Add the verb to the application."""

    @app.command()
    def check(
        controller: Annotated[Path, typer.Argument(help="Controller file.")],
        display: Annotated[Path | None, typer.Option("--display", help="Display file to judge it for.")] = None,
        as_json: AsJson = False,
    ) -> None:
        """Judge a controller by the paper's four objectives, every channel and load; exit status 1 if one fails."""
        verdict = judge(read_controller(controller), None if display is None else read_display(display))
        answer(verdict.document(), as_json, _table(verdict))
        if not verdict.met:
            raise typer.Exit(1)


def _table(verdict: Verdict) -> Table:
    table = Table("objective", "channel", "load", "figures", "met", title="Verdict: " + _word(verdict.met))
    for objective in verdict.objectives:
        for channel, by_load in objective.figures.items():
            for load, figures in by_load.items():
                table.add_row(objective.number, channel, load, _figures(figures), _outcome(figures))
    return table


def _outcome(figures: dict[str, Any]) -> str:
    """Return the outcome in words; an objective may report a load without judging it, since what a finger changes is
    objective iv's to judge.
    """
    return _word(figures["met"]) if figures.get("judged", True) else "reported"


def _figures(figures: dict[str, Any]) -> str:
    if figures.get("stable") is False:
        return "the closed loop is unstable"
    parts = [f"{key} {figures[key]:.2f}" for key in _SHOWN if figures.get(key) is not None]
    felt = figures.get("felt_db_sl", {})
    parts += [f"{line} Hz {level:.1f} dB SL" for line, level in felt.items() if level is not None]
    return ", ".join(parts) or "nothing is felt"


def _word(met: bool) -> str:
    return "met" if met else "not met"
