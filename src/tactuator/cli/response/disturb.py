"""The verb `disturb`: the effect of a pressing, lifting or trembling finger on the position."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from tactuator.cli.answer import answer, working
from tactuator.cli.chosen import chosen_controller, require_stable
from tactuator.cli.response.measure import frequencies
from tactuator.errors import BadInput
from tactuator.measure.disturbance import DisturbanceReport, disturbance
from tactuator.rig.open import open_rig


def run(
    display: Path | None,
    controller: Path | None,
    channel: list[str] | None,
    frequency: str,
    excursion_mm: float,
    rig: str,
    seed: int,
    as_json: bool,
) -> None:
    """Press, lift and tremble at the finger port; rejection against frequency beside S."""
    made = chosen_controller(display, controller)
    require_stable(made)
    names = channel or [one.name for one in made.channels]
    reports = []
    with open_rig(rig, made.display, seed) as opened:
        finger = getattr(opened, "finger", None)
        if finger is None:
            raise BadInput(f"rig {rig!r} has no finger port to press at", "one that has")
        opened.load(made)
        rng = np.random.default_rng(seed)
        for name in names:
            with working(f"disturbing {name}"):
                report = disturbance(
                    opened, finger(name), made, name, frequencies(frequency), rng, excursion_mm=excursion_mm
                )
            reports.append(report)
    answer({"channels": [document(one) for one in reports]}, as_json, _table(reports))


def document(report: DisturbanceReport) -> dict[str, Any]:
    """Return one channel as `--json` prints it."""
    return {
        "channel": report.channel,
        "unit": report.unit,
        "rejection": vars(report.rejection),
        "press": vars(report.press),
        "tremor": vars(report.tremor),
    }


def _table(reports: list[DisturbanceReport]) -> Table:
    table = Table("channel", "disturbance", "measured", "expected")
    for report in reports:
        rejection = report.rejection
        for k in range(rejection.frequency_hz.size):
            measured = f"{rejection.measured_db[k]:.2f} ± {rejection.confidence_db[k]:.2g} dB"
            expected = f"{rejection.expected_db[k]:.2f} dB"
            table.add_row(report.channel, f"{rejection.frequency_hz[k]:g} Hz", measured, expected)
        press, tremor = report.press, report.tremor
        table.add_row(
            report.channel,
            "press",
            f"{press.peak_mm:.3g} {report.unit}, within a tenth after {press.recovery_s:.2f} s",
            f"{press.without_loop_mm:.3g} {report.unit} without the loop",
        )
        table.add_row(report.channel, "lift", f"{press.lift_peak_mm:.3g} {report.unit}", "")
        table.add_row(report.channel, "tremor 4–12 Hz", f"{tremor.rejection_db:.2f} dB", f"{tremor.expected_db:.2f} dB")
    return table
