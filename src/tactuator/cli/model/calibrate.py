"""The verb `calibrate`: the sensor gain from pairs of displacement and voltage."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from rich.table import Table

from tactuator.cli.answer import answer
from tactuator.errors import BadInput
from tactuator.identification.calibration import Calibration, fit_line
from tactuator.io.pairs import read_pairs
from tactuator.report.tables import with_error


def run(pairs: Path, gauge_error_mm: float, strict: bool, as_json: bool) -> None:
    """Estimate sensor gain, offset and linearity with confidence; pairs off the line are refused, each
    by its name.
    """
    read = read_pairs(pairs)
    found = fit_line(read.displacement_mm, read.voltage_v, gauge_error_mm=gauge_error_mm, names=read.names)
    if found.refused and strict:
        raise BadInput("; ".join(str(pair) for pair in found.refused) + "; allowed: pairs on one line")
    for pair in found.refused:
        sys.stderr.write(f"tactuator: refused: {pair}\n")
    answer(document(found), as_json, _table(found))


def document(found: Calibration) -> dict[str, Any]:
    """Return the answer that `--json` prints."""
    return {
        "sensor_gain_v_per_mm": found.gain_v_per_mm,
        "sensor_gain_confidence_v_per_mm": found.gain_confidence_v_per_mm,
        "offset_v": found.offset_v,
        "offset_confidence_v": found.offset_confidence_v,
        "linearity_percent": found.linearity_percent,
        "pairs": int(found.displacement_mm.size),
        "refused": [vars(pair) for pair in found.refused],
    }


def _table(found: Calibration) -> Table:
    table = Table("what", "value", "±95 %", title=f"{found.displacement_mm.size} pairs, {len(found.refused)} refused")
    table.add_row("gain (V/mm)", *with_error(found.gain_v_per_mm, found.gain_confidence_v_per_mm))
    table.add_row("offset (V)", *with_error(found.offset_v, found.offset_confidence_v))
    table.add_row("largest departure from the line (% of span)", f"{found.linearity_percent:.2f}", "")
    return table
