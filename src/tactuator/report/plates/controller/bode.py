"""Bode diagrams: magnitude and phase of one or several systems."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.ticker import MultipleLocator

from tactuator.report.plate import Plate
from tactuator.report.style import CYCLE, figure, frequency_axis, legend
from tactuator.signals.decibels import db
from tactuator.signals.loop import System


def bode_plate(
    systems: Mapping[str, System], band_hz: tuple[float, float], name: str = "bode", title: str = "Bode diagram"
) -> Plate:
    """Draw magnitude (dB) and phase (degrees, continuous) of each system by its label, over band_hz."""
    frequency = np.geomspace(*band_hz, 600)
    made, (upper, lower) = figure(2, 1, height_in=5.0, sharex=True)
    table: dict[str, list[float]] = {"frequency_hz": frequency.tolist()}
    for index, (label, system) in enumerate(systems.items()):
        response = system.response(frequency)
        level, phase = db(response), np.degrees(np.unwrap(np.angle(response)))
        phase = phase - 360.0 * np.ceil((phase[0] - 180.0) / 360.0)
        style = {"color": CYCLE[index % len(CYCLE)], "linestyle": ("-", "--", "-.", ":")[index % 4]}
        upper.plot(frequency, level, label=label, **style)
        lower.plot(frequency, phase, **style)
        table[f"{label} dB"], table[f"{label} deg"] = level.tolist(), phase.tolist()
    upper.set_ylabel("magnitude (dB)", fontsize=9)
    lower.set_ylabel("phase (degrees)", fontsize=9)
    lower.yaxis.set_major_locator(MultipleLocator(90.0))
    frequency_axis(lower, *band_hz)
    legend(upper)
    caption = f"Magnitude and phase of {', '.join(systems)}."
    return Plate(name, title, caption, made, table)
