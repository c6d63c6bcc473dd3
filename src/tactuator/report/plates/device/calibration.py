"""Figure 5: sensor voltage against displacement, the fitted line, and what is left over."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tactuator.identification.calibration import Calibration
from tactuator.report.plate import Plate
from tactuator.report.style import CYCLE, INK, figure, legend


def calibration_plate(found: Mapping[str, Calibration], name: str = "fig05") -> Plate:
    """Draw pairs and lines of one or more channels above, residuals in millivolts below; refused pairs are crossed."""
    made, (upper, lower) = figure(2, 1, height_in=4.6, sharex=True, gridspec_kw={"height_ratios": (2.2, 1.0)})
    table: dict[str, list[object]] = {"channel": [], "displacement_mm": [], "voltage_v": [], "residual_v": []}
    for colour, (channel, one) in zip(CYCLE, found.items(), strict=False):
        ends = np.array([one.displacement_mm.min(), one.displacement_mm.max()])
        label = f"{channel}: {one.gain_v_per_mm:.5f} ± {one.gain_confidence_v_per_mm:.5f} V/mm"
        upper.plot(ends, one.gain_v_per_mm * ends + one.offset_v, color=colour, linewidth=1.0, label=label)
        upper.plot(one.displacement_mm, one.voltage_v, "o", color=colour, markersize=3.5, fillstyle="none")
        lower.plot(one.displacement_mm, 1e3 * one.residual_v, "o", color=colour, markersize=3.5, fillstyle="none")
        for refused in one.refused:
            upper.plot(refused.displacement_mm, refused.voltage_v, "x", color=INK)
        columns = (one.displacement_mm, one.voltage_v, one.residual_v)
        for row in zip(*(column.tolist() for column in columns), strict=True):
            for cells, cell in zip(table.values(), (channel, *row), strict=True):
                cells.append(cell)
    upper.set_ylabel("sensor (V)", fontsize=9)
    lower.set_ylabel("residual (mV)", fontsize=9)
    lower.set_xlabel("displacement at the fingerpad interface (mm)", fontsize=9)
    lower.axhline(0.0, color=INK, linewidth=0.6)
    legend(upper, loc="upper left")
    worst = max(one.linearity_percent for one in found.values())
    caption = (
        "Sensor voltage against displacement read with a dial gauge, least-squares line, gain with its 95 % "
        f"confidence; linear within {worst:.2f} % of the span."
    )
    return Plate(name, "Calibration of sensor gain", caption, made, table)
