"""A chart on axes that somebody else may have made: what `plot(ax=None)` of a result draws, and levels in figures."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib import pyplot
from matplotlib.axes import Axes as Axes
from matplotlib.figure import Figure

from tactuator.arrays import FloatArray
from tactuator.report.plate import (
    CYCLE,
    FAINT,
    GREEN,
    INK,
    ORANGE,
    RED,
    Plate,
    frequency_axis,
    house,
    labelled,
    legend,
    table_of,
)
from tactuator.table import NOBODY_FELT_IT, Chart, ChartLine


def draw(chart: Chart, ax: Axes | None = None) -> Axes:
    """Draw the chart with its legend into `ax`, or into pyplot's current axes, and return the axes."""
    axes = pyplot.gca() if ax is None else ax
    if ax is None and pyplot.gcf().get_layout_engine() is None:
        pyplot.gcf().set_layout_engine("constrained")  # the legend stands above the axes, where it covers nothing
    house(axes)
    right = axes.twinx() if chart.right_label else axes
    draw_levels(axes, chart)
    for number, curve in enumerate(chart.curves):
        draw_curve(right if curve.right else axes, curve, number)
    if chart.simulated:
        axes.text(0.99, 0.02, NOBODY_FELT_IT, color=RED, fontsize=9, ha="right", transform=axes.transAxes)
    axes.set_xlabel(chart.x_label)
    axes.set_ylabel(chart.y_label)
    if chart.right_label:
        right.set_ylabel(chart.right_label)
        axes.set_zorder(right.get_zorder() + 1.0)
        axes.patch.set_visible(False)
    if chart.log_y:
        axes.set_yscale("log")
    if chart.log_x:
        low, high = span([curve.x for curve in chart.curves])
        frequency_axis(axes, low, high, label=False)
    handles = [handle for part in dict.fromkeys((axes, right)) for handle in part.get_legend_handles_labels()[0]]
    if len(handles) > 1:
        above = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.2, "columnspacing": 1.2}
        legend(axes, handles=handles, ncols=2 if len(handles) in (2, 4) else 3, **above)
    return axes


def chart_plate(chart: Chart, name: str, caption: str = "") -> Plate:
    """Return the chart as a figure of its own, with the numbers of every curve."""
    figure = Figure(figsize=(6.6, 3.6), layout="constrained")
    draw(replace(chart, simulated=False), figure.add_subplot())  # the plate says it above
    rows = (row for curve in chart.curves for row in labelled((curve.label,), np.asarray(curve.x), np.asarray(curve.y)))
    heads = ("curve", chart.x_label, chart.y_label)
    return Plate(name, name, caption, figure, table_of(heads, rows), chart.simulated)


def span(columns: list[FloatArray]) -> tuple[float, float]:
    """Return the ends of an axis of frequencies, a little beyond those of the columns."""
    values = np.concatenate([np.asarray(column, dtype=np.float64) for column in columns])
    return float(values.min()) / 1.1, float(values.max()) * 1.1


def draw_levels(axes: Axes, chart: Chart) -> None:
    """Draw what the curves are held against: targets with their tolerance and just-noticeable difference, limits."""
    for number, target in enumerate(chart.targets):
        first = number == 0
        if chart.jnd is not None:
            words = f"below the JND of {chart.jnd:g} dB" if first else None
            axes.axhspan(
                target - chart.jnd, target + chart.jnd, color=FAINT, alpha=0.3, linewidth=0.0, label=words, zorder=0
            )
        for sign in (-1.0, 1.0) if chart.tolerance is not None else ():
            words = f"tolerance ±{chart.tolerance:g} dB" if first and sign > 0.0 else None
            edge = target + sign * (chart.tolerance or 0.0)
            axes.axhline(edge, color=GREEN, linewidth=0.9, linestyle="--", label=words, zorder=1)
        axes.axhline(target, color=INK, linewidth=0.8, label="asked" if first else None, zorder=1)
    for words, level in chart.limits.items():
        axes.axhline(level, color=ORANGE, linewidth=1.0, linestyle="--", label=words, zorder=1)
    for words, place in chart.upright.items():
        axes.axvline(place, color=ORANGE, linewidth=1.0, linestyle="--", label=words, zorder=1)


def draw_curve(axes: Axes, curve: ChartLine, number: int = 0) -> None:
    """Draw a curve in the colour of its place, with its confidence; points that do not count are crossed out."""
    colour = CYCLE[(number if curve.colour is None else curve.colour) % len(CYCLE)]
    x, y = np.asarray(curve.x), np.asarray(curve.y)
    kept = np.ones(x.shape, dtype=bool) if curve.crossed is None else ~np.asarray(curve.crossed, dtype=bool)
    marked = any(mark in curve.style for mark in "osD^x.")
    how: dict[str, Any] = {
        "color": colour,
        "markersize": 4,
        "linewidth": 1.4,
        "label": curve.label or None,
        "fillstyle": "none",
    }
    if curve.half is not None and marked:
        half = np.asarray(curve.half)[..., kept]
        axes.errorbar(x[kept], y[kept], half, fmt=curve.style, elinewidth=0.8, capsize=1.5, **how)
    else:
        axes.plot(x[kept], y[kept], curve.style, **how)
        if curve.half is not None:
            low, high = y - np.asarray(curve.half), y + np.asarray(curve.half)
            axes.fill_between(x, low, high, color=colour, alpha=0.2, linewidth=0.0)
    if not kept.all():
        axes.plot(x[~kept], y[~kept], "x", color=INK, markersize=5)
