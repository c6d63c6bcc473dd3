"""The Nichols chart of a loop and the envelopes of its family, with margins marked and labels that do not collide."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from matplotlib.transforms import Bbox

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.report.plate import BLUE, GREEN, INK, ORANGE, PURPLE, RED, Plate, figure
from tactuator.signals.decibels import db
from tactuator.signals.loop import FeedbackLoop, Margins, System, margins


@dataclass
class LabelPlacer:
    """Keeps account of what is taken on one pair of axes.

    lines: curves in data coordinates, each of shape (2, n), that no label may cover.
    """

    axes: Axes
    lines: Sequence[FloatArray] = ()
    _taken: list[Bbox] = field(default_factory=list)
    _points: FloatArray = field(default_factory=lambda: np.empty((0, 2)))

    def __post_init__(self) -> None:
        figure = self.axes.figure
        assert isinstance(figure, Figure)
        FigureCanvasAgg(figure)
        figure.draw_without_rendering()
        dense = [_dense(self.axes.transData.transform(np.asarray(line).T)) for line in self.lines]
        self._points = np.concatenate(dense) if dense else np.empty((0, 2))

    def place(
        self,
        text: str,
        anchors: Sequence[tuple[float, float]],
        offsets: Sequence[tuple[float, float]] = ((0.0, 0.0),),
        clear: float = 1.0,
        **style: object,
    ) -> bool:
        """Write `text` centred at the first free place, `clear` pixels from all lines: an anchor (data coordinates) and
        an offset (points).

        Returns whether there was one; nothing is written if not.
        """
        figure = self.axes.figure
        assert isinstance(figure, Figure)
        per_point = figure.dpi / 72.0
        frame = self.axes.get_window_extent().padded(-2.0)
        label = self.axes.annotate(
            text,
            anchors[0],
            (0.0, 0.0),
            textcoords="offset points",
            ha="center",
            va="center",
            **style,  # type: ignore[arg-type]
        )
        size = label.get_window_extent()
        for anchor in anchors:
            at = self.axes.transData.transform(anchor)
            for offset in offsets:
                x, y = at[0] + offset[0] * per_point, at[1] + offset[1] * per_point
                box = Bbox.from_bounds(x - size.width / 2.0, y - size.height / 2.0, size.width, size.height)
                if self._is_free(box, frame, clear):
                    self._taken.append(box.padded(4.0))
                    label.xy = anchor
                    label.set_position(offset)
                    return True
        label.remove()
        return False

    def block(self, box: Bbox) -> None:
        """Take a rectangle (display coordinates): a legend, say."""
        self._taken.append(box)

    def _is_free(self, box: Bbox, frame: Bbox, clear: float) -> bool:
        inside = frame.x0 <= box.x0 and box.x1 <= frame.x1 and frame.y0 <= box.y0 and box.y1 <= frame.y1
        if not inside or any(box.overlaps(other) for other in self._taken):
            return False
        if self._points.size == 0:
            return True
        x, y = self._points.T
        around = box.padded(clear)
        return not bool(np.any((x > around.x0) & (x < around.x1) & (y > around.y0) & (y < around.y1)))


def _dense(points: FloatArray, step: float = 3.0) -> FloatArray:
    """Return the points along a polyline, no further apart than `step` pixels."""
    points = points[np.all(np.isfinite(points), axis=1)]
    if len(points) < 2:
        return points
    lengths = np.hypot(*np.diff(points, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    fine = np.linspace(0.0, along[-1], max(2, min(20_000, int(along[-1] / step))))
    return np.column_stack([np.interp(fine, along, points[:, 0]), np.interp(fine, along, points[:, 1])])


_GAIN_LEVELS_DB = (-40.0, -30.0, -20.0, -12.0, -6.0, -3.0, -1.0, 0.0, 1.0, 3.0, 6.0)
_PHASE_LEVELS_DEG = (-5.0, -15.0, -30.0, -60.0, -90.0, -120.0, -150.0, -210.0, -240.0, -270.0, -300.0, -330.0, -345.0)
_MARKS_HZ = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0)
_GRID = "#c4cad0"
_GRID_INK = "#76818c"
_FAMILY = "#ece4f3"


def nichols_plate(
    sampled: FeedbackLoop,
    plant: System,
    continuous: FeedbackLoop | None = None,
    family: Sequence[FeedbackLoop] = (),
    band_hz: tuple[float, float] = (0.2, 600.0),
    name: str = "nichols",
    title: str = "Nichols chart",
) -> Plate:
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
    drawing, axes = figure(height_in=5.4)
    _frame(axes, [run, *members, *(track for track, _ in others)])
    peaks = _grid(axes, limits)
    for track, style in others:
        axes.plot(track.phase_deg, track.level_db, **style)
    templates = _templates(axes, members, run)
    axes.plot(run.phase_deg, run.level_db, color=BLUE, linewidth=2.0, label="C P, sampled, as it runs", zorder=4)
    # the upper left corner is left free by the curves
    axes.legend(fontsize=7.5, loc="upper left", frameon=True, framealpha=1.0, edgecolor="none", borderpad=0.3)
    arrows = _arrows(limits, run, bottom_db=axes.get_ylim()[0])
    placer = LabelPlacer(axes, [run.line, *(track.line for track, _ in others), *templates, *peaks, *arrows.values()])
    placer.block(axes.get_legend().get_window_extent())
    _margin_marks(axes, placer, arrows)
    _frequency_marks(axes, placer, run)
    _grid_labels(axes, placer)
    table = {"frequency_hz": frequency.tolist(), "phase_deg": run.phase_deg.tolist(), "gain_db": run.level_db.tolist()}
    for track, style in others:
        table[f"{style['label']} phase_deg"] = track.phase_deg.tolist()
        table[f"{style['label']} gain_db"] = track.level_db.tolist()
    return Plate(name, title, _caption(limits, len(family)), drawing, table)


def _caption(limits: Margins, others: int) -> str:
    caption = (
        f"Open-loop gain against phase on the grid of the closed loop. Crossover {limits.crossover_hz:.1f} Hz, phase "
        f"margin {limits.phase_margin_deg:.1f}°, gain margin {limits.gain_margin_db:.1f} dB. The loop touches the "
        f"contours |T| = {db(limits.complementary_peak):.2f} dB (at {limits.complementary.frequency_hz:.1f} Hz) and "
        f"|S| = {db(limits.sensitivity_peak):.2f} dB (at {limits.sensitivity.frequency_hz:.1f} Hz)."
    )
    if others:
        caption += (
            f" Shaded: the same controller on all {others + 1} plants of the family; at the marked "
            "frequencies their convex hulls, the templates."
        )
    return caption


@dataclass(frozen=True)
class _Track:
    """A response as a curve of the chart; its phase is continuous and starts between -270 and 90 degrees."""

    frequency_hz: FloatArray
    response: ComplexArray

    @property
    def phase_deg(self) -> FloatArray:
        phase = np.degrees(np.unwrap(np.angle(self.response)))
        return np.asarray(phase - 360.0 * np.ceil((phase[0] - 90.0) / 360.0))

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


def _grid(axes: Axes, limits: Margins) -> list[FloatArray]:
    """Draw the grid, and the contours of the peaks; return the latter."""
    phase, level = np.meshgrid(np.linspace(*axes.get_xlim(), 700), np.linspace(*axes.get_ylim(), 500))
    loop = 10.0 ** (level / 20.0) * np.exp(1j * np.radians(phase))
    with np.errstate(all="ignore"):
        closed = np.asarray(loop / (1.0 + loop))
    line: dict[str, Any] = {"colors": _GRID, "linewidths": 0.7, "linestyles": "-", "zorder": 1}
    axes.contour(phase, level, db(closed), levels=sorted(_GAIN_LEVELS_DB), **line)
    for angle in _PHASE_LEVELS_DEG:
        turned = closed * np.exp(-1j * np.radians(angle))
        height = np.where(turned.real > 0.0, turned.imag / np.abs(turned), np.nan)
        axes.contour(phase, level, height, levels=[0.0], colors=_GRID, linewidths=0.5, linestyles=":", zorder=1)
    axes.plot([-180.0], [0.0], "+", color=INK, markersize=9, markeredgewidth=1.6, zorder=5)
    style: dict[str, Any] = {"colors": ORANGE, "linewidths": 1.3, "zorder": 2}
    contours = (
        axes.contour(phase, level, np.abs(closed), levels=[limits.complementary_peak], **style),
        axes.contour(phase, level, np.abs(1.0 - closed), levels=[limits.sensitivity_peak], **style, linestyles="--"),
    )
    for symbol, peak, line_style in (("T", limits.complementary_peak, "-"), ("S", limits.sensitivity_peak, "--")):
        label = f"|{symbol}| = {db(peak):.2f} dB, the peak"
        axes.plot([], [], color=ORANGE, linewidth=1.3, linestyle=line_style, label=label)
    return [piece.T for drawn in contours for piece in drawn.allsegs[0]]


def _templates(axes: Axes, family: Sequence[_Track], run: _Track) -> list[FloatArray]:
    """Draw the shade that the family covers, and its convex hull at each marked frequency; return the corners."""
    if not family:
        return []
    for polygon in swept([run.line, *(track.line for track in family)]):
        axes.fill(*polygon.T, facecolor=_FAMILY, edgecolor=_FAMILY, linewidth=0.4, zorder=0.5)
    axes.fill([], [], facecolor=_FAMILY, label=f"C P, family of {len(family) + 1}")
    outlines = []
    for mark in (f for f in _MARKS_HZ if run.frequency_hz[0] <= f <= run.frequency_hz[-1]):
        corners = hull(np.array([run.at(mark), *(track.at(mark) for track in family)]))
        axes.fill(*corners.T, facecolor=PURPLE, alpha=0.3, edgecolor=PURPLE, linewidth=0.9, zorder=2)
        outlines.append(corners.T)
    return outlines


def _arrows(limits: Margins, run: _Track, bottom_db: float) -> dict[str, FloatArray]:
    """Return the ends, (2, 2), of the arrow of each margin that is seen, by its text."""
    arrows = {}
    if np.isfinite(limits.phase_margin_deg):
        end_deg = run.at(limits.crossover_hz)[0]
        arrows[f"{limits.phase_margin_deg:.1f}°"] = np.array([[-180.0, end_deg], [0.0, 0.0]])
    if np.isfinite(limits.gain_margin_db) and -limits.gain_margin_db > bottom_db:
        arrows[f"{limits.gain_margin_db:.1f} dB"] = np.array([[-180.0, -180.0], [0.0, -limits.gain_margin_db]])
    return arrows


def _margin_marks(axes: Axes, placer: LabelPlacer, arrows: Mapping[str, FloatArray]) -> None:
    style = {"arrowstyle": "<->", "color": INK, "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0}
    for text, ends in arrows.items():
        start, end = ends.T
        axes.annotate("", start, end, arrowprops=style, zorder=5)
        spots = [tuple(start + share * (end - start)) for share in (0.5, 0.35, 0.65, 0.2, 0.8)]
        beside = [(0.0, 8.0), (0.0, -8.0)] if start[1] == end[1] else [(-22.0, 0.0), (22.0, 0.0)]
        placer.place(text, spots, beside, fontsize=8, color=INK, weight="bold")


def _frequency_marks(axes: Axes, placer: LabelPlacer, run: _Track) -> None:
    far, around = (11.0, 15.0, 20.0, 26.0, 34.0), np.radians(range(0, 360, 30))
    offsets = [(r * np.cos(a), r * np.sin(a)) for r in far for a in around]
    marks = {mark: run.at(mark) for mark in _MARKS_HZ if run.frequency_hz[0] <= mark <= run.frequency_hz[-1]}
    seen = {mark: at for mark, at in marks.items() if axes.get_ylim()[0] < at[1] < axes.get_ylim()[1]}
    points = axes.transData.transform(list(seen.values())) * 72.0 / axes.figure.dpi if seen else np.empty((0, 2))
    for (mark, at), middle in zip(seen.items(), points, strict=True):
        axes.plot(*at, "o", color=BLUE, markersize=4, zorder=6)
        apart = [np.hypot(*(middle + offset - points).T).min() + 1e-6 >= np.hypot(*offset) for offset in offsets]
        nearest = [offset for offset, is_own in zip(offsets, apart, strict=True) if is_own]  # its mark, no other's
        placer.place(f"{mark:g} Hz", [at], nearest, fontsize=7.5, color=BLUE)


def _grid_labels(axes: Axes, placer: LabelPlacer) -> None:
    """Label |T| in dB at the right edge or on the contour; phase of T at the top or bottom, where there is room."""
    low, high = axes.get_ylim()
    lowest_deg, right = axes.get_xlim()
    ground = {"boxstyle": "square,pad=0.08", "facecolor": "white", "edgecolor": "none"}
    style: dict[str, Any] = {"fontsize": 6.5, "color": _GRID_INK, "bbox": ground, "clear": 3.0}
    for level in _GAIN_LEVELS_DB:
        circle = 10.0 ** (level / 20.0) * np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 1441)[:-1])
        with np.errstate(all="ignore"):
            loop = circle / (1.0 - circle)
        phase, gain = np.degrees(np.angle(loop)), db(loop)
        phase = np.where(phase > right, phase - 360.0, phase)
        inside = (phase > lowest_deg) & (phase < right - 6.0) & (gain > low + 2.0) & (gain < high - 2.0)
        order = np.argsort(-phase if level <= 0.0 else gain)
        anchors = [(float(phase[i]), float(gain[i])) for i in order if inside[i]][::6]
        placer.place(_minus(f"{level:g} dB"), anchors or [(right, high)], **style)
    for angle in _PHASE_LEVELS_DEG:
        closed = 10.0 ** (np.linspace(-60.0, 40.0, 1200) / 20.0) * np.exp(1j * np.radians(angle))
        loop = closed / (1.0 - closed)
        phase, gain = np.degrees(np.angle(loop)), db(loop)
        phase = np.where(phase > 0.0, phase - 360.0, phase)
        inside = (phase > lowest_deg) & (phase < right) & (gain > low + 1.0) & (gain < high - 1.0)
        anchors = [(float(phase[i]), float(gain[i])) for i in np.flatnonzero(inside)][::5]
        placer.place(_minus(f"{angle:g}°"), anchors or [(right, high)], **style)


def _minus(text: str) -> str:
    return text.replace("-", "−")


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
