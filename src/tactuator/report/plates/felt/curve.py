"""Figure 1: a threshold curve with its comfort range."""

from __future__ import annotations

import numpy as np

from tactuator.perception.curve import COMFORT_DB_SL, ThresholdCurve
from tactuator.report.plate import Plate
from tactuator.report.style import BLUE, INK, ORANGE, figure, frequency_axis


def threshold_plate(curve: ThresholdCurve, name: str = "fig01") -> Plate:
    """Draw the level of the threshold (dB re 1 um peak) against frequency, and the range up to comfort above it."""
    low, high = float(curve.frequency_hz[0]), float(curve.frequency_hz[-1])
    frequency = np.geomspace(low, high, 400)
    level = curve.level_db_re_1um_at(frequency)
    made, axes = figure(height_in=3.6)
    axes.fill_between(frequency, level, level + COMFORT_DB_SL, color=ORANGE, alpha=0.14, linewidth=0)
    axes.plot(frequency, level, color=BLUE, linewidth=1.8)
    axes.plot(frequency, level + COMFORT_DB_SL, color=ORANGE, linewidth=1.0, linestyle="--")
    axes.plot(curve.frequency_hz, curve.level_db_re_1um, "o", color=BLUE, markersize=3.5)
    middle = np.sqrt(low * high)
    at = float(curve.level_db_re_1um_at(middle))
    axes.annotate("threshold, 0 dB SL", (middle, at), (0, -14), textcoords="offset points", fontsize=8, ha="right")
    axes.text(middle, at + COMFORT_DB_SL + 1.5, f"comfort, {COMFORT_DB_SL:g} dB SL", fontsize=8, color=INK)
    frequency_axis(axes, low, high)
    axes.set_ylabel("peak displacement (dB re 1 µm)", fontsize=9)
    caption = (
        f"Human detection threshold, curve “{curve.name}” ({curve.provenance}: {curve.source}), and the range of "
        f"comfortable levels above it. Points: the curve's own; lines: linear in dB over log frequency."
    )
    table = {"frequency_hz": curve.frequency_hz.tolist(), "level_db_re_1um": curve.level_db_re_1um.tolist()}
    return Plate(name, "Human detection threshold", caption, made, table)
