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

from tactuator.errors import BadInput
from tactuator.report.controller import design_plates, save_design_plates
from tactuator.report.nichols import hull, nichols_plate
from tactuator.report.plate import Plate
from tactuator.signals.discretise import bilinear
from tactuator.signals.loop import FeedbackLoop
from tactuator.signals.systems import ContinuousSystem
from tactuator.synthesis import paper
from tactuator.synthesis.family import plant_family
from tests.synthesis.displays import channel, paper_controller, three_finger_controller


@cache
def paper_chart() -> Plate:
    family = plant_family(channel(), 4000.0, 1)
    c = bilinear(paper.FEEDBACK, 4000.0)
    loops = [FeedbackLoop(c, one.sampled) for one in family]
    continuous = FeedbackLoop(paper.FEEDBACK, paper.PLANT)
    return nichols_plate(loops[0], paper.PLANT, continuous, loops[1:], name="fig07")


def boxes(plate: Plate) -> dict[str, tuple[float, float, float, float]]:
    """Pixel boxes of every text inside the axes."""
    FigureCanvasAgg(plate.figure)
    plate.figure.draw_without_rendering()
    axes = plate.figure.axes[0]
    return {text.get_text(): text.get_window_extent().extents for text in axes.texts if text.get_text()}


@cache
def designed_charts(finger: str) -> dict[str, Plate]:
    """The charts of a designed display's finger, by their names."""
    return {plate.name: plate for plate in design_plates(three_finger_controller(), finger)}


@pytest.mark.parametrize("chart", [paper_chart, lambda: designed_charts("thumb")["nichols-thumb"]])
def test_nichols__labels__neither_collide_nor_leave_the_frame(chart: Callable[[], Plate]) -> None:
    made = chart()
    found = boxes(made)
    left, bottom, right, top = made.figure.axes[0].get_window_extent().extents
    for x0, y0, x1, y1 in found.values():
        assert left <= x0
        assert x1 <= right
        assert bottom <= y0
        assert y1 <= top
    for (one, a), (other, b) in combinations(found.items(), 2):
        apart = a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
        assert apart, f"{one} over {other}"


def test_nichols__marks__frequencies_margins_and_grid_are_there() -> None:
    texts = set(boxes(paper_chart()))
    assert {"1 Hz", "10 Hz", "20 Hz", "50 Hz", "100 Hz"} <= texts
    assert {"55.8°", "25.4 dB"} <= texts
    assert {"0 dB", "−3 dB", "−20 dB", "−90°"} <= texts


def test_nichols__phase_axis_and_caption__cover_the_data_and_say_which_contours_are_touched() -> None:
    plate = paper_chart()
    assert all(words in plate.caption for words in ("|T| = 0.79 dB", "|S| = 2.95 dB"))
    left, right = plate.figure.axes[0].get_xlim()
    seen = np.array(plate.table["gain_db"]) > -50.0
    phase = np.array(plate.table["phase_deg"])[seen]
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


def test_save__folder_with_other_things__refused(tmp_path: Path) -> None:
    (tmp_path / "precious.txt").write_text("keep me")
    with pytest.raises(BadInput, match="precious"):
        save_design_plates(paper_controller(), tmp_path)


def test_save__every_plate__svg_and_csv(tmp_path: Path) -> None:
    folder = tmp_path / "charts"
    save_design_plates(paper_controller(), folder)
    names = {f"{kind}-index" for kind in ("nichols", "bode", "sensitivity", "headroom", "equality")}
    assert {path.stem for path in folder.glob("*.svg")} == {path.stem for path in folder.glob("*.csv")} == names
