"""Figures 9 and 10: measured output at several levels over what was expected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.measure.error import expected_v
from tactuator.model.controller import Controller
from tactuator.report.plate import Plate, save_plates
from tactuator.report.style import BLUE, INK, ORANGE, RED, dress, figure, frequency_axis
from tactuator.signals.decibels import db
from tactuator.signals.record import Response


@dataclass(frozen=True, eq=False)
class LevelResponse:
    """One channel at one level: peak volts expected and measured at frequency_hz (n,), half-width ci_db, saturation."""

    channel: str
    level_db_sl: float
    frequency_hz: FloatArray
    expected_v: FloatArray
    measured_v: FloatArray
    ci_db: FloatArray
    saturated: NDArray[np.bool_]

    @property
    def error_db(self) -> FloatArray:
        """Return the measured less the expected level, dB."""
        return db(self.measured_v) - db(self.expected_v)


def save_measured(responses: Sequence[Response], controller: Controller, folder: Path) -> None:
    """Write the figure of measured responses (SVG, with its numbers as CSV) into `folder`, whole or not at all.

    Raises BadInput for a folder that holds anything else.
    """
    runs = [
        LevelResponse(
            one.channel,
            one.level_db_sl,
            one.frequency_hz,
            expected_v(one, controller),
            one.magnitude_v,
            one.confidence_db,
            one.saturated,
        )
        for one in responses
    ]
    load = responses[0].load
    words = "without load" if load == "none" else f"under the load {load!r}"
    save_plates([response_plate(runs, words, "response", f"the nominal plant {words}")], folder)


def response_plate(
    runs: Sequence[LevelResponse], condition: str, name: str, plant: str = "the nominal plant without load"
) -> Plate:
    """Draw a panel for each channel: sensor output (dB re 1 V) against frequency, below it the error with its
    confidence; `plant`: what the expected output was computed from, in words.
    """
    channels = list(dict.fromkeys(run.channel for run in runs))
    made, grid = figure(2, len(channels), 4.8, sharex=True, sharey="row", squeeze=False, height_ratios=(2.4, 1.0))
    for column, channel in enumerate(channels):
        own = [run for run in runs if run.channel == channel]
        _levels(grid[0, column], own)
        _errors(grid[1, column], own)
        grid[0, column].set_title(channel, fontsize=9)
        low, high = float(own[0].frequency_hz.min()), float(own[0].frequency_hz.max())
        frequency_axis(grid[0, column], low / 1.2, high * 1.2, label=False)
        frequency_axis(grid[1, column], low / 1.2, high * 1.2)
        _thin_ticks(grid[1, column], len(channels))
    grid[0, 0].set_ylabel("sensor output (dB re 1 V peak)", fontsize=9)
    grid[1, 0].set_ylabel("error (dB)", fontsize=9)
    _key(grid[0, -1])
    clean = max(
        (float(np.max(np.abs(run.error_db[~run.saturated]), initial=0.0)) for run in runs if run.level_db_sl > 0),
        default=float("nan"),
    )
    quiet = ", 0 dB SL in orange, higher levels in deeper blue" if any(run.level_db_sl == 0.0 for run in runs) else ""
    caption = (
        f"Sensor output at {', '.join(f'{level:g}' for level in sorted({run.level_db_sl for run in runs}))} dB SL, "
        f"{condition}: measured (circles) and expected from the shipped sections and {plant} "
        f"(lines). Below, the difference with its confidence{quiet}. Largest difference above 0 dB SL, "
        f"saturated points left out: {clean:.2f} dB."
    )
    return Plate(name, f"Measured and expected output, {condition}", caption, made, _table(runs))


def _levels(axes: Axes, runs: Sequence[LevelResponse]) -> None:
    for run in runs:
        axes.plot(run.frequency_hz, db(run.expected_v), color=BLUE, linewidth=1.0)
        good = ~run.saturated
        axes.plot(run.frequency_hz[good], db(run.measured_v[good]), "o", color=INK, markersize=3, fillstyle="none")
        axes.plot(run.frequency_hz[~good], db(run.measured_v[~good]), "x", color=RED, markersize=5)
        at = (float(run.frequency_hz[0]), float(db(run.expected_v[0])))
        axes.annotate(f"{run.level_db_sl:g} dB SL", at, (2, 4), textcoords="offset points", fontsize=7)


def _errors(axes: Axes, runs: Sequence[LevelResponse]) -> None:
    shades = np.linspace(1.0, 0.25, len(runs))[::-1]
    for shade, run in zip(shades, sorted(runs, key=lambda one: one.level_db_sl), strict=True):
        good = ~run.saturated
        error, ci = run.error_db[good], run.ci_db[good]
        axes.errorbar(
            run.frequency_hz[good], error, ci, fmt="o", color=ORANGE if run.level_db_sl == 0.0 else BLUE, markersize=2,
            elinewidth=0.7, alpha=float(shade) if run.level_db_sl else 1.0,
        )  # fmt: skip
    axes.axhline(0.0, color=INK, linewidth=0.6)
    dress(axes)


def _thin_ticks(axes: Axes, panels: int) -> None:
    """Mark decades only, where panels are narrow."""
    if panels > 1:
        axes.set_xticks([1.0, 10.0, 100.0], ["1", "10", "100"])


def _key(axes: Axes) -> None:
    marks = [
        Line2D([], [], color=BLUE, linewidth=1.0, label="expected"),
        Line2D([], [], color=INK, marker="o", markersize=3, fillstyle="none", linestyle="", label="measured"),
        Line2D([], [], color=RED, marker="x", markersize=5, linestyle="", label="saturated"),
    ]
    axes.legend(handles=marks, fontsize=7, frameon=False, loc="lower left")


def _table(runs: Sequence[LevelResponse]) -> dict[str, list[object]]:
    table: dict[str, list[object]] = {
        name: []
        for name in ("channel", "level_db_sl", "frequency_hz", "expected_v", "measured_v", "ci_db", "saturated")
    }
    for run in runs:
        columns = (run.frequency_hz, run.expected_v, run.measured_v, run.ci_db, run.saturated)
        for row in zip(*(column.tolist() for column in columns), strict=True):
            for cells, cell in zip(table.values(), (run.channel, run.level_db_sl, *row), strict=True):
                cells.append(cell)
    return table
