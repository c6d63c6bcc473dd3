"""Figures of what is felt: thresholds, psychometric functions, the equality of figure 2, and speech asked and felt."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.result.store_results import PersonThresholds, PsychometricTrials
from tactuator.measure.felt import HEARD_DB_SL, LONG_FRAME_S, SHORT_FRAME_S, FeltReport, FingerFelt
from tactuator.model.description import Channel
from tactuator.model.plant import DERIVATIVES
from tactuator.perception.curve import COMFORT_DB_SL, ThresholdCurve
from tactuator.report.chart import panels
from tactuator.report.figure import (
    BLUE,
    CYCLE,
    GREEN,
    INK,
    ORANGE,
    RED,
    ReportFigure,
    frequency_axis,
    labelled,
    legend,
    subplots,
    table_of,
)
from tactuator.result import FREQUENCY, Chart, ChartLine
from tactuator.signals.decibels import db


def felt_figure(report: FeltReport, what: str, name: str) -> ReportFigure:
    """Draw a panel for each finger: band levels asked and felt above, their difference below where 10 dB SL or more."""
    fingers, names = report.fingers, ("band level (dB SL)", "felt − asked (dB)")
    loudest = max(float(np.max(finger.asked_db_sl)) for finger in fingers)
    reach = max(1.0, 1.15 * max(float(np.nanmax(np.abs(finger.difference_db))) for finger in fingers))
    upper, lower = [], []
    for finger in fingers:
        hertz = finger.centre_hz
        curves = [
            ChartLine("asked", hertz, finger.asked_db_sl, colour=BLUE),
            ChartLine("felt", hertz, finger.felt_db_sl, "o", colour=RED),
        ]
        of: dict[str, Any] = {"limits": {"threshold": 0.0}, "y_range": (-20.0, loudest + 8.0), "title": finger.finger}
        upper.append(Chart(FREQUENCY, names[0], curves, True, **of))
        difference = [ChartLine("", hertz, finger.difference_db, "o", colour=RED)]
        lower.append(Chart(FREQUENCY, names[1], difference, True, (0.0,), y_range=(-reach, reach)))
    caption = (
        f"{what}: levels asked for and felt in third-octave bands over the whole utterance, and their difference where "
        f"{HEARD_DB_SL:g} dB SL or more was asked for; rms {report.worst_rms_db:.2f} dB on the worst finger."
    )
    drawing = panels([upper, lower], 4.2, (2.2, 1.0))
    return ReportFigure(name, "Speech, asked and felt", caption, drawing, _band_levels_table(report))


def equality_figure(
    channel: Channel, frequency_hz: FloatArray, position_response: ComplexArray, name: str = "equality"
) -> ReportFigure:
    """Draw three panels side by side for a reference of 30 dB SL: the displacement that the display makes of it,
    the finger's sensitivity, and their sum, which is the felt level.

    position_response: H at frequency_hz, shape (n,), volts of y per threshold unit.
    """
    level_db_sl = 30.0
    speed = (2.0 * np.pi * frequency_hz) ** DERIVATIVES[channel.quantity]
    displacement = db(np.abs(position_response) / channel.sensor_gain_v_per_mm / speed * 1e3) + level_db_sl
    sensitivity = -channel.threshold.curve.level_db_re_1um_at(frequency_hz)
    felt = displacement + sensitivity
    worst = float(np.max(np.abs(felt - level_db_sl)))
    caption = (
        f"A reference of {level_db_sl:g} dB SL at every frequency, channel {channel.name}: displacement (dB) plus "
        f"sensitivity (dB, the threshold curve “{channel.threshold.curve.name}” — "
        f"{channel.threshold.curve.provenance} — upside down) is felt at {level_db_sl:g} dB SL within {worst:.2f} dB."
    )
    reach = 0.5 * max(float(np.ptp(displacement)), float(np.ptp(sensitivity))) + 6.0
    centres = [0.5 * float(values.max() + values.min()) for values in (displacement, sensitivity)]
    ends = [*((centre - reach, centre + reach) for centre in centres), (-8.0, level_db_sl + 12.0)]
    drawn = (
        (displacement, BLUE, "displacement", "dB re 1 µm"),
        (sensitivity, GREEN, "+ sensitivity", "dB re 1/µm"),
        (felt, RED, "= felt level", "dB SL"),
    )
    charts = [
        Chart(FREQUENCY, unit, [ChartLine("", frequency_hz, values, colour=colour, width=1.8)], True, y_range=pair,
              title=words)
        for (values, colour, words, unit), pair in zip(drawn, ends, strict=True)
    ]  # fmt: skip
    charts[2] = replace(charts[2], limits={"threshold, 0 dB SL": 0.0})
    names = ("frequency_hz", "displacement_db_re_1um", "sensitivity_db", "felt_db_sl")
    table = table_of(names, labelled((), frequency_hz, displacement, sensitivity, felt))
    return ReportFigure(name, "Response + sensitivity = constant", caption, panels([charts], 2.8), table)


_MARKERS = "os^Dv<>"


def thresholds_figure(
    people: Sequence[PersonThresholds], library: ThresholdCurve, new: ThresholdCurve | None,
    others: Mapping[str, ThresholdCurve] = MappingProxyType({}),
) -> ReportFigure:  # fmt: skip
    """Draw points with standard errors for every person, the library's curve (solid), the new one (dashed, with band),
    and others by name (dotted). Flagged points have a cross, censored ones an arrow.
    """
    drawing, axes = subplots(height_in=4.2)
    low = min(float(person.frequency_hz.min()) for person in people)
    high = max(float(person.frequency_hz.max()) for person in people)
    fine = np.geomspace(low, high, 300)
    label = f"{library.name} ({library.provenance})"
    axes.plot(fine, library.level_db_re_1um_at(fine), color=INK, linewidth=1.4, label=label)
    if new is not None:
        _draw_new(axes, new, others, fine)
    together = _together(people)
    drawn = people if len(people) <= _NAMED else [together]
    spread = np.linspace(-0.03, 0.03, len(drawn)) if len(drawn) > 1 else np.zeros(1)
    for index, (person, shift) in enumerate(zip(drawn, spread, strict=True)):
        _draw_person(axes, person, person.frequency_hz * np.exp(shift), index)
    frequency_axis(axes, low / 1.15, high * 1.15, "threshold (dB re 1 µm peak)")
    legend(axes, loc="lower left")
    caption = (
        f"Detection thresholds of {', '.join(person.name for person in drawn)} with their standard errors, over the "
        f"curve of the design ({library.name}, {library.provenance})"
    )
    known = f" ({new.bounds_said})" if new is not None and new.bounds_said else ""
    caption += f"; dashed: the new curve, with its standard error{known}." if new is not None else "."
    flags, bounds = np.asarray(together.flagged), together.bound or ()
    crossed, beyond = int(flags.sum()), sum(bound != "" for bound in bounds)
    caption += f" Crossed: {crossed} thresholds of flagged runs." if crossed else ""
    caption += f" Arrows: {beyond} that lie beyond what was played." if beyond else ""
    rows = [row for person in people for row in labelled((person.name,), *(getattr(person, name) for name in _KNOWN))]
    table = table_of(("person", *_KNOWN), rows)
    if any(person.flagged is not None for person in people):
        table |= {"flagged": flags.astype(int).tolist(), "bound": list(bounds)}
    simulated = any(person.simulated for person in people)
    return ReportFigure("fig11", "Detection thresholds and the new curve", caption, drawing, table, simulated)


_NAMED = 30
"""People who have a colour and a line of the legend each; of more, the legend would leave the axes no room."""


def _together(people: Sequence[PersonThresholds]) -> PersonThresholds:
    """Return the thresholds of many people as those of one."""
    hertz, level, error = (np.concatenate([getattr(person, name) for person in people]) for name in _KNOWN)
    flags = np.concatenate([np.zeros(p.frequency_hz.size, bool) if p.flagged is None else p.flagged for p in people])
    bounds = tuple(bound for person in people for bound in person.bound or [""] * person.frequency_hz.size)
    return PersonThresholds(f"{len(people)} people", hertz, level, error, flags, bounds)


_KNOWN = ("frequency_hz", "level_db_re_1um", "standard_error_db")


def _draw_new(axes: Axes, new: ThresholdCurve, others: Mapping[str, ThresholdCurve], fine: FloatArray) -> None:
    level = new.level_db_re_1um_at(fine)
    axes.plot(fine, level, color=BLUE, linestyle="--", linewidth=1.6, label="new curve")
    if new.standard_error_db is not None:
        error = np.interp(np.log(fine), np.log(new.frequency_hz), new.standard_error_db)
        axes.fill_between(fine, level - error, level + error, color=BLUE, alpha=0.15, linewidth=0)
    for name, other in others.items():
        axes.plot(fine, other.level_db_re_1um_at(fine), color=BLUE, linestyle=":", linewidth=1.6, label=name)


def _draw_person(axes: Axes, person: PersonThresholds, at: FloatArray, index: int) -> None:
    colour, marker = CYCLE[1 + index % (len(CYCLE) - 1)], _MARKERS[index % len(_MARKERS)]
    axes.errorbar(
        at, person.level_db_re_1um, np.nan_to_num(person.standard_error_db), fmt=marker, color=colour, markersize=4,
        fillstyle="none", elinewidth=0.8, label=person.name,
    )  # fmt: skip
    for sign, up in ((">=", True), ("<=", False)):
        beyond = np.array([bound == sign for bound in person.bound or [""] * at.size])
        level = person.level_db_re_1um[beyond]
        axes.errorbar(
            at[beyond],
            level,
            _ARROW_DB,
            fmt="none",
            color=colour,
            ecolor=colour,
            elinewidth=1.0,
            lolims=up,
            uplims=not up,
        )
    if person.flagged is not None and person.flagged.any():
        axes.plot(at[person.flagged], person.level_db_re_1um[person.flagged], "x", color=INK, markersize=9, zorder=5)


_ARROW_DB = 5.0


def _said_of(curve: ThresholdCurve) -> str:
    return "; ".join(filter(None, [f"{curve.provenance}: {curve.source}", curve.bounds_said]))


def threshold_figure(curve: ThresholdCurve) -> ReportFigure:
    """Draw the level of the threshold (dB re 1 um peak) against frequency, and the range up to comfort above it."""
    low, high = float(curve.frequency_hz[0]), float(curve.frequency_hz[-1])
    frequency = np.geomspace(low, high, 400)
    level = curve.level_db_re_1um_at(frequency)
    comfortable = (np.full(level.size, COMFORT_DB_SL), np.zeros(level.size))
    comfort = level + COMFORT_DB_SL
    curves = [
        ChartLine("threshold, 0 dB SL", frequency, level, colour=BLUE, width=1.8),
        ChartLine(f"comfort, {COMFORT_DB_SL:g} dB SL", frequency, comfort, "--", comfortable, colour=ORANGE),
        ChartLine("the curve's own points", curve.frequency_hz, curve.level_db_re_1um, "o", colour=BLUE),
    ]
    chart = Chart(FREQUENCY, "peak displacement (dB re 1 µm)", curves, True)
    caption = (
        f"Human detection threshold, curve “{curve.name}” ({_said_of(curve)}), and the range of "
        f"comfortable levels above it. Points: the curve's own; lines: linear in dB over log frequency."
    )
    table = {"frequency_hz": curve.frequency_hz.tolist(), "level_db_re_1um": curve.level_db_re_1um.tolist()}
    return ReportFigure("fig01", "Human detection threshold", caption, panels([[chart]], 3.6), table)


_COLUMNS = 3
_LARGEST, _SMALLEST = 9.0, 2.0


def psychometric_name(subject: str) -> str:
    """Return the name of the subject's figure."""
    return f"psychometric-{re.sub(_NOT_IN_FILES, '_', subject)}".encode()[:_LONGEST_NAME].decode(errors="ignore")


_NOT_IN_FILES, _LONGEST_NAME = r"[/\\\x00-\x1f\x7f]", 200
"""Characters of a study's name that no file's name has, and bytes that leave room for its ending."""


def psychometric_figure(subject: str, runs: Sequence[PsychometricTrials]) -> ReportFigure:
    """Draw a panel for each run: share correct against level (area: trials), fit, refitted threshold with its interval.

    Raises BadInput where there is no run.
    """
    if not runs:
        raise BadInput(f"no runs of {subject}", "one or more")
    rows = -(-len(runs) // _COLUMNS)
    drawing, grid = subplots(rows, min(_COLUMNS, len(runs)), height_in=1.1 + 1.8 * rows, squeeze=False, sharey=True)
    panels = list(grid.flat)
    for panel, run in zip(panels, runs, strict=False):
        _panel(panel, run)
    for spare in panels[len(runs) :]:
        spare.set_axis_off()
    labels = ("fit", _ANSWERS, "threshold, 95 %", "procedure's own")
    shown = {line.get_label(): line for panel in panels for line in panel.lines if line.get_label() in labels}
    drawing.legend(shown.values(), shown, loc="outside lower center", ncols=4, fontsize=7.5, frameon=False)
    for row in grid:
        row[0].set_ylabel("share correct", fontsize=8)
    for panel, run in list(zip(panels, runs, strict=False))[-_COLUMNS:]:
        panel.set_xlabel("level above the curve (dB)" if run.whole_curve else "level (dB SL)", fontsize=8)
    simulated = any(run.threshold.simulated for run in runs)
    who = f"{subject} (simulated: nobody felt this)" if simulated else subject
    caption = (
        f"Psychometric functions of {who}: share of right answers at each level (larger: more trials) and the Weibull "
        f"function of the refit; the bar is the threshold at {100.0 * runs[0].threshold.point:.1f} % correct with its "
        "95 % interval, the triangle the procedure's own number."
    )
    if any(run.whole_curve for run in runs):
        caption += (
            " Whole-curve runs: levels relative to the run's own curve at each trial's frequency, in classes of 2 dB; "
            "a threshold at 0 dB agrees with the curve."
        )
    rows_of_table = [
        row
        for run in runs
        for row in labelled(
            (run.threshold.run, run.threshold.finger, run.threshold.frequency_hz), run.level_db_sl, run.share, run.count
        )
    ]
    table = table_of(("run", "finger", "frequency_hz", "level_db_sl", "share_correct", "trials"), rows_of_table)
    return ReportFigure(
        psychometric_name(subject), f"Psychometric functions, {subject}", caption, drawing, table, simulated
    )


_ANSWERS = "answers (larger: more trials)"


def _panel(axes: Axes, run: PsychometricTrials) -> None:
    fit = run.threshold
    axes.plot(run.grid_db_sl, run.psi, color=BLUE, linewidth=1.2, label="fit")
    most = run.count.max()
    for level, share, count in zip(run.level_db_sl, run.share, run.count, strict=True):
        size = _SMALLEST + (_LARGEST - _SMALLEST) * (count / most) ** 0.5
        axes.plot(
            [level], [share], "o", color=INK, markersize=size, fillstyle="none", markeredgewidth=0.7, label=_ANSWERS
        )
    ends = np.clip([fit.refit_low_db_sl, fit.refit_high_db_sl], *axes.get_xlim())  # an open end leaves the panel
    axes.plot(ends, [fit.point] * 2, color=RED, linewidth=2.0, scalex=False, label="threshold, 95 %")
    axes.plot([fit.refit_db_sl], [fit.point], "|", color=RED, markersize=9)
    if fit.own_db_sl is not None:
        axes.plot([fit.own_db_sl], [fit.point - 0.05], "^", color=RED, markersize=4, label="procedure's own")
    bound = {"": "", ">=": " (≥)", "<=": " (≤)"}[fit.bound]
    flags = f"\n{', '.join(fit.flags)}" if fit.flags else ""
    where = "whole curve" if run.whole_curve else f"{fit.frequency_hz:.4g} Hz"
    axes.set_title(f"{fit.finger}, {where}{bound}{flags}", fontsize=7)
    axes.set_ylim(-0.03, 1.05)
    axes.tick_params(labelsize=7)


SHOWN_S = 30.0
LOWEST_DB_SL, HIGHEST_DB_SL = -10.0, 55.0
DIFFERENCE_DB = 3.0
_TICKS_HZ = (2, 5, 10, 20, 50, 100, 200)


def spectrogram_figure(report: FeltReport, what: str) -> ReportFigure:
    """Draw a row for each finger: third-octave levels asked, felt, and their difference where 10 dB SL or more was
    asked.

    The first 30 s are shown; the table holds the levels over the whole.
    """
    fingers = report.fingers
    drawing, grid = subplots(len(fingers), 3, 1.2 + 1.5 * len(fingers), sharex=True, sharey=True, squeeze=False)
    for row, finger in zip(grid, fingers, strict=True):
        levels, difference = _draw_finger(row, finger)
        row[0].set_ylabel(f"{finger.finger}\nfrequency (Hz)", fontsize=8)
    for axes, title in zip(grid[0], ("asked", "felt", "felt − asked"), strict=True):
        axes.set_title(title, fontsize=9)
    for axes in grid[-1]:
        axes.set_xlabel("time (s)", fontsize=9)
    bars = (
        (levels, grid[:, :2], 0.6, 40, "level in a third octave (dB SL)"),
        (difference, grid[:, 2], 0.9, 20, "difference (dB)"),
    )
    for scale, beside, shrink, aspect, words in bars:
        bar = drawing.colorbar(scale, ax=beside, location="bottom", shrink=shrink, aspect=aspect)
        bar.set_label(words, fontsize=8)
        bar.ax.tick_params(labelsize=8)
    caption = (
        f"{what}: levels in third-octave bands over {1e3 * LONG_FRAME_S:.0f} ms (to 40 Hz) and "
        f"{1e3 * SHORT_FRAME_S:.0f} ms (above), asked for and felt, and the difference where {HEARD_DB_SL:g} dB SL or "
        "more was asked for; white: less was asked for."
    )
    return ReportFigure("render", "Asked and felt over time", caption, drawing, _band_levels_table(report))


def _draw_finger(row: list[Axes], finger: FingerFelt) -> tuple[ScalarMappable, ScalarMappable]:
    split = finger.asked_long.shape[1]
    half = 10.0**0.05
    edges = np.append(finger.centre_hz / half, finger.centre_hz[-1] * half)
    parts = (
        (finger.asked_long, finger.felt_long, edges[: split + 1], LONG_FRAME_S),
        (finger.asked_short, finger.felt_short, edges[split:], SHORT_FRAME_S),
    )
    level_norm, difference_norm = Normalize(LOWEST_DB_SL, HIGHEST_DB_SL), Normalize(-DIFFERENCE_DB, DIFFERENCE_DB)
    levels, difference = ScalarMappable(level_norm, "magma_r"), ScalarMappable(difference_norm, "RdBu")
    for asked, felt, frequency, frame_s in parts:
        count = min(len(asked), round(SHOWN_S / frame_s))
        if not count:
            continue
        time = np.arange(count + 1) * frame_s
        for axes, values in ((row[0], asked), (row[1], felt)):
            shown = np.maximum(values[:count], LOWEST_DB_SL).T
            axes.pcolormesh(time, frequency, shown, norm=level_norm, cmap=levels.cmap, rasterized=True)
        counted = np.where(asked[:count] >= HEARD_DB_SL, felt[:count] - asked[:count], np.nan).T
        row[2].pcolormesh(time, frequency, counted, norm=difference_norm, cmap=difference.cmap, rasterized=True)
    for axes in row:
        axes.set_yscale("log")
        axes.set_ylim(edges[0], edges[-1])
        axes.set_yticks(_TICKS_HZ, [str(tick) for tick in _TICKS_HZ])
        axes.minorticks_off()
        axes.grid(False)
    return levels, difference


def _band_levels_table(report: FeltReport) -> dict[str, list[object]]:
    names = ("centre_hz", "asked_db_sl", "felt_db_sl")
    rows = (row for f in report.fingers for row in labelled((f.finger,), f.centre_hz, f.asked_db_sl, f.felt_db_sl))
    return table_of(("finger", *names), rows)
