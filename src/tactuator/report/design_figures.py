"""Figures of a controller: Bode, sensitivity, headroom, landing, prefilter, word length, and a design's whole set."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, MultipleLocator, NullFormatter

from tactuator.arrays import FloatArray
from tactuator.measure.adaptive import LANDS_S, LIFTED_S, Landing, landing
from tactuator.model.controller import Controller
from tactuator.model.requirements import FeedbackRequirements
from tactuator.model.verdict import load_words
from tactuator.report.chart import panels
from tactuator.report.felt_figures import equality_figure
from tactuator.report.figure import (
    BLUE,
    GREEN,
    INK,
    LINE_STYLES,
    ORANGE,
    RED,
    ReportFigure,
    labelled,
    phase_deg,
    save_figures,
    subplots,
    table_of,
)
from tactuator.report.nichols import nichols_figure
from tactuator.result import FREQUENCY, Chart, ChartLine
from tactuator.signals.decibels import db
from tactuator.signals.exchange import continuous_form
from tactuator.signals.loop import FeedbackLoop, System, TwoDegreeLoop, step_response
from tactuator.signals.loop_figures import margins
from tactuator.synthesis.design import Headroom, headroom, headroom_grid_hz
from tactuator.synthesis.family import plant_family
from tactuator.synthesis.touch import fed_response
from tactuator.wordlength.bits import MOST_BITS, BitsNeeded


def bode_figure(systems: Mapping[str, System], band_hz: tuple[float, float]) -> ReportFigure:
    """Draw magnitude (dB) and phase (degrees, continuous) of each system by its label, over band_hz."""
    frequency = np.geomspace(*band_hz, 600)
    levels, phases = [], []
    table: dict[str, list[float]] = {"frequency_hz": frequency.tolist()}
    for number, (label, system) in enumerate(systems.items()):
        response, style = system.response(frequency), LINE_STYLES[number % len(LINE_STYLES)]
        level, phase = db(response), phase_deg(response)
        phase = phase - 360.0 * np.ceil((phase[0] - 180.0) / 360.0)
        levels.append(ChartLine(label, frequency, level, style))
        phases.append(ChartLine("", frequency, phase, style))
        table[f"{label} dB"], table[f"{label} deg"] = level.tolist(), phase.tolist()
    charts = [
        [Chart(FREQUENCY, "magnitude (dB)", levels, True)],
        [Chart(FREQUENCY, "phase (degrees)", phases, True, y_step=90.0)],
    ]
    caption = f"Magnitude and phase of {', '.join(systems)}."
    return ReportFigure("bode", "Bode diagram", caption, panels(charts, 5.0), table)


_STEP_PERIODS = 10.0
"""Periods of the lowest crossover that a step is drawn for: a loop with a phase margin of 30 degrees has settled."""

_LIMIT_COLOURS = {"comfort": GREEN, "command": RED, "travel": BLUE}


def _lowest(rooms: Mapping[str, Headroom]) -> dict[str, Headroom]:
    lowest = {}
    for load, names in _by_load(list(rooms)).items():
        levels = np.array([rooms[name].level_db_sl for name in names])
        which, columns = np.argmin(levels, axis=0), range(levels.shape[1])
        binding = tuple(rooms[names[row]].binding[column] for row, column in zip(which, columns, strict=True))
        lowest[load] = Headroom(rooms[names[0]].frequency_hz, levels.min(axis=0), binding)
    return lowest


def headroom_figure(rooms: Mapping[str, Headroom]) -> ReportFigure:
    """Draw the greatest sinusoidal reference (dB SL) against frequency for each load; colour: the limit that binds."""
    curves, points = [], []
    rows: list[tuple[object, ...]] = []
    for number, (load, room) in enumerate(rooms.items()):
        style = LINE_STYLES[number % len(LINE_STYLES)]
        curves.append(ChartLine(load_words(load), room.frequency_hz, room.level_db_sl, style, colour=INK, width=0.9))
        for limit, colour in _LIMIT_COLOURS.items():
            bound = np.array(room.binding) == limit
            if np.any(bound):
                at = room.frequency_hz[bound], room.level_db_sl[bound]
                points.append(ChartLine(f"stopped by {limit}", *at, "o", colour=colour))
        rows += labelled((load,), room.frequency_hz, room.level_db_sl, np.array(room.binding))
    lowest = min(float(room.level_db_sl.min()) for room in rooms.values())
    highest = max(float(room.level_db_sl.max()) for room in rooms.values())
    ends = (min(5.0 * np.floor((lowest - 8.0) / 5.0), 40.0), highest + 1.0)
    chart = Chart(FREQUENCY, "greatest level (dB SL)", [*curves, *points], True, y_range=ends)
    caption = (
        "The greatest level of one sinusoid before the mechanism's travel, the command's range or comfort stops it; "
        "the colour of a point says which."
    )
    table = table_of(("load", "frequency_hz", "level_db_sl", "binding"), rows)
    return ReportFigure("headroom", "Headroom", caption, panels([[chart]], 3.6), table)


def landing_figure(shown: Landing) -> ReportFigure:
    """Draw the change of the felt level against time, adaptive over fixed, and the band of 1 dB about none."""
    curves = [
        ChartLine("fixed", shown.time_s, shown.fixed_db, "--", colour=ORANGE),
        ChartLine("adaptive", shown.time_s, shown.adaptive_db, colour=BLUE),
    ]
    reach = max(1.5, 1.15 * float(np.max(np.abs([shown.fixed_db, shown.adaptive_db]))))
    touched = {"touched": (LANDS_S, LIFTED_S)}
    change = "change of the felt level (dB)"
    chart = Chart("time (s)", change, curves, targets=(0.0,), tolerance=1.0, stretches=touched, y_range=(-reach, reach))
    adaptive, fixed = (f"{v.min():+.2f} to {v.max():+.2f} dB" for v in (shown.adaptive_db, shown.fixed_db))
    caption = (
        f"Felt level of {shown.channel} in windows of 0.1 s, against the same run free, while the load {shown.load!r} "
        f"lands and is lifted (grey): five tones at 30 dB SL on the simulated display with hum, noise, friction and "
        f"converters. Adaptive: {adaptive}; fixed: {fixed}."
    )
    table = {name: getattr(shown, name).tolist() for name in ("time_s", "adaptive_db", "fixed_db")}
    return ReportFigure("landing", "A finger lands", caption, panels([[chart]], 3.2), table)


def sensitivity_figure(
    loops: Mapping[str, FeedbackLoop], requirements: FeedbackRequirements, band_hz: tuple[float, float]
) -> ReportFigure:
    """Draw |S| and |T| in dB for each load, the limits as bars (the curves must stay below them).

    loops: by the name of their plant; the models of one load are one envelope around its nominal line.
    """
    frequency = np.geomspace(*band_hz, 600)
    by_load, lines = _by_load(list(loops)), []
    table: dict[str, list[float]] = {"frequency_hz": frequency.tolist()}
    for number, (load, names) in enumerate(by_load.items()):
        curves = (("S", BLUE, FeedbackLoop.sensitivity), ("T", RED, FeedbackLoop.complementary))
        for symbol, colour, response in curves:
            levels = np.array([db(response(loops[name], frequency)) for name in names])
            low, high = levels.min(axis=0), levels.max(axis=0)
            around = (levels[0] - low, high - levels[0]) if len(names) > 1 else None
            label, style = f"|{symbol}|, {load_words(load)}", LINE_STYLES[number % len(LINE_STYLES)]
            lines.append(ChartLine(label, frequency, levels[0], style, around, colour=colour))
            table[f"{symbol} {load} dB"] = levels[0].tolist()
            if len(names) > 1:
                table |= {f"{symbol} {load} least dB": low.tolist(), f"{symbol} {load} greatest dB": high.tolist()}
    lowest = max(-60.0, min(float(np.min(line.y)) for line in lines) - 3.0)
    peak = requirements.sensitivity_peak
    limits = {} if peak is None else {"limit of |S|": float(db(peak))}
    bars = list(_bars(requirements))
    chart = Chart(FREQUENCY, "magnitude (dB)", [*lines, *bars], True, limits=limits, y_range=(lowest, None))
    caption = "Sensitivity S and complementary sensitivity T; bars: the limits of the display file, to stay below."
    if len(loops) > len(by_load):
        caption += " Shaded: every model that fits the record."
    return ReportFigure("sensitivity", "Sensitivity", caption, panels([[chart]], 4.2), table)


def step_figure(loops: Mapping[str, FeedbackLoop], rate_hz: float) -> ReportFigure:
    """Draw the closed loop's answer to a unit step of F's output, free and under each load, until it has settled."""
    nominal = {load: loops[names[0]] for load, names in _by_load(list(loops)).items()}
    duration_s = _STEP_PERIODS / min(margins(loop).crossover_hz for loop in nominal.values())
    answers = {load_words(load): step_response(loop, duration_s) for load, loop in nominal.items()}
    time_s = np.arange(len(next(iter(answers.values())))) / rate_hz
    curves = [
        ChartLine(words, 1e3 * time_s, answer, LINE_STYLES[number % len(LINE_STYLES)])
        for number, (words, answer) in enumerate(answers.items())
    ]
    chart = Chart("time (ms)", "position per unit of F's output", curves, targets=(1.0,))
    table = {"time_s": time_s.tolist()} | {words: answer.tolist() for words, answer in answers.items()}
    caption = "Unit step through the closed loop, without the prefilter."
    return ReportFigure("step", "Step response", caption, panels([[chart]], 3.4), table)


def _bars(requirements: FeedbackRequirements) -> Iterator[ChartLine]:
    """Yield a short bar at each frequency of which the display file limits |S| or |T|."""
    bars = (
        *zip(requirements.rejection_hz, requirements.rejection_max_db, strict=True),
        *zip(requirements.mains_hz, requirements.mains_max_db, strict=True),
    )
    for frequency, limit in bars:
        ends = np.array([frequency / 1.12, frequency * 1.12])
        yield ChartLine("limits", ends, np.full(2, limit), colour=ORANGE, width=3.0)


def prefilter_figure(errors: Mapping[str, tuple[FloatArray, FloatArray]], tolerance_db: float) -> ReportFigure:
    """Draw the error of |H| against the curve for every prefilter, with the tolerance as a band.

    errors: by name, frequency_hz (n,) and the error there, dB (n,).
    """
    curves = []
    rows: list[tuple[object, ...]] = []
    for label, (frequency, error) in errors.items():
        worst = float(np.max(np.abs(error)))
        curves.append(ChartLine(f"{label}: at most {worst:.2f} dB", frequency, error))
        rows += labelled((label,), frequency, error)
    chart = Chart(FREQUENCY, "|H| less curve (dB)", curves, True, (0.0,), tolerance_db)
    caption = f"Error of the response against the threshold curve, and the tolerance of ±{tolerance_db:g} dB."
    table = table_of(("prefilter", "frequency_hz", "error_db"), rows)
    return ReportFigure("prefilter", "Prefilters against the curve", caption, panels([[chart]], 3.4), table)


_WORDS = {"direct": "one direct form", "sections": "second-order sections", "delta": "delta sections"}
_FORM_COLOURS = {"direct": BLUE, "sections": RED, "delta": GREEN}


def resolution_figure(
    needed: Mapping[str, Mapping[str, Mapping[float, BitsNeeded]]],
    whose: str = "the paper's filters",
    band: str = "0.1-300 Hz",
) -> ReportFigure:
    """Draw a panel for each filter: bits to keep 0.1 dB (solid) and to be stable (dashed). needed: filter ("prefilter
    F", ...) to form to rate_hz to bits. whose, band: as in the caption.
    """
    drawing, axes = subplots(1, len(needed), height_in=3.6, sharey=True, squeeze=False)
    for panel, (filter_name, forms) in zip(axes[0], needed.items(), strict=True):
        _draw_resolution(panel, forms)
        panel.set_title(filter_name, fontsize=9)
        panel.axhline(14.0, color=INK, linewidth=0.8, linestyle=":")
    beside = ("axes fraction", "data")
    axes[0, -1].annotate("16-bit\nwords", (1.0, 14.0), (3, 0), beside, "offset points", fontsize=7, va="center")
    axes[0, 0].set_ylabel("fractional bits needed", fontsize=9)
    axes[0, 0].yaxis.set_major_locator(MultipleLocator(5))
    axes[0, 0].set_ylim(-1.5, None)
    forms_shown = dict.fromkeys(form for forms in needed.values() for form in forms)
    keys = [Line2D([], [], color=_FORM_COLOURS[form], label=_WORDS[form]) for form in forms_shown]
    keys += [
        Line2D([], [], color=INK, marker="o", markersize=4, label="within 0.1 dB"),
        Line2D([], [], color=INK, marker="o", markersize=3, fillstyle="none", linestyle="--", label="stable"),
    ]
    drawing.legend(handles=keys, loc="outside lower center", ncols=5, fontsize=7, frameon=False, columnspacing=1.2)
    caption = (
        f"Fractional bits that the coefficients of {whose} need so that the response stays within 0.1 dB over {band} "
        "(solid) and the filter, or its loop, stays stable (dashed). 16-bit words have 14 for a section's denominator. "
        f"A line ends where {MOST_BITS} bits are not enough."
    )
    rows = (
        (filter_name, form, rate, bits.stable, bits.accurate)
        for filter_name, forms in needed.items()
        for form, by_rate in forms.items()
        for rate, bits in by_rate.items()
    )
    table = table_of(("filter", "form", "rate_hz", "stable_bits", "accurate_bits"), rows)
    return ReportFigure("resolution", "Coefficient resolution against sampling rate", caption, drawing, table)


def _draw_resolution(panel: Axes, forms: Mapping[str, Mapping[float, BitsNeeded]]) -> None:
    rates: Sequence[float] = []
    for form, by_rate in forms.items():
        rates = list(by_rate)
        accurate, stable = (
            [getattr(bits, what) if getattr(bits, what) <= MOST_BITS else np.nan for bits in by_rate.values()]
            for what in ("accurate", "stable")
        )
        panel.plot(rates, accurate, "o-", color=_FORM_COLOURS[form], markersize=4)
        panel.plot(rates, stable, "o--", color=_FORM_COLOURS[form], markersize=3, linewidth=0.9, fillstyle="none")
    panel.set_xscale("log", base=2)
    panel.xaxis.set_major_locator(FixedLocator(rates))
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / 1000:g}"))
    panel.xaxis.set_minor_formatter(NullFormatter())
    panel.set_xlabel("sampling rate (kHz)", fontsize=9)


def loop_shape_figure(controller: Controller, channel_name: str, name: str, title: str) -> ReportFigure:
    """Draw the Nichols chart of a channel that has a loop: as it runs, in continuous time, and on every other plant."""
    display = controller.display
    channel, feedback = display.channel(channel_name), controller.channel(channel_name).feedback(display.rate_hz)
    assert feedback is not None
    nominal, *others = (
        FeedbackLoop(feedback, member.sampled)
        for member in plant_family(channel, display.rate_hz, display.delay_samples)
    )
    continuous = FeedbackLoop(continuous_form(feedback), channel.plant)
    return nichols_figure(nominal, channel.plant, continuous, others, name=name, title=title)


def design_figures(controller: Controller, channel_name: str) -> tuple[ReportFigure, ...]:
    """Return the figures of one channel, each named KIND-CHANNEL; of an adaptive one, how a finger lands as well."""
    display = controller.display
    channel, designed = display.channel(channel_name), controller.channel(channel_name)
    family = plant_family(channel, display.rate_hz, display.delay_samples)
    prefilter, feedback = designed.prefilter(display.rate_hz), designed.feedback(display.rate_hz)
    loops = {member.name: TwoDegreeLoop(prefilter, feedback, member.sampled) for member in family}
    closed = {name: loop.feedback for name, loop in loops.items() if loop.feedback is not None}
    free = loops[family[0].name]
    low, high = channel.threshold.band_hz
    wide = (low / 2.0, min(2.0 * high, 0.45 * display.rate_hz))
    figures = []
    if feedback is not None:
        nominal, *others = closed.values()
        figures.append(nichols_figure(nominal, channel.plant, family=others, band_hz=wide))
        systems = {"P": family[0].sampled, "C": feedback, "C P": nominal.open_loop, "F": prefilter}
        figures += [
            bode_figure(systems, wide),
            sensitivity_figure(closed, channel.feedback, wide),
            step_figure(closed, display.rate_hz),
        ]
    else:
        figures.append(bode_figure({"P": family[0].sampled, "F": prefilter}, wide))
    grid = headroom_grid_hz(channel)
    rooms = {}
    for member in family:
        loop = loops[member.name]
        answer = fed_response(designed.feed_forward, channel, free, loop, member.load, grid, display.rate_hz)
        room = headroom(channel, loop, grid, display.objectives.comfort_db_sl, answer)
        rooms[member.name] = room.before(designed.strength, display.rate_hz)
    figures.append(headroom_figure(_lowest(rooms)))
    fine = np.geomspace(low, high, 400)
    figures.append(equality_figure(channel, fine, free.position_response(fine)))
    if designed.feed_forward is not None:
        figures.append(landing_figure(landing(controller, channel_name)))
    return tuple(
        replace(figure, name=f"{figure.name}-{channel_name}", title=f"{figure.title}, {channel_name}")
        for figure in figures
    )


def drawn(controller: Controller, channel_name: str, kind: str) -> Figure:
    """Return the drawing of one kind of a channel's figures."""
    name = f"{kind}-{channel_name}"
    (figure,) = (each.drawing for each in design_figures(controller, channel_name) if each.name == name)
    assert isinstance(figure, Figure)
    return figure


def save_design_figures(controller: Controller, folder: Path) -> None:
    """Write every channel's figures (SVG, with their numbers as CSV) into `folder`, whole or not at all.

    Raises BadInput for a folder that holds anything else.
    """
    channels = controller.channels
    save_figures([figure for channel in channels for figure in design_figures(controller, channel.name)], folder)


def _by_load(names: Sequence[str]) -> dict[str, list[str]]:
    """Return names of a family's members (`finger`, `finger, model 2`) by their load, the nominal model first."""
    loads: dict[str, list[str]] = {}
    for name in names:
        loads.setdefault(name.split(", model ")[0], []).append(name)
    return loads
