"""Block diagrams: boxes on a grid joined by arrows, with the configuration's own numbers in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch

from tactuator.report.style import BLUE, INK, WIDTH_IN

Point = tuple[float, float]


@dataclass(frozen=True)
class Box:
    """A block: its centre, size, name (bold) and lines of small print."""

    centre: Point
    name: str
    lines: tuple[str, ...] = ()
    width: float = 1.7
    height: float = 1.0

    @property
    def left(self) -> Point:
        """Return the middle of the left edge."""
        return (self.centre[0] - self.width / 2.0, self.centre[1])

    @property
    def right(self) -> Point:
        """Return the middle of the right edge."""
        return (self.centre[0] + self.width / 2.0, self.centre[1])

    @property
    def top(self) -> Point:
        """Return the middle of the upper edge."""
        return (self.centre[0], self.centre[1] + self.height / 2.0)

    @property
    def bottom(self) -> Point:
        """Return the middle of the lower edge."""
        return (self.centre[0], self.centre[1] - self.height / 2.0)


def canvas(width: float, height: float) -> tuple[Figure, Axes]:
    """Return an empty drawing of width by height grid units, without axes."""
    made = Figure(figsize=(WIDTH_IN, WIDTH_IN * height / width))
    axes = made.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(0.0, width)
    axes.set_ylim(0.0, height)
    axes.axis("off")
    return made, axes


def draw_box(axes: Axes, box: Box) -> None:
    """Draw a block with its name above its small print."""
    corner = (box.centre[0] - box.width / 2.0, box.centre[1] - box.height / 2.0)
    style = "round,pad=0,rounding_size=0.06"
    axes.add_patch(FancyBboxPatch(corner, box.width, box.height, style, facecolor="#f3f7fb", edgecolor=BLUE))
    pitch = 0.2
    start = box.centre[1] + pitch * len(box.lines) / 2.0
    axes.text(box.centre[0], start, box.name, ha="center", va="center", fontsize=9, weight="bold", color=INK)
    for index, line in enumerate(box.lines, start=1):
        axes.text(box.centre[0], start - pitch * index, line, ha="center", va="center", fontsize=7, color=INK)


def draw_sum(axes: Axes, centre: Point, signs: str = "") -> None:
    """Draw a summing junction with its signs at its lower left."""
    axes.add_patch(Circle(centre, 0.13, facecolor="white", edgecolor=INK, zorder=3))
    axes.text(centre[0] - 0.17, centre[1] - 0.24, signs, ha="center", fontsize=9, color=INK)


def draw_path(axes: Axes, points: Sequence[Point], label: str = "", above: float = 0.1) -> None:
    """Draw a line through the points, an arrow at its end, and a label over the middle of its first stretch."""
    for start, end in pairwise(points[:-1]):
        axes.plot([start[0], end[0]], [start[1], end[1]], color=INK, linewidth=1.0, zorder=1)
    arrow = {"arrowstyle": "-|>", "color": INK, "shrinkA": 0, "shrinkB": 0, "linewidth": 1.0}
    axes.annotate("", points[-1], points[-2], arrowprops=arrow)
    if label:
        x, y = (points[0][0] + points[1][0]) / 2.0, (points[0][1] + points[1][1]) / 2.0
        axes.text(x, y + above, label, ha="center", va="bottom", fontsize=8, style="italic", color=INK)
