"""The verb `wordlength`: the effect of number formats on a controller."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import typer
from rich.console import Group
from rich.table import Table

from tactuator.cli.answer import answer, progress, working, written
from tactuator.errors import BadInput
from tactuator.io.controller import read_controller
from tactuator.model.controller import Controller
from tactuator.model.description import HIGHEST_RATE_HZ
from tactuator.wordlength.assessment import FormatReport, assess, recommended
from tactuator.wordlength.bits import at_rate, controller_bits
from tactuator.wordlength.formats import FORMATS

_RATE_DOUBLINGS = 4


def run(controller: Path, rate: float | None, number_format: str | None, figures: Path | None, as_json: bool) -> None:
    """Say which number formats are safe for a controller, and recommend the smallest."""
    names = [each.name for each in FORMATS]
    if number_format is not None and number_format not in names:
        raise BadInput(f"format is {number_format!r}", f"{', '.join(names)}")
    made = read_controller(controller)
    if rate is not None:
        made = at_rate(made, rate)
    drawn: dict[str, object] = {}
    if figures is not None:
        with working("counting the bits that the coefficients need"):
            drawn = _draw(made, figures)
    reports = _assess(made)
    best = recommended(reports)
    result = {"rate_hz": made.rate_hz, "formats": [asdict(report) for report in reports], "recommended": best}
    answer(result | drawn, as_json, Group(_table(reports, made.rate_hz, best), *written(figures)))
    asked = [report.safe for report in reports if report.name == number_format]
    if best is None or not all(asked):
        raise typer.Exit(1)


def _assess(controller: Controller) -> tuple[FormatReport, ...]:
    reports: list[FormatReport] = []
    with progress() as bars:
        for number_format in bars.track(FORMATS, description="formats"):
            reports += assess(controller, (number_format,))
    return tuple(reports)


def _draw(controller: Controller, folder: Path) -> dict[str, object]:
    """Write the figure and return its numbers, for the answer."""
    from tactuator.report.controller import resolution_plate
    from tactuator.report.plate import save_plates  # drawing takes a second to load

    rates = [controller.rate_hz * 2.0**k for k in range(_RATE_DOUBLINGS)]
    bits = controller_bits(controller, [rate for rate in rates if rate <= HIGHEST_RATE_HZ])
    bands = [channel.threshold.band_hz for channel in controller.display.channels]
    band = f"{min(low for low, _ in bands):g}-{max(high for _, high in bands):g} Hz"
    save_plates([resolution_plate(bits, whose="this controller (the most of any channel)", band=band)], folder)
    told = {
        name: {form: {f"{rate:g}": asdict(one) for rate, one in by_rate.items()} for form, by_rate in forms.items()}
        for name, forms in bits.items()
    }
    return {"figures": str(folder), "resolution_bits": told}


def _table(reports: tuple[FormatReport, ...], rate_hz: float, best: str | None) -> Table:
    title = f"Word length at {rate_hz:g} Hz; recommended: {best or 'none of what a board runs'}"
    table = Table("format", "stable", "error (dB)", "round-off", "limit cycle", "safe", title=title)
    notes = ["Round-off and limit cycle: dB SL, as a finger feels them. A board runs float32 and q31."]
    for report in reports:
        if report.refused is not None:
            notes.append(f"{report.name}: {report.refused}.")
        error = "" if report.response_error_db is None else f"{report.response_error_db:.2g}"
        felt = ["" if value is None else f"{value:.0f}" for value in (report.roundoff_db_sl, report.limit_cycle_db_sl)]
        table.add_row(report.name, "yes" if report.stable else "no", error, *felt, "yes" if report.safe else "no")
    table.caption = "\n".join(notes)
    return table
