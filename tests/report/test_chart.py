"""Charts: what they are held against is drawn, and the dots of an identification are of the same thing as its line."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy import signal

import tactuator as tt
from tactuator.report.chart import chart_plate, draw
from tactuator.signals.record import Record
from tactuator.table import Chart, ChartLine
from tactuator.verbs.nouns import RecordResult

RATE_HZ = 2000.0
NUM, DEN = [2875.0], [1.0, 94.0, 290.0]
HERTZ, LEVEL = np.array([1.0, 10.0, 100.0]), np.array([30.0, 31.0, 29.5])


def held_record() -> Record:
    """A record of a known plant whose command is held between the samples, by scipy alone."""
    rng = np.random.default_rng(4)
    command = rng.standard_normal(16000)
    num, den, _ = signal.cont2discrete((NUM, DEN), 1.0 / RATE_HZ, method="zoh")
    position = signal.lfilter(num.ravel(), den, command)
    noise = 2e-3 * np.std(position) * rng.standard_normal(command.size)
    return Record(RATE_HZ, command, position + noise, about={"hold": "zero-order"})


def test_identification__of_a_held_command__shows_the_continuous_plant_as_its_line_does():
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


def test_draw__legend__covers_nothing_of_the_axes():
    figure = Figure(layout="constrained")
    axes = draw(tt.read_curve("bolanowski-1988").chart(), figure.add_subplot())
    figure.draw_without_rendering()
    assert axes.get_legend().get_window_extent().y0 >= axes.get_window_extent().y1 - 1.0


def test_draw__band_of_a_line__is_as_wide_as_its_confidence():
    axes = draw(Chart("x", "y", [ChartLine("line", HERTZ, LEVEL, half=np.full(3, 0.5))]), Figure().add_subplot())
    edges = axes.collections[0].get_paths()[0].vertices[:, 1]
    assert (edges.min(), edges.max()) == (pytest.approx(29.0), pytest.approx(31.5))


def test_record__two_units__have_an_axis_each():
    record = RecordResult(10.0, np.arange(5.0), np.arange(5.0) ** 2, command_unit="V", position_unit="mm")
    axes = record.plot(Figure().add_subplot())
    beside = next(other for other in axes.figure.axes if other is not axes)
    assert (axes.get_ylabel(), beside.get_ylabel()) == ("position (mm)", "command (V)")


@pytest.mark.parametrize("simulated", [False, True])
def test_chart__that_nobody_felt__says_so_in_axes_figure_and_table(simulated: bool):
    chart = Chart("frequency (Hz)", "threshold (dB SL)", [ChartLine("S1", HERTZ, LEVEL, "o")], simulated=simulated)
    plate, axes = chart_plate(chart, "thresholds"), draw(chart, Figure().add_subplot())
    told = [text.get_text() == "simulated: nobody felt this" for text in axes.texts]
    assert told == [True] * simulated
    assert ("simulated: nobody felt this" in plate.svg()) is simulated
    assert plate.csv().splitlines()[1].endswith(",simulated") is simulated
