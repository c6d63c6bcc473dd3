"""The figure of coefficient resolution: nothing covers anything, lines end where bits do, pictures in three formats."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from tactuator.report.controller import resolution_plate
from tactuator.report.plate import Plate
from tactuator.wordlength.bits import MOST_BITS, BitsNeeded

RATES_HZ = (4000.0, 8000.0, 16000.0, 32000.0)


def by_rate(*bits: tuple[int, int]) -> dict[float, BitsNeeded]:
    return {rate: BitsNeeded(*pair) for rate, pair in zip(RATES_HZ, bits, strict=True)}


@pytest.fixture(scope="module")
def plate() -> Plate:
    """The shapes that a designed controller gives, one of them beyond the most bits."""
    forms = {
        "direct": by_rate((22, 35), (25, 40), (28, 43), (32, MOST_BITS + 1)),
        "sections": by_rate((16, 25), (19, 28), (20, 28), (23, 31)),
        "delta": by_rate((0, 14), (0, 14), (0, 13), (0, 13)),
    }
    return resolution_plate({"prefilter": forms, "feedback": forms}, whose="a controller")


def shown_texts(plate: Plate) -> list[Text]:
    FigureCanvasAgg(plate.figure)
    plate.figure.draw_without_rendering()
    texts = [text for legend in plate.figure.legends for text in legend.get_texts()]
    for axes in plate.figure.axes:
        texts += [axes.title, axes.xaxis.label, axes.yaxis.label, *axes.texts]
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            shown = (tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high)
            texts += [tick.label1 for tick in shown if tick.label1.get_visible()]
    return [text for text in texts if text.get_text()]


def test_resolution_plate__texts__neither_collide_nor_leave_the_picture(plate: Plate) -> None:
    texts = shown_texts(plate)
    assert len(texts) > 20
    boxes = [(text.get_text(), text.get_window_extent()) for text in texts]
    width, height = plate.figure.canvas.get_width_height()
    for name, box in boxes:
        assert box.x0 >= 0.0, name
        assert box.y0 >= 0.0, name
        assert box.x1 <= width, name
        assert box.y1 <= height, name
    for (name, box), (other_name, other) in combinations(boxes, 2):
        assert not box.overlaps(other), (name, other_name)


def test_resolution_plate__more_bits_than_there_are__ends_the_line_but_not_the_table(plate: Plate) -> None:
    ends = [np.isnan(line.get_ydata()[-1]) for line in plate.figure.axes[0].get_lines() if len(line.get_ydata()) == 4]
    assert ends == [True, False, False, False, False, False]
    assert MOST_BITS + 1 in plate.table["accurate_bits"]
    assert len(plate.table["rate_hz"]) == 24
    assert f"{MOST_BITS} bits are not enough" in plate.caption
