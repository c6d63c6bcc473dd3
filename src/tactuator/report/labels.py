"""Labels that do not collide: each is put at the first of its possible places that is still free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from tactuator.arrays import FloatArray


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
        clear_of_lines: bool = True,
        **style: object,
    ) -> bool:
        """Write `text` centred at the first free place: an anchor (data coordinates) and an offset (points).

        Returns whether there was one; nothing is written if not.
        """
        figure = self.axes.figure
        assert isinstance(figure, Figure)
        per_point = figure.dpi / 72.0
        frame = self.axes.get_window_extent().padded(-2.0)
        made = self.axes.annotate(
            text,
            anchors[0],
            (0.0, 0.0),
            textcoords="offset points",
            ha="center",
            va="center",
            **style,  # type: ignore[arg-type]
        )
        size = made.get_window_extent()
        for anchor in anchors:
            at = self.axes.transData.transform(anchor)
            for offset in offsets:
                x, y = at[0] + offset[0] * per_point, at[1] + offset[1] * per_point
                box = Bbox.from_bounds(x - size.width / 2.0, y - size.height / 2.0, size.width, size.height)
                if self._is_free(box, frame, clear_of_lines):
                    self._taken.append(box.padded(4.0))
                    made.xy = anchor
                    made.set_position(offset)
                    return True
        made.remove()
        return False

    def block(self, box: Bbox) -> None:
        """Take a rectangle (display coordinates): a legend, say."""
        self._taken.append(box)

    def _is_free(self, box: Bbox, frame: Bbox, clear_of_lines: bool) -> bool:
        inside = frame.x0 <= box.x0 and box.x1 <= frame.x1 and frame.y0 <= box.y0 and box.y1 <= frame.y1
        if not inside or any(box.overlaps(other) for other in self._taken):
            return False
        if not clear_of_lines or self._points.size == 0:
            return True
        x, y = self._points.T
        return not bool(np.any((x > box.x0 - 1) & (x < box.x1 + 1) & (y > box.y0 - 1) & (y < box.y1 + 1)))


def _dense(points: FloatArray, step: float = 3.0) -> FloatArray:
    """Return the points along a polyline, no further apart than `step` pixels."""
    points = points[np.all(np.isfinite(points), axis=1)]
    if len(points) < 2:
        return points
    lengths = np.hypot(*np.diff(points, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    fine = np.linspace(0.0, along[-1], max(2, min(20_000, int(along[-1] / step))))
    return np.column_stack([np.interp(fine, along, points[:, 0]), np.interp(fine, along, points[:, 1])])
