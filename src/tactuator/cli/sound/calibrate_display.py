"""The verb `calibrate-display`: from a display file with its wiring to a verified equaliser and its report."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import typer
from rich.console import Group
from rich.table import Table

from tactuator.cli.answer import answer, progress
from tactuator.cli.response.measure import frequencies
from tactuator.errors import BadInput, NoDesign
from tactuator.io.curve import resolve_curve
from tactuator.io.display import read_display, with_curve
from tactuator.measure.open_loop import Calibrated, CalibrationRequest, NoEqualiser, calibrate
from tactuator.model.description import Display
from tactuator.report.open_loop import FILES, write_calibrated, write_measured
from tactuator.rig.open import open_rig
from tactuator.rig.sound.rig import SoundRig


def run(
    display: Path,
    rig: str,
    out: Path,
    level_db_sl: float,
    band_hz: str,
    mains_hz: float,
    curve: str | None,
    seed: int,
    as_json: bool,
) -> None:
    """Find level, model, usable band and equaliser of a display without loop, and verify what is felt; exit status 1
    where that is not flat within the tolerance.
    """
    described = read_display(display)
    if curve is not None:
        described = with_curve(described, resolve_curve(curve))
    asked = CalibrationRequest(_band(described, band_hz), level_db_sl, mains_hz)
    deliver(described, rig, out, asked, seed, as_json)


def deliver(described: Display, rig: str, out: Path, asked: CalibrationRequest, seed: int, as_json: bool) -> None:
    """Calibrate, write and print; exit status 1 where it is not felt flat."""
    if not rig.startswith("sound:"):
        raise BadInput(f"rig {rig!r}", "sound:DEVICE[@RATE], a display without loop on a sound card")
    with open_rig(rig, described, seed) as opened, progress() as bars:
        assert isinstance(opened, SoundRig)
        task = bars.add_task("calibrating", total=None)
        try:
            made = calibrate(
                opened, asked, np.random.default_rng(seed), lambda text: bars.update(task, description=text)
            )
        except NoEqualiser as reached:
            raise _kept(reached, rig, out) from None
        gaps = opened.gaps
    date = _now()
    write_calibrated(out, made, asked, rig, date, gaps)
    answer(_document(made, out, gaps), as_json, _shown(made, out))
    if not made.flat:
        raise typer.Exit(1)


def _kept(reached: NoEqualiser, rig: str, out: Path) -> NoDesign:
    """Write what was measured, and return the refusal that tells where it is and how to go on."""
    names = ", ".join(write_measured(out, reached, rig, _now()))
    return NoDesign(
        f"{reached}. What was measured is kept in {out} ({names}); `tactuator design {out / 'display.toml'}` goes on "
        "from there, with a narrower band_hz or other poles"
    )


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _band(described: Display, text: str) -> tuple[float, float]:
    if not text:
        bands = [one.threshold.band_hz for one in described.channels]
        return max(low for low, _ in bands), min(high for _, high in bands)
    values = frequencies(text)
    if values.size != 2 or not 0.0 < values[0] < values[1]:
        raise BadInput(f"band {text!r}", "two frequencies, low,high")
    return float(values[0]), float(values[1])


def _document(made: Calibrated, out: Path, gaps: int) -> dict[str, Any]:
    return {
        "out": str(out),
        "flat": made.flat,
        "gaps": gaps,
        "channels": [
            {
                "channel": one.name,
                "usable_band_hz": list(one.usable.band_hz),
                "shortfall": one.shortfall(made.controller.display.objectives.flatness_db),
                "ends": list(one.usable.ends),
                "worst_error_db": one.last.worst_db,
                "first_worst_error_db": one.first.worst_db,
                "frequency_hz": one.last.frequency_hz,
                "error_db": one.last.error_db,
                "confidence_db": one.last.confidence_db,
                "plant": one.followed.by,
                "departure_db": one.followed.departure_db,
                "recorded_at_v": one.level.volts,
                "rounds": one.rounds,
            }
            for one in made.channels
        ],
    }


def _shown(made: Calibrated, out: Path) -> Group:
    table = Table("channel", "usable (Hz)", "felt less asked (dB)", "plant", "corrected")
    for one in made.channels:
        low, high = one.usable.band_hz
        spread = f"{one.last.error_db.min():+.2f} to {one.last.error_db.max():+.2f}"
        table.add_row(one.name, f"{low:.4g} to {high:.4g}", spread, one.followed.by, str(one.rounds))
    allowed = made.controller.display.objectives.flatness_db
    short = [f"{one.name}: NOT felt flat: {why}" for one in made.channels if (why := one.shortfall(allowed))]
    return Group(table, *(f"written: {out / name}" for name in FILES), *(short or ["felt flat"]))
