"""Boxes of the texts of a figure, which may neither overlap nor leave it."""

from itertools import combinations

from matplotlib.backends.backend_agg import FigureCanvasAgg

from tactuator.report.figure import ReportFigure

Box = tuple[float, float, float, float]


def boxes(figure: ReportFigure) -> dict[str, Box]:
    """Every text that is seen, numbered, with its left, bottom, right and top."""
    FigureCanvasAgg(figure.drawing)
    figure.drawing.draw_without_rendering()
    texts = [text for legend in figure.drawing.legends for text in legend.get_texts()]
    for axes in figure.drawing.axes:
        texts += [axes.title, axes.xaxis.label, axes.yaxis.label, *axes.texts]
        texts += [] if axes.get_legend() is None else axes.get_legend().get_texts()
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            shown = (tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high)
            texts += [tick.label1 for tick in shown if tick.label1.get_visible() and axes.axison]
    seen = [text for text in texts if text.get_text() and text.get_visible()]
    parts = [text.get_bbox_patch() or text for text in seen]
    return {f"{text.get_text()} {k}": tuple(parts[k].get_window_extent().extents) for k, text in enumerate(seen)}


def assert_texts_apart(figure: ReportFigure) -> None:
    if isinstance(figure.drawing, str):  # a template, whose texts stand where it was drawn
        return
    found = boxes(figure)
    width, height = figure.drawing.canvas.get_width_height()
    for name, (x0, y0, x1, y1) in found.items():
        assert 0.0 <= x0 <= x1 <= width, f"{name} of {figure.name}"
        assert 0.0 <= y0 <= y1 <= height, f"{name} of {figure.name}"
    for (one, a), (other, b) in combinations(found.items(), 2):
        apart = a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
        assert apart, f"{one} over {other} in {figure.name}"
