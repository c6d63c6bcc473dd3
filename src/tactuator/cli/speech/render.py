"""The verb `render`: speech to a reference in dB SL, and the prediction of what is felt of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.console import Group
from rich.table import Table

from tactuator.cli.answer import answer, progress, written
from tactuator.cli.chosen import chosen_controller
from tactuator.errors import BadInput
from tactuator.speech.coding import coding_of, write_coding
from tactuator.speech.render import Rendered, RenderJob, render_file


def run(
    speech: Path,
    out: Path,
    display: Path | None,
    controller: Path | None,
    coding: str,
    level: float,
    felt: Path | None,
    figures: Path | None,
    save_coding: Path | None,
    seed: int,
    as_json: bool,
) -> None:
    """Code speech onto the fingers, set its level in dB SL, keep the display's limits, write the reference."""
    if figures is not None and felt is None:
        raise BadInput("--figures without --felt", "both, since they show what was felt")
    chosen = coding_of(coding)
    job = RenderJob(chosen_controller(display, controller), chosen, level, felt is not None, seed)
    with progress() as bars:
        task = bars.add_task("render", total=1.0)
        rendered = render_file(speech, out, job, felt, lambda done: bars.update(task, completed=done))
    if save_coding is not None:
        write_coding(save_coding, chosen)
    if figures is not None and rendered.felt is not None:
        from tactuator.report.felt import spectrogram_plate  # drawing loads slowly
        from tactuator.report.plate import save_plates

        plate = spectrogram_plate(rendered.felt, f"{speech.name}, coding “{coding}” at {level:g} dB SL")
        save_plates([plate], figures)
    answer(
        {"out": str(out), **rendered.document()},
        as_json,
        Group(_shown(rendered), *written(out, felt, save_coding, figures)),
    )


def _shown(rendered: Rendered) -> Group:
    table = Table(
        "finger", "peak dB SL", "limiter", "felt − asked, rms", "median frame", "95 % of frames", title="Reference"
    )
    figures: dict[str, Any] = {} if rendered.felt is None else rendered.felt.figures()
    for entry in rendered.limiting:
        felt = figures.get(entry.finger)
        cells = (
            ["–"] * 3 if felt is None else [f"{felt[key]:.2f} dB" for key in ("rms_db", "median_db_all", "p95_db_all")]
        )
        table.add_row(entry.finger, f"{rendered.peak_db_sl[entry.finger]:.1f}", _limited(entry), *cells)
    return Group(table, *(f"note: {note}" for note in rendered.speech.notes))


def _limited(entry: Any) -> str:
    if entry.max_reduction_db == 0.0:
        return "untouched"
    reason = max(entry.reasons, key=entry.reasons.get)
    return f"up to {entry.max_reduction_db:.1f} dB for {entry.reduced_s:.2f} s ({reason})"
