"""`tactuator wordlength`: what number formats leave of a controller."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from tactuator.cli.answer import answer
from tactuator.cli.options import AsJson
from tactuator.digital.wordlength import FormatReport, assess, at_rate, recommended
from tactuator.errors import BadInput
from tactuator.files.controller import read_controller


def register(app: typer.Typer) -> None:
    """Add the verb."""

    @app.command()
    def wordlength(
        controller: Annotated[Path, typer.Argument(help="Controller file that `design` wrote.")],
        rate: Annotated[float | None, typer.Option("--rate", help="Another sampling rate, hertz.")] = None,
        number_format: Annotated[
            str | None, typer.Option("--format", help="Ask for the verdict on one format: exit status 1 if unsafe.")
        ] = None,
        as_json: AsJson = False,
    ) -> None:
        """Say which number formats are safe for a controller, and recommend the smallest."""
        made = read_controller(controller)
        if rate is not None:
            made = at_rate(made, rate)
        reports = assess(made)
        if number_format is not None and number_format not in [report.name for report in reports]:
            allowed = ", ".join(report.name for report in reports)
            raise BadInput(f"format is {number_format!r}; allowed: {allowed}")
        best = recommended(reports)
        result = {"rate_hz": made.rate_hz, "formats": [asdict(report) for report in reports], "recommended": best}
        answer(result, as_json, _table(reports, made.rate_hz, best))
        asked = [report.safe for report in reports if report.name == number_format]
        if best is None or not all(asked):
            raise typer.Exit(1)


def _table(reports: tuple[FormatReport, ...], rate_hz: float, best: str | None) -> Table:
    title = f"Word length at {rate_hz:g} Hz; recommended: {best or 'none of what a board runs'}"
    table = Table("format", "stable", "error, dB", "round-off, dB SL", "limit cycle, dB SL", "safe", title=title)
    for report in reports:
        figures = (report.response_error_db, report.roundoff_db_sl, report.limit_cycle_db_sl)
        cells = ["" if value is None else f"{value:.3g}" for value in figures]
        table.add_row(report.name, "yes" if report.stable else "no", *cells, "yes" if report.safe else "no")
    return table
