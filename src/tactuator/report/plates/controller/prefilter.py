"""Error that prefilters leave between the response and the curve."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.report.plate import Plate
from tactuator.report.style import CYCLE, FAINT, INK, figure, frequency_axis, legend

Errors = Mapping[str, tuple[FloatArray, FloatArray]]
"""By name: frequency_hz (n,) and the error of |H| there, dB (n,)."""


def prefilter_plate(errors: Errors, tolerance_db: float, name: str = "prefilter") -> Plate:
    """Draw the error of |H| against the curve for every prefilter, with the tolerance as a band."""
    made, axes = figure(height_in=3.4)
    low = min(float(frequency.min()) for frequency, _ in errors.values())
    high = max(float(frequency.max()) for frequency, _ in errors.values())
    axes.axhspan(-tolerance_db, tolerance_db, color=FAINT, alpha=0.3, linewidth=0)
    axes.axhline(0.0, color=INK, linewidth=0.6)
    table: dict[str, list[object]] = {"prefilter": [], "frequency_hz": [], "error_db": []}
    for colour, (label, (frequency, error)) in zip(CYCLE, errors.items(), strict=False):
        worst = float(np.max(np.abs(error)))
        axes.plot(frequency, error, color=colour, linewidth=1.3, label=f"{label}: at most {worst:.2f} dB")
        table["prefilter"] += [label] * frequency.size
        table["frequency_hz"] += frequency.tolist()
        table["error_db"] += error.tolist()
    frequency_axis(axes, low, high)
    axes.set_ylabel("|H| less curve (dB)", fontsize=9)
    legend(axes, loc="lower left")
    caption = f"Error of the response against the threshold curve; the band is the tolerance of ±{tolerance_db:g} dB."
    return Plate(name, "Prefilters against the curve", caption, made, table)
