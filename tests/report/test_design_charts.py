"""Charts of a design: everything is in them, inside the frame, and no label covers another."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import same_color

from tactuator.errors import BadInput
from tactuator.report.controller import design_plates, resolution_plate, save_design_plates
from tactuator.report.nichols import hull, nichols_plate
from tactuator.report.plate import ORANGE, Plate
from tactuator.signals.discretise import bilinear
from tactuator.signals.loop import FeedbackLoop
from tactuator.signals.systems import ContinuousSystem
from tactuator.synthesis import paper
from tactuator.synthesis.family import plant_family
from tactuator.wordlength.bits import MOST_BITS, BitsNeeded
from tests.synthesis.displays import channel, paper_controller, three_finger_controller


@cache
def paper_chart() -> Plate:
    family = plant_family(channel(), 4000.0, 1)
    c = bilinear(paper.FEEDBACK, 4000.0)
    loops = [FeedbackLoop(c, one.sampled) for one in family]
    continuous = FeedbackLoop(paper.FEEDBACK, paper.PLANT)
    return nichols_plate(loops[0], paper.PLANT, continuous, loops[1:], name="fig07")


def boxes(plate: Plate) -> dict[str, tuple[float, float, float, float]]:
    FigureCanvasAgg(plate.figure)
    plate.figure.draw_without_rendering()
    axes = plate.figure.axes[0]
    return {text.get_text(): text.get_window_extent().extents for text in axes.texts if text.get_text()}


def all_boxes(plate: Plate) -> dict[str, tuple[float, float, float, float]]:
    """Pixel boxes of every text: legends, titles, labels, ticks."""
    FigureCanvasAgg(plate.figure)
    plate.figure.draw_without_rendering()
    texts = [text for legend in plate.figure.legends for text in legend.get_texts()]
    for axes in plate.figure.axes:
        texts += [axes.title, axes.xaxis.label, axes.yaxis.label, *axes.texts]
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            shown = (tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high)
            texts += [tick.label1 for tick in shown if tick.label1.get_visible()]
    return {
        f"{text.get_text()} {k}": text.get_window_extent().extents for k, text in enumerate(texts) if text.get_text()
    }


def assert_apart_and_within(found: dict[str, tuple[float, ...]], frame: tuple[float, ...]) -> None:
    left, bottom, right, top = frame
    for name, (x0, y0, x1, y1) in found.items():
        assert left <= x0 <= x1 <= right, name
        assert bottom <= y0 <= y1 <= top, name
    for (one, a), (other, b) in combinations(found.items(), 2):
        apart = a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
        assert apart, f"{one} over {other}"


@cache
def designed_charts(finger: str) -> dict[str, Plate]:
    return {plate.name: plate for plate in design_plates(three_finger_controller(), finger)}


@pytest.mark.parametrize("chart", [paper_chart, lambda: designed_charts("thumb")["nichols-thumb"]])
def test_nichols__labels__neither_collide_nor_lie_under_curves_nor_leave_the_frame(chart: Callable[[], Plate]) -> None:
    made = chart()
    axes = made.figure.axes[0]
    assert_apart_and_within(boxes(made), axes.get_window_extent().extents)
    peaks = [one for one in axes.collections if len(one.get_edgecolor()) and same_color(one.get_edgecolor()[0], ORANGE)]
    curves = [path.vertices for one in peaks for path in one.get_paths()] + [one.get_xydata() for one in axes.lines]
    assert len(peaks) == 2
    x, y = np.concatenate([axes.transData.transform(curve) for curve in curves if len(curve) > 2]).T
    for name, (x0, y0, x1, y1) in boxes(made).items():
        assert not np.any((x > x0) & (x < x1) & (y > y0) & (y < y1)), f"{name} lies under a curve"


def test_resolution__labels_and_bits__neither_collide_nor_go_on_where_bits_end() -> None:
    rates = (4000.0, 8000.0, 16000.0, 32000.0)
    bits = {
        "direct": [(22, 35), (25, 40), (28, 43), (32, MOST_BITS + 1)],
        "sections": [(16, 25), (19, 28), (20, 28), (23, 31)],
        "delta": [(0, 14), (0, 14), (0, 13), (0, 13)],
    }
    forms = {form: {r: BitsNeeded(*b) for r, b in zip(rates, of, strict=True)} for form, of in bits.items()}
    made = resolution_plate({"prefilter": forms, "feedback": forms}, whose="a controller")
    found = all_boxes(made)
    assert len(found) > 20
    assert_apart_and_within(found, (0.0, 0.0, *made.figure.canvas.get_width_height()))
    ends = [np.isnan(line.get_ydata()[-1]) for line in made.figure.axes[0].get_lines() if len(line.get_ydata()) == 4]
    assert ends == [True, False, False, False, False, False]
    assert MOST_BITS + 1 in made.table["accurate_bits"]
    assert len(made.table["rate_hz"]) == 24
    assert f"{MOST_BITS} bits are not enough" in made.caption


def test_nichols__marks_axis_and_caption__are_there_cover_the_data_and_say_which_contours_are_touched() -> None:
    plate = paper_chart()
    marks = {"1 Hz", "10 Hz", "20 Hz", "50 Hz", "100 Hz", "55.8°", "25.4 dB", "0 dB", "−3 dB", "−20 dB", "−90°"}
    assert marks <= set(boxes(plate))
    assert all(words in plate.caption for words in ("|T| = 0.79 dB", "|S| = 2.95 dB"))
    left, right = plate.figure.axes[0].get_xlim()
    phase = np.array(plate.table["phase_deg"])[np.array(plate.table["gain_db"]) > -50.0]
    assert left <= phase.min()
    assert phase.max() <= right


def many_models() -> dict[str, Plate]:
    """The charts of a channel of eight models beside the nominal one, without and under a load: eighteen plants."""
    made = three_finger_controller()
    rng = np.random.default_rng(0)
    factors = rng.normal(1.0, 0.1, (8, 3))
    models = tuple(ContinuousSystem.from_polynomials([2875.0 * a], [1.0, 94.0 * b, 290.0 * c]) for a, b, c in factors)
    channels = (replace(made.display.channels[0], family=models), *made.display.channels[1:])
    shown = replace(made, display=replace(made.display, channels=channels))
    return {plate.name.split("-")[0]: plate for plate in design_plates(shown, "index")}


def test_plates__eighteen_plants__a_legend_of_few_lines_and_an_envelope() -> None:
    plates = many_models()
    for kind in ("nichols", "sensitivity", "headroom"):
        texts = [one.get_text() for one in plates[kind].figure.axes[0].get_legend().get_texts()]
        assert len(texts) <= 6, texts
        assert not any("model" in text for text in texts)
    assert "all 18 plants" in plates["nichols"].caption
    table = {name: np.array(column) for name, column in plates["sensitivity"].table.items()}
    assert np.all(table["S finger least dB"] <= table["S finger dB"])
    assert np.all(table["S finger greatest dB"] >= table["S finger dB"])
    assert np.max(table["S finger greatest dB"] - table["S finger least dB"]) > 1.0
    assert set(plates["headroom"].table["load"]) == {"none", "finger"}


@given(st.lists(st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0)), min_size=3, max_size=30))
def test_hull__any_points__holds_them_all_and_turns_one_way(points: list[tuple[float, float]]) -> None:
    corners = hull(np.array(points))
    following = np.roll(corners, -1, axis=0)
    edges = following - corners
    away = np.array(points)[:, None] - corners
    assert np.all(edges[:, 0] * away[..., 1] - edges[:, 1] * away[..., 0] >= -1e-6)


def test_equality__felt_level__flat() -> None:
    plate = designed_charts("thumb")["equality-thumb"]
    felt = np.array(plate.table["felt_db_sl"])
    total = np.array(plate.table["displacement_db_re_1um"]) + np.array(plate.table["sensitivity_db"])
    assert felt == pytest.approx(total)
    assert np.abs(felt - 30.0).max() <= 0.25
    assert "inferred" in plate.caption


def test_save__every_plate__svg_and_csv_in_a_folder_of_nothing_else(tmp_path: Path) -> None:
    save_design_plates(paper_controller(), tmp_path / "charts")
    names = {f"{kind}-index" for kind in ("nichols", "bode", "sensitivity", "headroom", "equality")}
    for ending in ("svg", "csv"):
        assert {path.stem for path in (tmp_path / "charts").glob(f"*.{ending}")} == names
    other = tmp_path / "other"
    other.mkdir()
    (other / "precious.txt").write_text("keep me")
    with pytest.raises(BadInput, match="precious"):
        save_design_plates(paper_controller(), other)
