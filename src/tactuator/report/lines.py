"""Lines into axes that somebody else may have made: what `plot(ax=None)` of a result draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib import pyplot
from matplotlib.axes import Axes as Axes
from numpy.typing import ArrayLike


@dataclass(frozen=True)
class Lines:
    """Lines of one pair of axes. each: label, x, y; x_label, y_label: with their units; points: marks and no lines."""

    x_label: str
    y_label: str
    each: Sequence[tuple[str, ArrayLike, ArrayLike]]
    log_x: bool = False
    points: bool = False


def draw(lines: Lines, ax: Axes | None = None) -> Axes:
    """Draw the lines into `ax`, or into pyplot's current axes, and return the axes."""
    axes = pyplot.gca() if ax is None else ax
    for label, x, y in lines.each:
        axes.plot(x, y, "o" if lines.points else "-", label=label)
    if lines.log_x:
        axes.set_xscale("log")
    axes.set_xlabel(lines.x_label)
    axes.set_ylabel(lines.y_label)
    if len(lines.each) > 1:
        axes.legend()
    return axes
