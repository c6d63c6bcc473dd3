"""The equality of the paper's figure 2: the display's response plus the finger's sensitivity is flat."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.model.description import Channel
from tactuator.model.load import DERIVATIVES
from tactuator.report.plate import Plate
from tactuator.report.style import BLUE, GREEN, INK, RED, figure, frequency_axis
from tactuator.signals.decibels import db


def equality_plate(
    channel: Channel,
    frequency_hz: FloatArray,
    position_response: ComplexArray,
    level_db_sl: float = 30.0,
    name: str = "equality",
    title: str = "Response + sensitivity = constant",
) -> Plate:
    """Draw three panels side by side for a reference of `level_db_sl`: the displacement that the display makes of it,
    the finger's sensitivity, and their sum, which is the felt level.

    position_response: H at frequency_hz, shape (n,), volts of y per threshold unit.
    """
    speed = (2.0 * np.pi * frequency_hz) ** DERIVATIVES[channel.quantity]
    displacement = db(np.abs(position_response) / channel.sensor_gain_v_per_mm / speed * 1e3) + level_db_sl
    sensitivity = -channel.threshold.curve.level_db_re_1um_at(frequency_hz)
    felt = displacement + sensitivity
    made = _three_panels(frequency_hz, displacement, sensitivity, level_db_sl)
    worst = float(np.max(np.abs(felt - level_db_sl)))
    caption = (
        f"A reference of {level_db_sl:g} dB SL at every frequency, channel {channel.name}: displacement (dB) plus "
        f"sensitivity (dB, the threshold curve “{channel.threshold.curve.name}” — "
        f"{channel.threshold.curve.provenance} — upside down) is felt at {level_db_sl:g} dB SL within {worst:.2f} dB."
    )
    table = {
        "frequency_hz": frequency_hz.tolist(),
        "displacement_db_re_1um": displacement.tolist(),
        "sensitivity_db": sensitivity.tolist(),
        "felt_db_sl": felt.tolist(),
    }
    return Plate(name, title, caption, made, table)


def _three_panels(
    frequency_hz: FloatArray, displacement: FloatArray, sensitivity: FloatArray, level_db_sl: float
) -> Figure:
    """Draw displacement, sensitivity and their sum side by side, the first two on axes of one span."""
    felt = displacement + sensitivity
    made, axes = figure(1, 3, height_in=2.8)
    low, high = float(frequency_hz[0]), float(frequency_hz[-1])
    panels = (
        (displacement, BLUE, "displacement", "dB re 1 µm"),
        (sensitivity, GREEN, "sensitivity", "dB re 1/µm"),
        (felt, RED, "felt level", "dB SL"),
    )
    for one, (values, colour, words, unit) in zip(axes, panels, strict=True):
        one.plot(frequency_hz, values, color=colour, linewidth=1.8)
        frequency_axis(one, low, high)
        one.xaxis.set_major_locator(_decades(low, high))
        one.set_title(words, fontsize=9)
        one.set_ylabel(unit, fontsize=8)
    axes[2].axhline(0.0, color=INK, linewidth=1.0, linestyle="--")
    axes[2].set_ylim(-8.0, level_db_sl + 12.0)
    axes[2].text(np.sqrt(low * high), 1.0, "0 dB SL", fontsize=8, ha="center", va="bottom", color=INK)
    span = _common_span(displacement, sensitivity)
    for one, values in ((axes[0], displacement), (axes[1], sensitivity)):
        centre = 0.5 * float(values.max() + values.min())
        one.set_ylim(centre - span, centre + span)
    for one, sign in ((axes[0], "+"), (axes[1], "=")):
        one.text(1.2, 1.0, sign, transform=one.transAxes, fontsize=15, ha="center", va="bottom", color=INK)
    return made


def _decades(low: float, high: float) -> FixedLocator:
    return FixedLocator([tick for tick in (0.1, 1.0, 10.0, 100.0, 1000.0) if low <= tick <= high])


def _common_span(first: FloatArray, second: FloatArray) -> float:
    return 0.5 * max(float(np.ptp(first)), float(np.ptp(second))) + 6.0
