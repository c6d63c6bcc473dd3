"""The picture of a rendering: what was asked, what was felt, and the difference, over time, for every finger."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from tactuator.measure.band_levels import LONG_FRAME_S, SHORT_FRAME_S
from tactuator.measure.felt import HEARD_DB_SL, FeltReport, FingerFelt
from tactuator.report.plate import Plate
from tactuator.report.style import figure

SHOWN_S = 30.0
LOWEST_DB_SL, HIGHEST_DB_SL = -10.0, 55.0
DIFFERENCE_DB = 3.0
_TICKS_HZ = (2, 5, 10, 20, 50, 100, 200)

Levels = NDArray[np.floating[Any]]


def spectrogram_plate(report: FeltReport, what: str, name: str = "render") -> Plate:
    """Draw a row for each finger: third-octave levels asked, felt, and their difference where 10 dB SL or more was
    asked.

    The first 30 s are shown; the table holds the levels over the whole.
    """
    fingers = report.fingers
    made, grid = figure(len(fingers), 3, 1.2 + 1.5 * len(fingers), sharex=True, sharey=True, squeeze=False)
    for row, finger in zip(grid, fingers, strict=True):
        levels, difference = _draw_finger(row, finger)
        row[0].set_ylabel(f"{finger.finger}\nfrequency (Hz)", fontsize=8)
    for axes, title in zip(grid[0], ("asked", "felt", "felt − asked"), strict=True):
        axes.set_title(title, fontsize=9)
    for axes in grid[-1]:
        axes.set_xlabel("time (s)", fontsize=9)
    first = made.colorbar(levels, ax=grid[:, :2], location="bottom", shrink=0.6, aspect=40)
    first.set_label("level in a third octave (dB SL)", fontsize=8)
    second = made.colorbar(difference, ax=grid[:, 2], location="bottom", shrink=0.9, aspect=20)
    second.set_label("difference (dB)", fontsize=8)
    for bar in (first, second):
        bar.ax.tick_params(labelsize=8)
    caption = (
        f"{what}: levels in third-octave bands over {1e3 * LONG_FRAME_S:.0f} ms (to 40 Hz) and "
        f"{1e3 * SHORT_FRAME_S:.0f} ms (above), asked for and felt, and the difference where {HEARD_DB_SL:g} dB SL or "
        "more was asked for; white: less was asked for."
    )
    return Plate(name, "Asked and felt over time", caption, made, _table(report))


def _draw_finger(row: list[Axes], finger: FingerFelt) -> tuple[ScalarMappable, ScalarMappable]:
    split = finger.asked_long.shape[1]
    edges = _edges(finger.centre_hz)
    parts = (
        (finger.asked_long, finger.felt_long, edges[: split + 1], LONG_FRAME_S),
        (finger.asked_short, finger.felt_short, edges[split:], SHORT_FRAME_S),
    )
    level_norm, difference_norm = Normalize(LOWEST_DB_SL, HIGHEST_DB_SL), Normalize(-DIFFERENCE_DB, DIFFERENCE_DB)
    levels, difference = ScalarMappable(level_norm, "magma_r"), ScalarMappable(difference_norm, "RdBu")
    for asked, felt, frequency, frame_s in parts:
        count = min(len(asked), round(SHOWN_S / frame_s))
        if not count:
            continue
        time = np.arange(count + 1) * frame_s
        for axes, values in ((row[0], asked), (row[1], felt)):
            shown = np.maximum(values[:count], LOWEST_DB_SL).T
            axes.pcolormesh(time, frequency, shown, norm=level_norm, cmap=levels.cmap, rasterized=True)
        counted = np.where(asked[:count] >= HEARD_DB_SL, felt[:count] - asked[:count], np.nan).T
        row[2].pcolormesh(time, frequency, counted, norm=difference_norm, cmap=difference.cmap, rasterized=True)
    for axes in row:
        axes.set_yscale("log")
        axes.set_ylim(edges[0], edges[-1])
        axes.set_yticks(_TICKS_HZ, [str(tick) for tick in _TICKS_HZ])
        axes.minorticks_off()
        axes.grid(False)
    return levels, difference


def _edges(centre_hz: Levels) -> Levels:
    half = 10.0**0.05
    return np.append(centre_hz / half, centre_hz[-1] * half)


def _table(report: FeltReport) -> dict[str, list[object]]:
    table: dict[str, list[object]] = {"finger": [], "centre_hz": [], "asked_db_sl": [], "felt_db_sl": []}
    for finger in report.fingers:
        rows = zip(finger.centre_hz.tolist(), finger.asked_db_sl.tolist(), finger.felt_db_sl.tolist(), strict=True)
        for row in rows:
            for column, cell in zip(table.values(), (finger.finger, *row), strict=True):
                column.append(cell)
    return table
