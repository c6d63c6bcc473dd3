"""The style of every figure: one size of type, colours that stay apart in print and for colour-blind readers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

from tactuator.arrays import ComplexArray, FloatArray

INK, FAINT = "#222222", "#b8b8b8"
BLUE, ORANGE, GREEN, RED, PURPLE, SKY = "#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7", "#56b4e9"
CYCLE = (BLUE, RED, GREEN, PURPLE, ORANGE, SKY)
"""Okabe and Ito's palette."""

WIDTH_IN = 6.4
_TICKS_HZ = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000)


def figure(rows: int = 1, columns: int = 1, height_in: float = 4.0, **subplots: Any) -> tuple[Figure, Any]:
    """Return a figure of the house's width, and its axes as `Figure.subplots(rows, columns, **subplots)` gives them."""
    drawing = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
    panels = drawing.subplots(rows, columns, **subplots)
    for axes in drawing.axes:
        house(axes)
        axes.tick_params(labelsize=8, colors=INK)
    return drawing, panels


def house(axes: Axes) -> None:
    """Give axes the grid and the two spines that every figure has."""
    axes.grid(True, color="#e3e3e3", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def line_style(index: int) -> str:
    """Return the line style of the curve of that number."""
    return ("-", "--", "-.", ":")[index % 4]


def phase_deg(response: ComplexArray) -> FloatArray:
    """Return the continuous phase of a response (n,), degrees."""
    return np.degrees(np.unwrap(np.angle(response)))


def frequency_axis(axes: Axes, low_hz: float, high_hz: float, y_label: str = "", label: bool = True) -> None:
    """Set a logarithmic frequency axis from low to high, marked 1-2-5 in plain numbers, and the label of the other."""
    axes.set_xscale("log")
    axes.set_xlim(low_hz, high_hz)
    ticks: Sequence[float] = [tick for tick in _TICKS_HZ if low_hz <= tick <= high_hz]
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    if label:
        axes.set_xlabel("frequency (Hz)", fontsize=9)
    if y_label:
        axes.set_ylabel(y_label, fontsize=9)


def legend(axes: Axes, **keywords: Any) -> None:
    """Add a small legend without a frame."""
    axes.legend(**({"fontsize": 8, "frameon": False} | keywords))
