"""Charts: everything is in them, inside the frame, what they are held against is drawn, and no label covers another."""

import re
import weakref
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from scipy import signal

import tactuator as tt
from tactuator.errors import BadInput
from tactuator.model.verdict import Finding, Outcome, finding_row, load_words, remark_lines
from tactuator.report.chart import chart_figure, draw
from tactuator.report.design_figures import design_figures, resolution_figure, save_design_figures
from tactuator.report.figure import ReportFigure, save_figures
from tactuator.report.nichols import hull, nichols_figure
from tactuator.report.printed import design_rows, printed_factors, printed_polynomial
from tactuator.result import Chart, ChartLine
from tactuator.signals.discretise import discretise
from tactuator.signals.loop import FeedbackLoop
from tactuator.signals.record import Record
from tactuator.signals.systems import ContinuousSystem
from tactuator.synthesis import paper
from tactuator.synthesis.design import design_controller
from tactuator.synthesis.family import plant_family
from tactuator.wordlength.bits import MOST_BITS, BitsNeeded
from tests.report.boxes import assert_texts_apart, boxes
from tests.synthesis.displays import channel, paper_controller, three_finger_controller, three_fingers


@cache
def paper_chart() -> ReportFigure:
    family = plant_family(channel(), 4000.0, 1)
    c = discretise(paper.FEEDBACK, 4000.0, "bilinear")
    loops = [FeedbackLoop(c, one.sampled) for one in family]
    continuous = FeedbackLoop(paper.FEEDBACK, paper.PLANT)
    return nichols_figure(loops[0], paper.PLANT, continuous, loops[1:], name="fig07")


@cache
def default_chart() -> ReportFigure:
    made = design_controller(three_fingers())
    return next(figure for figure in design_figures(made, "index") if figure.name == "nichols-index")


@cache
def designed_charts(finger: str) -> dict[str, ReportFigure]:
    return {figure.name: figure for figure in design_figures(three_finger_controller(), finger)}


@pytest.mark.slow
def test_texts__of_every_figure_of_a_design__stand_apart() -> None:
    for figure in (paper_chart(), default_chart(), *designed_charts("thumb").values(), *many_models().values()):
        assert_texts_apart(figure)


def test_resolution__labels_and_bits__neither_collide_nor_go_on_where_bits_end() -> None:
    rates = (4000.0, 8000.0, 16000.0, 32000.0)
    bits = {
        "direct": [(22, 35), (25, 40), (28, 43), (32, MOST_BITS + 1)],
        "sections": [(16, 25), (19, 28), (20, 28), (23, 31)],
        "delta": [(0, 14), (0, 14), (0, 13), (0, 13)],
    }
    forms = {form: {r: BitsNeeded(*b) for r, b in zip(rates, of, strict=True)} for form, of in bits.items()}
    made = resolution_figure({"prefilter": forms, "feedback": forms}, whose="a controller")
    assert len(boxes(made)) > 20
    assert_texts_apart(made)
    ends = [np.isnan(line.get_ydata()[-1]) for line in made.drawing.axes[0].get_lines() if len(line.get_ydata()) == 4]
    assert ends == [True, False, False, False, False, False]
    assert MOST_BITS + 1 in made.table["accurate_bits"]
    assert len(made.table["rate_hz"]) == 24
    assert f"{MOST_BITS} bits are not enough" in made.caption


def test_nichols__marks_and_caption__cover_the_data_and_name_the_contours() -> None:
    figure = paper_chart()
    texts = {name.rpartition(" ")[0] for name in boxes(figure)}
    assert {"1", "10", "20", "50", "100", "margins: 55.8°, 25.4 dB", "0 dB", "−3 dB", "−20 dB"} <= texts
    assert all(words in figure.caption for words in ("|T| = 0.79 dB", "|S| = 2.95 dB"))
    left, right = figure.drawing.axes[0].get_xlim()
    phase = np.array(figure.table["phase_deg"])[np.array(figure.table["gain_db"]) > -50.0]
    assert left <= phase.min()
    assert phase.max() <= right


@cache
def many_models() -> dict[str, ReportFigure]:
    made = three_finger_controller()
    rng = np.random.default_rng(0)
    factors = rng.normal(1.0, 0.1, (8, 3))
    models = tuple(ContinuousSystem.from_polynomials([2875.0 * a], [1.0, 94.0 * b, 290.0 * c]) for a, b, c in factors)
    channels = (replace(made.display.channels[0], family=models), *made.display.channels[1:])
    shown = replace(made, display=replace(made.display, channels=channels))
    return {figure.name.split("-")[0]: figure for figure in design_figures(shown, "index")}


def test_plates__eighteen_plants__a_legend_of_few_lines_and_an_envelope() -> None:
    figures = many_models()
    for kind in ("nichols", "sensitivity", "headroom"):
        drawing = figures[kind].drawing
        texts = [one.get_text() for one in (drawing.axes[0].get_legend() or drawing.legends[0]).get_texts()]
        assert len(texts) <= 7, texts
        assert not any("model" in text for text in texts)
    assert "all 18 plants" in figures["nichols"].caption
    table = {name: np.array(column) for name, column in figures["sensitivity"].table.items()}
    assert np.all(table["S finger least dB"] <= table["S finger dB"])
    assert np.all(table["S finger greatest dB"] >= table["S finger dB"])
    assert np.max(table["S finger greatest dB"] - table["S finger least dB"]) > 1.0
    assert set(figures["headroom"].table["load"]) == {"none", "finger"}


@given(st.lists(st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0)), min_size=3, max_size=30))
def test_hull__any_points__holds_them_all_and_turns_one_way(points: list[tuple[float, float]]) -> None:
    corners = hull(np.array(points))
    following = np.roll(corners, -1, axis=0)
    edges = following - corners
    away = np.array(points)[:, None] - corners
    assert np.all(edges[:, 0] * away[..., 1] - edges[:, 1] * away[..., 0] >= -1e-6)


def test_equality__felt_level__flat() -> None:
    figure = designed_charts("thumb")["equality-thumb"]
    felt = np.array(figure.table["felt_db_sl"])
    total = np.array(figure.table["displacement_db_re_1um"]) + np.array(figure.table["sensitivity_db"])
    assert felt == pytest.approx(total)
    assert np.abs(felt - 30.0).max() <= 0.25
    assert "inferred" in figure.caption


def test_save__every_plate__svg_and_csv_in_a_folder_of_nothing_else(tmp_path: Path) -> None:
    save_design_figures(paper_controller(), tmp_path / "charts")
    names = {f"{kind}-index" for kind in ("nichols", "bode", "sensitivity", "step", "headroom", "equality")}
    for ending in ("svg", "csv"):
        assert {path.stem for path in (tmp_path / "charts").glob(f"*.{ending}")} == names
    other = tmp_path / "other"
    other.mkdir()
    (other / "precious.txt").write_text("keep me")
    with pytest.raises(BadInput, match="precious"):
        save_design_figures(paper_controller(), other)


RATE_HZ = 2000.0
NUM, DEN = [2875.0], [1.0, 94.0, 290.0]
HERTZ, LEVEL = np.array([1.0, 10.0, 100.0]), np.array([30.0, 31.0, 29.5])


def held_record() -> Record:
    rng = np.random.default_rng(4)
    command = rng.standard_normal(16000)
    num, den, _ = signal.cont2discrete((NUM, DEN), 1.0 / RATE_HZ, method="zoh")
    position = signal.lfilter(num.ravel(), den, command)
    noise = 2e-3 * np.std(position) * rng.standard_normal(command.size)
    return Record(RATE_HZ, command, position + noise, about={"hold": "zero-order"})


def test_identification__of_a_held_command__shows_the_continuous_plant():
    identified = tt.identify(held_record(), order=2, zeros=0, hold="zero-order", friction=False)
    hertz, value, error = identified.shown()
    truth = signal.freqs(NUM, DEN, 2.0 * np.pi * hertz)[1]
    off = np.degrees(np.abs(np.angle(value / truth)))
    at = (hertz > 150.0) & (hertz < 300.0) & (error < 0.05)
    assert at.sum() > 3
    assert off[at].max() < 8.0
    held = np.degrees(np.pi * hertz[at] / RATE_HZ)  # half a sample: what the dots lay below the line before
    assert held.max() > 20.0
    assert np.median(off[at]) < 0.2 * np.median(held)


def test_draw__levels_and_confidence__all_stand_on_the_axes():
    measured = ChartLine("index", HERTZ, LEVEL, "o", np.full(3, 0.2), [False, False, True])
    chart = Chart("frequency (Hz)", "felt (dB SL)", [measured], True, (30.0,), 1.0, 1.65, {"comfort": 50.0})
    axes = draw(chart, Figure().add_subplot())
    words = [text.get_text() for text in axes.get_legend().get_texts()]
    assert words == ["below the JND of 1.65 dB", "tolerance ±1 dB", "asked", "comfort", "index"]
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_xscale()) == ("frequency (Hz)", "felt (dB SL)", "log")
    levels = [float(line.get_ydata()[0]) for line in axes.lines if len(set(line.get_ydata())) == 1]
    assert {29.0, 30.0, 31.0, 50.0} <= set(levels)
    crosses = [line for line in axes.lines if line.get_marker() == "x"]
    assert [line.get_xdata().tolist() for line in crosses] == [[100.0]]


def test_draw__legend_band_and_units__cover_nothing_and_have_an_axis_each():
    figure = Figure(layout="constrained")
    axes = draw(tt.read_curve("bolanowski-1988").chart(), figure.add_subplot())
    figure.draw_without_rendering()
    assert axes.get_legend().get_window_extent().y0 >= axes.get_window_extent().y1 - 1.0
    axes = draw(Chart("x", "y", [ChartLine("line", HERTZ, LEVEL, half=np.full(3, 0.5))]), Figure().add_subplot())
    edges = axes.collections[0].get_paths()[0].vertices[:, 1]
    assert (edges.min(), edges.max()) == (pytest.approx(29.0), pytest.approx(31.5))
    record = Record(10.0, np.arange(5.0), np.arange(5.0) ** 2, command_unit="V", position_unit="mm")
    axes = record.plot(Figure().add_subplot())
    beside = next(other for other in axes.figure.axes if other is not axes)
    assert (axes.get_ylabel(), beside.get_ylabel()) == ("position (mm)", "command (V)")


@pytest.mark.parametrize("simulated", [False, True])
def test_chart__that_nobody_felt__says_so_in_axes_figure_and_table(simulated: bool):
    chart = Chart("frequency (Hz)", "threshold (dB SL)", [ChartLine("S1", HERTZ, LEVEL, "o")], simulated=simulated)
    figure, axes = chart_figure(chart, "thresholds"), draw(chart, Figure().add_subplot())
    told = [text.get_text() == "simulated: nobody felt this" for text in axes.texts]
    assert told == [True] * simulated
    assert ("simulated: nobody felt this" in figure.svg()) is simulated
    assert figure.csv().splitlines()[1].endswith(",simulated") is simulated


MARGINS = {
    "crossover_hz": "crossover (Hz)", "phase_margin_deg": "phase margin (deg)", "gain_margin_db": "gain margin (dB)",
    "least_gain": "lowest stable gain (0: stable at every lower gain)", "sensitivity_peak": "max|S|",
    "complementary_peak": "max|T|", "disk_margin": "disk margin", "delay_margin_samples": "delay margin (samples)",
    "command_noise_gain": "command noise gain",
}  # fmt: skip


def test_design_rows__of_a_report__print_two_digits_after_the_point():
    report = paper_controller().channels[0].report
    report = report | {
        "margins": report["margins"] | {"gain_margin_db": None},
        "mains_db": {"120": -9.005, "60": -3.14159},
    }
    poles, greatest, rms = (report["prefilter"][name] for name in ("poles", "max_error_db", "rms_error_db"))
    margins = {MARGINS[name]: f"{report['margins'][name] or 0.0:.2f}" for name in MARGINS} | {"gain margin (dB)": "—"}
    assert list(design_rows([SimpleNamespace(report=report)])) == [
        *margins.items(),
        ("mean |S| over the rejection band (dB)", f"{report['rejection_db']['mean']:.2f}"),
        ("prefilter: poles", f"{poles}"),
        ("prefilter: greatest error (dB)", f"{greatest:.2f}"),
        ("prefilter: rms error (dB)", f"{rms:.2f}"),
        ("|T| at 60 Hz (dB)", "-3.14"),
        ("|T| at 120 Hz (dB)", "-9.01"),
    ]


def test_findings_loads_and_remarks__are_printed_in_one_line_each():
    found = Finding("iv", "index", "finger", Outcome.NOT_MET, "felt hum", 3.14159, 0.5, "dB SL", 59.99951)
    shown = ("iv", "index", "not met", "felt hum 3.14 dB SL", "0.5 dB SL", "60 Hz", "finger")
    assert finding_row(found) == shown
    assert finding_row(replace(found, side=-1.0))[3] == "felt hum -3.14 dB SL"
    bare = Finding("build", "thumb", "none", Outcome.NOT_JUDGED, "float32")
    assert finding_row(bare) == ("build", "thumb", "not judged", "float32", "", "", "free")
    assert [load_words(name) for name in ("none", "finger", "none, model 2", "finger, model 3")] == [
        "free", "finger", "free, fit 2 of the record", "finger, fit 3 of the record",
    ]  # fmt: skip
    twice = [Finding(name, "c", "none", Outcome.NOT_JUDGED, "x", remark="nothing tells") for name in ("i", "ii", "i")]
    same = [Finding("iv", name, "none", Outcome.NOT_JUDGED, "change", remark="no load") for name in ("a", "b", "c")]
    other = Finding("ii", "b", "none", Outcome.NOT_MET, "felt hum", remark="less hum")
    quiet = Finding("i", "a", "none", Outcome.MET, "error")
    assert remark_lines([quiet, *same, other]) == ["iv, a, b, c: no load", "ii, b: less hum"]
    assert remark_lines(twice) == ["i, ii, c: nothing tells"]


def test_printed__signs_ones_zeros_pairs_and_repeated_roots__written_as_by_hand():
    assert printed_polynomial(np.array([-1.0, 0.0, 2.5, -3.0])) == "−s³ + 2.5s − 3"
    paper = ContinuousSystem.from_polynomials([12.264, 12.264 * 111, 12.264 * 530], [1, 260, 0])
    assert printed_factors(paper) == "12.264 (s + 5) (s + 106) / (s (s + 260))"
    pair = ContinuousSystem(np.array([]), np.array([-3 + 4j, -3 - 4j, -7, -7]), 2.0)
    assert printed_factors(pair) == "2 / ((s² + 6s + 25) (s + 7)²)"
    assert printed_factors(ContinuousSystem(np.array([]), np.array([]), 0.5)) == "0.5"


def _value(text: str, s: complex) -> complex:
    """Return what the printed text says at s, read by a reader that knows nothing of roots."""
    for digit, power in zip("⁰¹²³⁴⁵⁶⁷⁸⁹", "0123456789", strict=True):
        text = text.replace(digit, f"**{power}")
    text = re.sub(r"(?<=\d)s", "*s", text.replace("−", "-"))
    return complex(eval(re.sub(r"(?<=[\ds)]) (?=[(s])", "*", text), {"s": s}))


@given(
    real=st.lists(st.floats(-1e4, -1.0), max_size=4),
    pairs=st.lists(st.tuples(st.floats(-500.0, -5.0), st.floats(10.0, 2000.0)), max_size=3),
    gain=st.floats(0.01, 100.0),
)
def test_printed_factors__read_back__respond_like_the_system(real, pairs, gain):
    poles = np.array([*real, *(complex(a, b) for a, b in pairs), *(complex(a, -b) for a, b in pairs)], complex)
    system = ContinuousSystem(np.array([-20.0]), poles, gain)
    s = 2j * np.pi * 33.0
    asked = complex(gain * (s + 20.0) / np.prod(s - poles))
    assert abs(_value(printed_factors(system), s) / asked - 1.0) < 0.05


def test_save_figures__drawn_as_they_are_saved__are_let_go_one_by_one(tmp_path: Path) -> None:
    """Of 4292 subjects all figures at once took up 6 GB."""
    drawn = list[weakref.ref[ReportFigure]]()

    def figures() -> Iterator[ReportFigure]:
        for name in ("a", "b", "c"):
            assert sum(each() is not None for each in drawn) <= 1
            figure = ReportFigure(name, "", "", "<svg/>", {"x": [1]})
            drawn.append(weakref.ref(figure))
            yield figure
            del figure

    save_figures(figures(), tmp_path / "out", ["a", "b", "c"])
    assert len(list((tmp_path / "out").iterdir())) == 6
