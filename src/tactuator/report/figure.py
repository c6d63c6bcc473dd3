"""A figure with its caption and the numbers that it shows, in the style that all have: one size of type, colours that
stay apart in print and for colour-blind readers.
"""

import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.io.atomic import atomic_folder
from tactuator.io.csv_text import csv_text
from tactuator.result import NOBODY_FELT_IT

INK, FAINT = "#222222", "#b8b8b8"
BLUE, ORANGE, GREEN, RED, PURPLE, SKY = "#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7", "#56b4e9"
CYCLE = (BLUE, RED, GREEN, PURPLE, ORANGE, SKY)
"""Okabe and Ito's palette."""

WIDTH_IN = 6.4
_DECADES_HZ = (0.1, 1.0, 10.0, 100.0, 1000.0, 10000.0)
_TICKS_HZ = sorted(factor * decade for factor in (1, 2, 5) for decade in _DECADES_HZ)


def subplots(rows: int = 1, columns: int = 1, height_in: float = 4.0, **subplots: Any) -> tuple[Figure, Any]:
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


LINE_STYLES = ("-", "--", "-.", ":")
"""Styles of curves in turn."""


def phase_deg(response: ComplexArray) -> FloatArray:
    """Return the continuous phase of a response (n,), degrees."""
    return np.degrees(np.unwrap(np.angle(response)))


def frequency_axis(axes: Axes, low_hz: float, high_hz: float, y_label: str = "", *, label: bool = True,
                   decades: bool = False) -> None:  # fmt: skip
    """Set a logarithmic frequency axis from low to high, marked 1-2-5 (or at decades) in plain numbers, and the label
    of the other.
    """
    axes.set_xscale("log")
    axes.set_xlim(low_hz, high_hz)
    ticks: Sequence[float] = [tick for tick in (_DECADES_HZ if decades else _TICKS_HZ) if low_hz <= tick <= high_hz]
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())  # a third of the time that drawing takes
    if label:
        axes.set_xlabel("frequency (Hz)", fontsize=9)
    if y_label:
        axes.set_ylabel(y_label, fontsize=9)


def legend(axes: Axes, **keywords: Any) -> None:
    """Add a small legend without a frame."""
    axes.legend(**({"fontsize": 8, "frameon": False} | keywords))


@dataclass(frozen=True, eq=False)
class ReportFigure:
    """A figure with its name and table.

    name: file name without ending. drawing: of matplotlib, or the SVG of a diagram. table: columns of equal length,
    name (with unit) to values. simulated: nobody felt what it shows, which figure and table say themselves.
    """

    name: str
    title: str
    caption: str
    drawing: Figure | str
    table: Mapping[str, Sequence[object]]
    simulated: bool = False

    def __post_init__(self) -> None:
        if self.simulated and isinstance(self.drawing, Figure):
            self.drawing.suptitle(NOBODY_FELT_IT, fontsize=9, color=RED)
            rows = max((len(column) for column in self.table.values()), default=0)
            object.__setattr__(self, "table", {**self.table, "simulated": ["simulated"] * rows})
        lengths = {name: len(column) for name, column in self.table.items()}
        if len(set(lengths.values())) > 1:
            raise BadInput(f"columns of {self.name} have {lengths} rows", "as many in each")

    def svg(self) -> str:
        """Return the figure as SVG text: the same figure gives the same bytes, and looks the same with any fonts.

        It is drawn the first time that it is asked for, and once: `savefig` would draw it twice, to lay it out first.
        """
        return self._drawn

    @cached_property
    def _drawn(self) -> str:
        if isinstance(self.drawing, str):
            return self.drawing
        with matplotlib.rc_context({"svg.hashsalt": self.name, "svg.fonttype": "path"}), io.StringIO() as stream:
            about = {"Date": None, "Creator": "tactuator", **({"Title": NOBODY_FELT_IT} if self.simulated else {})}
            FigureCanvasSVG(self.drawing).print_svg(stream, metadata=about)  # type: ignore[no-untyped-call]
            return stream.getvalue()

    def csv(self) -> str:
        """Return the table as CSV text, floats with nine digits."""
        return csv_text(self.table, zip(*self.table.values(), strict=True), digits=9)


def table_of(names: Sequence[str], rows: Iterable[Sequence[object]]) -> dict[str, list[object]]:
    """Return rows as the columns of a figure's table, by name."""
    columns = list(zip(*rows, strict=True)) or [()] * len(names)
    return {name: list(cells) for name, cells in zip(names, columns, strict=True)}


def labelled(labels: tuple[object, ...], *columns: NDArray[Any]) -> Iterator[tuple[object, ...]]:
    """Yield the rows of columns (n,), each with the same labels before it."""
    for row in zip(*(column.tolist() for column in columns), strict=True):
        yield (*labels, *row)


def save_figures(figures: Iterable[ReportFigure], folder: Path, names: Iterable[str] | None = None) -> None:
    """Write every figure's figure (SVG) and numbers (CSV) into `folder`, whole or not at all.

    names: of figures that are drawn as they are saved, so that not all of them are in memory. Raises BadInput for a
    folder that holds anything else.
    """
    if names is None:
        figures = list(figures)
        names = [figure.name for figure in figures]
    own_names = frozenset(f"{name}.{ending}" for name in names for ending in ("svg", "csv"))
    with atomic_folder(folder, own_names) as beside:
        for figure in figures:
            (beside / f"{figure.name}.svg").write_text(figure.svg(), encoding="utf-8")
            (beside / f"{figure.name}.csv").write_text(figure.csv(), encoding="utf-8")
