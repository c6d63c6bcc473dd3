"""Sensitivity and complementary sensitivity of a loop, with what the display file asks of them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes

from tactuator.arrays import FloatArray
from tactuator.model.requirements import FeedbackRequirements
from tactuator.report.plate import Plate
from tactuator.report.plates.controller.envelope import by_load
from tactuator.report.style import BLUE, INK, ORANGE, RED, figure, frequency_axis, legend
from tactuator.signals.decibels import db
from tactuator.signals.loop import FeedbackLoop


def sensitivity_plate(
    loops: Mapping[str, FeedbackLoop],
    requirements: FeedbackRequirements,
    band_hz: tuple[float, float],
    name: str = "sensitivity",
    title: str = "Sensitivity",
) -> Plate:
    """Draw |S| and |T| in dB for each load, the limits as bars (the curves must stay below them).

    loops: by the name of their plant; the models of one load are one envelope around its nominal line.
    """
    frequency = np.geomspace(*band_hz, 600)
    made, axes = figure(height_in=4.2)
    table: dict[str, list[float]] = {"frequency_hz": frequency.tolist()}
    for index, (load, names) in enumerate(by_load(list(loops)).items()):
        style = ("-", "--", "-.", ":")[index % 4]
        words = "no load" if load == "none" else load
        for symbol, colour in (("S", BLUE), ("T", RED)):
            levels = np.array([_level_db(loops[name], symbol, frequency) for name in names])
            axes.plot(frequency, levels[0], color=colour, linestyle=style, label=f"|{symbol}|, {words}")
            table[f"{symbol} {load} dB"] = levels[0].tolist()
            if len(names) > 1:
                low, high = levels.min(axis=0), levels.max(axis=0)
                axes.fill_between(frequency, low, high, color=colour, alpha=0.18, linewidth=0.0, zorder=1)
                table |= {f"{symbol} {load} least dB": low.tolist(), f"{symbol} {load} greatest dB": high.tolist()}
    axes.axhline(0.0, color=INK, linewidth=0.7)
    _limits(axes, requirements)
    frequency_axis(axes, *band_hz)
    axes.set_ylim(bottom=max(axes.get_ylim()[0], -60.0))
    axes.set_ylabel("magnitude (dB)", fontsize=9)
    legend(axes, loc="lower center", ncols=2)
    caption = "Sensitivity S and complementary sensitivity T; bars: the limits of the display file, to stay below."
    if len(loops) > len(by_load(list(loops))):
        caption += " Shaded: every model of the family."
    return Plate(name, title, caption, made, table)


def _level_db(loop: FeedbackLoop, symbol: str, frequency_hz: FloatArray) -> FloatArray:
    return db(loop.sensitivity(frequency_hz) if symbol == "S" else loop.complementary(frequency_hz))


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
