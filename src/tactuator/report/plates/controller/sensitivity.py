"""Sensitivity and complementary sensitivity of a loop, with what the display file asks of them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes

from tactuator.display.requirements import FeedbackRequirements
from tactuator.loop.feedback import FeedbackLoop
from tactuator.report.plate import Plate
from tactuator.report.style import BLUE, INK, ORANGE, RED, figure, frequency_axis, legend
from tactuator.signals.decibels import db


def sensitivity_plate(
    loops: Mapping[str, FeedbackLoop],
    requirements: FeedbackRequirements,
    band_hz: tuple[float, float],
    name: str = "sensitivity",
    title: str = "Sensitivity",
) -> Plate:
    """Draw |S| and |T| in dB of each loop by its load, the limits as bars (the curves must stay below them)."""
    frequency = np.geomspace(*band_hz, 600)
    made, axes = figure(height_in=4.2)
    table: dict[str, list[float]] = {"frequency_hz": frequency.tolist()}
    for index, (load, loop) in enumerate(loops.items()):
        style = ("-", "--", "-.", ":")[index % 4]
        words = "no load" if load == "none" else load
        for symbol, colour, response in (
            ("S", BLUE, loop.sensitivity(frequency)),
            ("T", RED, loop.complementary(frequency)),
        ):
            axes.plot(frequency, db(response), color=colour, linestyle=style, label=f"|{symbol}|, {words}")
            table[f"{symbol} {load} dB"] = db(response).tolist()
    axes.axhline(0.0, color=INK, linewidth=0.7)
    _limits(axes, requirements)
    frequency_axis(axes, *band_hz)
    axes.set_ylim(bottom=max(axes.get_ylim()[0], -60.0))
    axes.set_ylabel("magnitude (dB)", fontsize=9)
    legend(axes, loc="lower center", ncols=2)
    caption = "Sensitivity S and complementary sensitivity T; bars: the limits of the display file, to stay below."
    return Plate(name, title, caption, made, table)


def _limits(axes: Axes, requirements: FeedbackRequirements) -> None:
    bars = [
        *zip(requirements.rejection_hz, requirements.rejection_max_db, strict=True),
        *zip(requirements.mains_hz, requirements.mains_max_db, strict=True),
    ]
    for frequency, limit in bars:
        axes.plot(
            [frequency / 1.12, frequency * 1.12], [limit, limit], color=ORANGE, linewidth=3.0, solid_capstyle="butt"
        )
    if requirements.sensitivity_peak is not None:
        level = float(db(requirements.sensitivity_peak))
        axes.axhline(level, color=ORANGE, linewidth=1.0, linestyle="--", label="limits")
    elif bars:
        axes.plot([], [], color=ORANGE, linewidth=3.0, label="limits")
