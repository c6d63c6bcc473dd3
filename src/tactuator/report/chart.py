"""Charts: one on any axes, as `plot(ax=None)` of a result draws it, or panels of them as a figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib import pyplot
from matplotlib.axes import Axes as Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from tactuator.arrays import FloatArray
from tactuator.report.figure import (
    CYCLE,
    FAINT,
    GREEN,
    INK,
    ORANGE,
    RED,
    ReportFigure,
    frequency_axis,
    house,
    labelled,
    legend,
    subplots,
    table_of,
)
from tactuator.result import NOBODY_FELT_IT, Chart, ChartLine

_LEGEND_LETTERS, _MARK_LETTERS = 100, 5
"""Letters of 7.5 points that the house's width takes, and those that a mark and its space are as wide as."""


def draw(chart: Chart, ax: Axes | None = None) -> Axes:
    """Draw the chart with its legend into `ax`, or into pyplot's current axes, and return the axes."""
    axes = pyplot.gca() if ax is None else ax
    if ax is None and pyplot.gcf().get_layout_engine() is None:
        pyplot.gcf().set_layout_engine("constrained")  # the legend is above the axes, where it covers nothing
    house(axes)
    handles = _draw_chart(axes, chart)
    if len(handles) > 1:
        above = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.2, "columnspacing": 1.2}
        legend(axes, handles=handles.values(), ncols=2 if len(handles) in (2, 4) else 3, **above)
    return axes


def chart_figure(chart: Chart, name: str, caption: str = "") -> ReportFigure:
    """Return the chart as a separate figure, with the numbers of every curve."""
    drawing = panels([[replace(chart, simulated=False)]], 3.6)  # the figure says it above
    rows = (row for curve in chart.curves for row in labelled((curve.label,), np.asarray(curve.x), np.asarray(curve.y)))
    heads = ("curve", chart.x_label, chart.y_label)
    return ReportFigure(name, name, caption, drawing, table_of(heads, rows), chart.simulated)


def panels(charts: Sequence[Sequence[Chart]], height_in: float, ratios: Sequence[float] | None = None) -> Figure:
    """Return rows of charts as a figure with one legend below. Charts of a row share their y, of a column their x;
    labels are at the edges.

    ratios: of the rows' heights.
    """
    rows, columns = len(charts), len(charts[0])
    same_y = len({chart.y_label for chart in charts[0]}) == 1
    shared: dict[str, Any] = {"sharex": "col", "sharey": "row" if same_y else False}
    drawing, grid = subplots(rows, columns, height_in, squeeze=False, height_ratios=ratios, **shared)
    handles: dict[str, Any] = {}
    for place, (row, axes_of_row) in enumerate(zip(charts, grid, strict=True)):
        for column, (chart, axes) in enumerate(zip(row, axes_of_row, strict=True)):
            handles = _draw_chart(axes, chart, is_narrow=columns > 1) | handles
            axes.xaxis.label.set_visible(place == rows - 1)
            axes.yaxis.label.set_visible(column == 0 or not same_y)
    if handles:
        columns = max(1, min(4, _LEGEND_LETTERS // (max(map(len, handles)) + _MARK_LETTERS)))
        below: dict[str, Any] = {"loc": "outside lower center", "ncols": columns, "columnspacing": 1.2}
        drawing.legend(handles.values(), handles, fontsize=7.5, frameon=False, **below)
    return drawing


def _draw_chart(axes: Axes, chart: Chart, is_narrow: bool = False) -> dict[str, Any]:
    """Draw a chart without its legend, and return the handles of that by their labels."""
    right = axes.twinx() if chart.right_label else axes
    draw_levels(axes, chart)
    for number, curve in enumerate(chart.curves):
        _draw_curve(right if curve.right else axes, curve, number)
    if chart.simulated:
        axes.text(0.99, 0.02, NOBODY_FELT_IT, color=RED, fontsize=9, ha="right", transform=axes.transAxes)
    axes.set_xlabel(chart.x_label, fontsize=9)
    axes.set_ylabel(chart.y_label, fontsize=9)
    axes.set_title(chart.title, fontsize=9)
    if chart.right_label:
        right.set_ylabel(chart.right_label)
        axes.set_zorder(right.get_zorder() + 1.0)
        axes.patch.set_visible(False)
    if chart.log_y:
        axes.set_yscale("log")
    if chart.log_x:
        low, high = span([curve.x for curve in chart.curves])
        frequency_axis(axes, low, high, label=False, decades=is_narrow)
    if chart.y_range != (None, None):  # any other range is left to all that share the axis
        axes.set_ylim(*chart.y_range)
    if chart.y_step:
        axes.yaxis.set_major_locator(MultipleLocator(chart.y_step))
    pairs = [axes.get_legend_handles_labels() for axes in dict.fromkeys((axes, right))]
    return {label: handle for handles, labels in pairs for handle, label in zip(handles, labels, strict=True)}


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
    levels: tuple[tuple[Mapping[str, float], Any], ...] = ((chart.limits, axes.axhline), (chart.upright, axes.axvline))
    for places, line in levels:
        for words, place in places.items():
            line(place, color=ORANGE, linewidth=1.0, linestyle="--", label=words, zorder=1)
    for words, ends in chart.stretches.items():
        axes.axvspan(*ends, color=FAINT, alpha=0.3, linewidth=0.0, label=words)


def _draw_curve(axes: Axes, curve: ChartLine, number: int) -> None:
    """Draw a curve in its colour, with its confidence; points that do not count are crossed out."""
    place = number if curve.colour is None else curve.colour
    colour = CYCLE[place % len(CYCLE)] if isinstance(place, int) else place
    x, y = np.asarray(curve.x), np.asarray(curve.y)
    kept = np.ones(x.shape, dtype=bool) if curve.crossed is None else ~np.asarray(curve.crossed, dtype=bool)
    marked = any(mark in curve.style for mark in "osD^v<>x.")
    how: dict[str, Any] = {
        "color": colour,
        "markersize": 4,
        "linewidth": curve.width,
        "label": curve.label or None,
        "fillstyle": "none",
    }
    if curve.half is not None and marked:
        half = np.asarray(curve.half)[..., kept]
        axes.errorbar(x[kept], y[kept], half, fmt=curve.style, elinewidth=0.8, capsize=1.5, **how)
    else:
        axes.plot(x[kept], y[kept], curve.style, **how)
        if curve.half is not None:
            below, above = np.broadcast_to(curve.half, (2, y.size))
            axes.fill_between(x, y - below, y + above, color=colour, alpha=0.2, linewidth=0.0)
    if not kept.all():
        axes.plot(x[~kept], y[~kept], "x", color=INK, markersize=5)
