"""The Nichols chart of a loop and the envelopes of its family, with its margins and frequencies marked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MultipleLocator

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.report.figure import BLUE, GREEN, INK, ORANGE, PURPLE, RED, ReportFigure, subplots
from tactuator.signals.decibels import db
from tactuator.signals.loop import FeedbackLoop, System
from tactuator.signals.loop_figures import Margins, continuous_phase_deg, margins

GAIN_LEVELS_DB = (-40.0, -30.0, -20.0, -12.0, -6.0, -3.0, -1.0, 0.0, 1.0, 3.0, 6.0)
_PHASE_LEVELS_DEG = tuple(float(angle) for angle in range(-330, 0, 30) if angle != -180)
MARKS_HZ = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0)
_MARKS_APART_PT = 17.0
"""Marks nearer than this to one that is written are left out: two of three digits fit side by side."""
_GRID = "#c4cad0"
_GRID_INK = "#76818c"
_FAMILY = "#ece4f3"


def nichols_figure(
    sampled: FeedbackLoop,
    plant: System,
    continuous: FeedbackLoop | None = None,
    family: Sequence[FeedbackLoop] = (),
    band_hz: tuple[float, float] = (0.2, 600.0),
    name: str = "nichols",
    title: str = "Nichols chart",
) -> ReportFigure:
    """Draw the chart, with margins marked and the contours that the loop touches highlighted.

    sampled: the loop as it runs, whose margins are marked. plant: P alone. continuous: the loop in continuous time, if
    wanted. family: the same controller on every other plant, shown as the envelope of them all.
    """
    limits = margins(sampled)
    frequency = np.geomspace(*band_hz, 900)
    run = _Track(frequency, sampled.open_response(frequency))
    members = [_Track(frequency, loop.open_response(frequency)) for loop in family]
    others: list[tuple[_Track, dict[str, Any]]] = []
    if len(members) == 1:
        style: dict[str, Any] = {
            "color": PURPLE,
            "linewidth": 0.8,
            "alpha": 0.7,
            "zorder": 2,
            "label": "C P, under load",
        }
        others.append((members[0], style))
    style = {"color": GREEN, "linestyle": "-.", "linewidth": 1.4, "label": "P alone", "zorder": 3}
    others.append((_Track(frequency, plant.response(frequency)), style))
    if continuous is not None:
        style = {"color": RED, "linestyle": "--", "linewidth": 1.4, "label": "C P, continuous", "zorder": 3}
        others.append((_Track(frequency, continuous.open_response(frequency)), style))
    drawing, axes = subplots(height_in=5.6)
    _frame(axes, [run, *members, *(track for track, _ in others)])
    _grid(axes, limits)
    for track, style in others:
        axes.plot(track.phase_deg, track.level_db, **style)
    _templates(axes, members, run)
    axes.plot(run.phase_deg, run.level_db, color=BLUE, linewidth=2.0, label="C P, sampled, with Hz", zorder=4)
    _margin_marks(axes, limits, run)
    _frequency_marks(axes, run)
    drawing.legend(fontsize=7.5, loc="outside lower center", ncols=3, frameon=False)
    table = {"frequency_hz": frequency.tolist(), "phase_deg": run.phase_deg.tolist(), "gain_db": run.level_db.tolist()}
    for track, style in others:
        table[f"{style['label']} phase_deg"] = track.phase_deg.tolist()
        table[f"{style['label']} gain_db"] = track.level_db.tolist()
    return ReportFigure(name, title, _caption(limits, len(family)), drawing, table)


def _caption(limits: Margins, others: int) -> str:
    caption = (
        f"Open-loop gain against phase on the grid of the closed loop. Crossover {limits.crossover_hz:.1f} Hz, phase "
        f"margin {limits.phase_margin_deg:.1f}°, gain margin {limits.gain_margin_db:.1f} dB. The loop touches the "
        f"contours |T| = {db(limits.complementary_peak):.2f} dB (at {limits.complementary.frequency_hz:.1f} Hz) and "
        f"|S| = {db(limits.sensitivity_peak):.2f} dB (at {limits.sensitivity.frequency_hz:.1f} Hz). Grey: |T|; dotted: "
        "equal phase of T, which meets the lower edge at that phase. Numbers on the loop: frequency, Hz."
    )
    if others:
        caption += (
            f" Shaded: the same controller on all {others + 1} plants (each load, each fit of the record); at the "
            "marked frequencies their convex hulls, the templates."
        )
    return caption


@dataclass(frozen=True)
class _Track:
    """A response as a curve of the chart; its phase is continuous and starts between -270 and 90 degrees."""

    frequency_hz: FloatArray
    response: ComplexArray

    @property
    def phase_deg(self) -> FloatArray:
        return continuous_phase_deg(self.response)

    @property
    def level_db(self) -> FloatArray:
        return db(self.response)

    @property
    def line(self) -> FloatArray:
        return np.vstack([self.phase_deg, self.level_db])

    def at(self, frequency_hz: float) -> tuple[float, float]:
        logs = np.log(self.frequency_hz)
        return tuple(float(np.interp(np.log(frequency_hz), logs, v)) for v in self.line)  # type: ignore[return-value]


def _frame(axes: Axes, tracks: Sequence[_Track]) -> None:
    axes.grid(False)
    bottom, top = -50.0, 20.0
    lowest_deg, highest_deg = -200.0, 0.0
    for track in tracks:
        seen = track.level_db > bottom
        if np.any(seen):
            lowest_deg, highest_deg = (
                min(lowest_deg, float(track.phase_deg[seen].min())),
                max(highest_deg, float(track.phase_deg[seen].max())),
            )
            top = max(top, float(track.level_db.max()))
    axes.set_xlim(15.0 * np.floor((lowest_deg - 8.0) / 15.0), 15.0 * np.ceil(highest_deg / 15.0))
    axes.set_ylim(bottom, 5.0 * np.ceil((top + 4.0) / 5.0))
    axes.xaxis.set_major_locator(MultipleLocator(45.0 if axes.get_xlim()[0] < -300.0 else 30.0))
    axes.yaxis.set_major_locator(MultipleLocator(10.0))
    axes.set_xlabel("open-loop phase (degrees)", fontsize=9)
    axes.set_ylabel("open-loop gain (dB)", fontsize=9)


def _grid(axes: Axes, limits: Margins) -> None:
    """Draw contours of |T| and of the phase of T, and those of the peaks of |T| and |S|."""
    phase, level = np.meshgrid(np.linspace(*axes.get_xlim(), 350), np.linspace(*axes.get_ylim(), 250))
    loop = 10.0 ** (level / 20.0) * np.exp(1j * np.radians(phase))
    with np.errstate(all="ignore"):
        closed = np.asarray(loop / (1.0 + loop))
    line: dict[str, Any] = {"colors": _GRID, "linewidths": 0.7, "linestyles": "-", "zorder": 1}
    axes.contour(phase, level, db(closed), levels=GAIN_LEVELS_DB, **line)
    for angle in _PHASE_LEVELS_DEG:
        turned = closed * np.exp(-1j * np.radians(angle))
        height = np.where(turned.real > 0.0, turned.imag / np.abs(turned), np.nan)
        axes.contour(phase, level, height, levels=[0.0], colors=_GRID, linewidths=0.5, linestyles=":", zorder=1)
    axes.plot([-180.0], [0.0], "+", color=INK, markersize=9, markeredgewidth=1.6, zorder=5)
    style: dict[str, Any] = {"colors": ORANGE, "linewidths": 1.3, "zorder": 2}
    axes.contour(phase, level, np.abs(closed), levels=[limits.complementary_peak], **style)
    axes.contour(phase, level, np.abs(1.0 - closed), levels=[limits.sensitivity_peak], **style, linestyles="--")
    for symbol, peak, line_style in (("T", limits.complementary_peak, "-"), ("S", limits.sensitivity_peak, "--")):
        label = f"|{symbol}| = {db(peak):.2f} dB, the peak"
        axes.plot([], [], color=ORANGE, linewidth=1.3, linestyle=line_style, label=label)
    _grid_labels(axes)


def _grid_labels(axes: Axes) -> None:
    """Write |T| in dB outside the frame, where its contour leaves it; closed contours are in the legend."""
    style: dict[str, Any] = {
        "fontsize": 6.5,
        "color": _GRID_INK,
        "textcoords": "offset points",
        "annotation_clip": False,
    }
    low, high = axes.get_ylim()
    right = axes.get_xlim()[1]
    turn = np.radians(right)
    for level in (level for level in GAIN_LEVELS_DB if level < 0.0):
        m = 10.0 ** (level / 20.0)
        gain = float(db(m * (m * np.cos(turn) + np.sqrt(1.0 - (m * np.sin(turn)) ** 2)) / (1.0 - m * m)))
        if low < gain < high:
            axes.annotate(f"−{-level:g} dB", (right, gain), (3.0, 0.0), va="center", **style)
    axes.annotate("0 dB", (-90.0, high), (0.0, 2.0), ha="center", **style)
    inwards = ", ".join(f"{level:g}" for level in GAIN_LEVELS_DB if level > 0.0)
    axes.plot([], [], color=_GRID, linewidth=0.7, label=f"|T| = {inwards} dB, inwards")


def _templates(axes: Axes, family: Sequence[_Track], run: _Track) -> None:
    """Draw the shade that the family covers, and its convex hull at each marked frequency."""
    if not family:
        return
    for polygon in swept([run.line, *(track.line for track in family)]):
        axes.fill(*polygon.T, facecolor=_FAMILY, edgecolor=_FAMILY, linewidth=0.4, zorder=0.5)
    axes.fill([], [], facecolor=_FAMILY, label=f"C P, family of {len(family) + 1}")
    for mark in (f for f in MARKS_HZ if run.frequency_hz[0] <= f <= run.frequency_hz[-1]):
        corners = hull(np.array([run.at(mark), *(track.at(mark) for track in family)]))
        axes.fill(*corners.T, facecolor=PURPLE, alpha=0.3, edgecolor=PURPLE, linewidth=0.9, zorder=2)


def _margin_marks(axes: Axes, limits: Margins, run: _Track) -> None:
    """Draw an arrow for each visible margin; the values are in the legend."""
    ends, texts = [], []
    if np.isfinite(limits.phase_margin_deg):
        ends.append((run.at(limits.crossover_hz)[0], 0.0))
        texts.append(f"{limits.phase_margin_deg:.1f}°")
    if np.isfinite(limits.gain_margin_db) and -limits.gain_margin_db > axes.get_ylim()[0]:
        ends.append((-180.0, -limits.gain_margin_db))
        texts.append(f"{limits.gain_margin_db:.1f} dB")
    style = {"arrowstyle": "<->", "color": INK, "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0}
    for end in ends:
        axes.annotate("", (-180.0, 0.0), end, arrowprops=style, zorder=5)
    if texts:
        axes.plot([], [], color=INK, linewidth=1.0, label=f"margins: {', '.join(texts)}")


def _frequency_marks(axes: Axes, run: _Track) -> None:
    """Write frequencies on the loop, each where no earlier one is."""
    low, high = axes.get_ylim()
    box = {"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": BLUE, "linewidth": 0.8}
    written: list[FloatArray] = []
    for mark in (mark for mark in MARKS_HZ if run.frequency_hz[0] <= mark <= run.frequency_hz[-1]):
        at = run.at(mark)
        point = axes.transData.transform(at) * 72.0 / axes.figure.dpi
        if low + 2.0 < at[1] < high - 2.0 and all(np.hypot(*(point - other)) >= _MARKS_APART_PT for other in written):
            axes.text(*at, f"{mark:g}", ha="center", va="center", fontsize=6.5, color=BLUE, bbox=box, zorder=6)
            written.append(point)


def hull(points: FloatArray) -> FloatArray:
    """Return the corners of the convex hull of `points`, (n, 2), in turn, (k, 2); Andrew's monotone chain."""
    ordered = np.unique(points, axis=0)
    if len(ordered) < 3:
        return ordered
    chains: list[list[FloatArray]] = []
    for walk in (ordered, ordered[::-1]):
        chain: list[FloatArray] = []
        for point in walk:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], point) <= 0.0:
                chain.pop()
            chain.append(point)
        chains.append(chain[:-1])
    return np.array([*chains[0], *chains[1]])


def _turn(start: FloatArray, middle: FloatArray, end: FloatArray) -> float:
    first, second = middle - start, end - start
    return float(first[0] * second[1] - first[1] * second[0])


def swept(lines: Sequence[FloatArray], step: int = 6) -> list[FloatArray]:
    """Return polygons that cover everything between curves: the hulls of their pieces of `step` points.

    lines: curves over one grid of frequencies, each (2, n).
    """
    stacked = np.array(lines)
    starts = range(0, stacked.shape[2] - 1, step)
    return [hull(stacked[:, :, at : at + step + 1].transpose(0, 2, 1).reshape(-1, 2)) for at in starts]
