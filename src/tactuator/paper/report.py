"""The report: report.html, the figures (every counterpart of the paper's, and a few that it has not), summary.json."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from dataclasses import replace
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template

import numpy as np

from tactuator import __version__
from tactuator.experiment.result.store_results import PersonThresholds
from tactuator.model.verdict import Finding, Objective
from tactuator.paper.run import PaperStudy
from tactuator.paper.steps import LOADED, UNLOADED, ResponsePoint, sampled_loop, worst_error_db
from tactuator.paper.summary import comparison, summary_text
from tactuator.paper.thresholds import bias_and_spread_db, expected_bias_db
from tactuator.perception.curve import COMFORT_DB_SL
from tactuator.report.configuration import loop_figure, mechanism_figure, processor_figure
from tactuator.report.design_figures import prefilter_figure, resolution_figure
from tactuator.report.device_figures import (
    LevelResponse,
    calibration_figure,
    motor_figure,
    noise_figure,
    response_figure,
)
from tactuator.report.felt_figures import equality_figure, felt_figure, threshold_figure, thresholds_figure
from tactuator.report.figure import ReportFigure
from tactuator.report.nichols import nichols_figure
from tactuator.speech.options import LEVEL_DB_SL
from tactuator.synthesis import paper


def report_page(study: PaperStudy, figures: Sequence[ReportFigure]) -> str:
    """Return the page, one HTML file with every figure in it."""
    template = Template(files("tactuator.paper").joinpath("report.html").read_text("utf-8"))
    words = {name: escape(f"{value}") for name, value in _words(study).items()}
    drawn = {figure.name.replace("-", "_"): _figure(figure) for figure in figures}
    objectives = [
        (objective.number, objective.outcome.value, objective.words, "; ".join(map(_worded, _worst(objective))))
        for objective in study.verdict.objectives
    ]
    file = study.spoken.file
    return template.substitute(
        words,
        **drawn,
        objectives=_table(("objective", "", "asks", "figures"), objectives),
        comparison=_table(("", "paper (2004)", "here"), comparison(study)),
        notes="".join(f"<p>{escape(f'{file.path.name}: {note}.')}</p>" for note in file.notes),
    )


def _words(study: PaperStudy) -> dict[str, object]:
    """Return what the page's sentences state, by the names of the template."""
    display, margins, judged, speech = study.plan.display, study.loop, study.prefilters, study.spoken
    curve = display.channels[0].threshold.curve
    lost = margins.continuous_margins.phase_margin_deg - margins.sampled_margins.phase_margin_deg
    slow = [one for one in study.responses if one.load == UNLOADED and one.frequency_hz <= 20.0]
    bias, spread = bias_and_spread_db(study.thresholds)
    return {
        "display": display.name,
        "rate_hz": f"{display.rate_hz:g}",
        "curve": curve.name,
        "provenance": curve.provenance,
        "seed": study.plan.seed,
        "comfort": f"{COMFORT_DB_SL:g}",
        "identified": f"{max(motor.frf_error_db_max for motor in study.motors.values()):.2f}",
        "lost": f"{lost:.1f}",
        "paper_error": f"{judged.paper.max_error_db:.1f}",
        "fitted_error": f"{judged.worst_fitted.max_error_db:.2f}",
        "friction": f"{-min(one.unpredicted_db for one in slow):.2f}",
        "loaded": f"{worst_error_db(study.responses, LOADED, 30.0):.1f}",
        "runs": len(study.thresholds),
        "bias": f"{bias:+.2f}",
        "spread": f"{spread:.2f}",
        "expected_bias": f"{expected_bias_db(study.plan):+.1f}",
        "reshaped_error": f"{study.reshaped.max_error_db:.2f}",
        "speech": speech.file.path.name,
        "duration": f"{speech.file.duration_s:.1f}",
        "level": f"{LEVEL_DB_SL:g}",
        "peak": f"{speech.report.peak_db_sl:.0f}",
        "rms": f"{speech.report.worst_rms_db:.2f}",
        "version": __version__,
    }


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return rows of cells under a header; a cell `met` or `not met` is coloured."""
    head = "".join(f"<th scope='col'>{escape(cell)}</th>" for cell in header)
    kinds = {"met": " class='met'", "not met": " class='not-met'"}
    cells = ("".join(f"<td{kinds.get(cell, '')}>{_with_code(cell)}</td>" for cell in row) for row in rows)
    body = "".join(f"<tr>{row}</tr>" for row in cells)
    return f"<div class='table'><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"


def _with_code(text: str) -> str:
    return re.sub("`([^`]+)`", r"<code>\1</code>", escape(text))


def _figure(figure: ReportFigure) -> str:
    picture = base64.b64encode(figure.svg().encode()).decode()
    number = figure.name.removeprefix("fig").lstrip("0")
    label = f"Figure {number}. " if number.isdigit() else ""
    return (
        f"<figure id='{escape(figure.name)}'><img alt='{escape(figure.title)}' "
        f"src='data:image/svg+xml;base64,{picture}'>"
        f"<figcaption><b>{label}{escape(figure.title)}.</b> {escape(figure.caption)}</figcaption></figure>"
    )


def _worst(objective: Objective) -> list[Finding]:
    worst: dict[str, Finding] = {}
    for finding in objective.worst():
        known = worst.get(finding.quantity)
        if known is None or finding.excess > known.excess:
            worst[finding.quantity] = finding
    return list(worst.values())


def _worded(finding: Finding) -> str:
    if finding.value is None:
        return f"{finding.quantity}: {finding.outcome}, {finding.remark}"
    unit = f" {finding.unit}" if finding.unit else ""
    at = "" if finding.frequency_hz is None else f" at {finding.frequency_hz:.3g} Hz"
    remark = f"; {finding.remark}" if finding.remark else ""
    value = f"{finding.quantity} {finding.figure}{at}, {finding.channel}"
    return f"{value} (allowed {finding.allowed:g}{unit}){remark}"


def figures(study: PaperStudy) -> tuple[ReportFigure, ...]:
    """Return the figures: fig01 to fig12 as in the paper, then noise, prefilter, resolution, reshaped response."""
    display, flatness_db = study.plan.display, study.plan.display.objectives.flatness_db
    first = display.channels[0]
    curve = first.threshold.curve
    band = np.geomspace(*first.threshold.band_hz, 400)
    motor = study.motors[first.name].estimate.model
    identified = replace(first, plant=motor)
    return (
        threshold_figure(curve),
        equality_figure(first, band, study.controller.response(first.name, band), name="fig02"),
        mechanism_figure(identified),
        motor_figure(
            study.open_loop.frequency_hz, study.open_loop.response[first.name], motor, display.rate_hz, first.name
        ),
        calibration_figure(study.calibration),
        loop_figure(first, paper.FEEDBACK, study.controller.channels[0].prefilter(display.rate_hz)),
        _nichols(study),
        processor_figure(study.controller),
        response_figure(_runs(study.responses, UNLOADED), "unloaded", "fig09", flatness_db),
        response_figure(_runs(study.responses, LOADED), "with a finger", "fig10", flatness_db),
        response_figure(_runs(study.default, UNLOADED), "the default, unloaded", "default", flatness_db),
        response_figure(_runs(study.default, LOADED), "the default, with a finger", "default-finger", flatness_db),
        _thresholds(study),
        felt_figure(study.spoken.report, study.spoken.file.path.name),
        noise_figure(
            {gain: levels.runs[0][1][0] for gain, levels in study.noise.proportional.items()},
            study.noise.designed.channels[0],
        ),
        _prefilters(study),
        resolution_figure(study.resolution),
        response_figure(
            _runs(study.reshaped.responses, UNLOADED), "prefilter reshaped to the new curve", "reshaped", flatness_db
        ),
    )


def _nichols(study: PaperStudy) -> ReportFigure:
    first = study.plan.display.channels[0]
    loops = (sampled_loop(study.plan.display, replace(first, plant=first.loaded_plant(load))) for load in first.loads)
    title = "Loop shaping in the Nichols chart"
    loop = study.loop
    return nichols_figure(loop.sampled, first.plant, loop.continuous, tuple(loops), name="fig07", title=title)


def _prefilters(study: PaperStudy) -> ReportFigure:
    judged = study.prefilters
    errors = {
        "the paper's F": (judged.paper.frequency_hz, judged.paper.error_db),
        "the paper's F, sampled": (judged.paper_sampled.frequency_hz, judged.paper_sampled.error_db),
        **{f"fitted, {name}": (fit.frequency_hz, fit.error_db) for name, fit in judged.fitted.items()},
    }
    return prefilter_figure(errors, study.plan.display.objectives.flatness_db)


def _runs(points: tuple[ResponsePoint, ...], load: str) -> list[LevelResponse]:
    keys = dict.fromkeys((point.channel, point.level_db_sl) for point in points if point.load == load)
    return [
        _run([point for point in points if (point.channel, point.level_db_sl, point.load) == (*key, load)])
        for key in keys
    ]


def _run(points: list[ResponsePoint]) -> LevelResponse:
    names = ("frequency_hz", "target_v", "expected_v", "measured_v", "ci_db", "saturated")
    columns = (np.array([getattr(point, name) for point in points]) for name in names)
    return LevelResponse(points[0].channel, points[0].level_db_sl, *columns)


def _thresholds(study: PaperStudy) -> ReportFigure:
    """Draw each observer's mean over the fingers, with the standard error of that mean."""
    people = []
    for name in dict.fromkeys(threshold.observer for threshold in study.thresholds):
        measured = [threshold for threshold in study.thresholds if threshold.observer == name]
        hertz = np.array(sorted({threshold.frequency_hz for threshold in measured}))
        levels = [[threshold.level_db_re_1um for threshold in measured if threshold.frequency_hz == f] for f in hertz]
        errors = [
            np.hypot.reduce([threshold.se_db for threshold in measured if threshold.frequency_hz == f]) for f in hertz
        ]
        counts = np.array([len(row) for row in levels])
        people.append(PersonThresholds(name, hertz, np.mean(levels, axis=1), np.array(errors) / counts, simulated=True))
    return thresholds_figure(people, study.plan.display.channels[0].threshold.curve, study.curve)


OWN_NAMES = frozenset({"report.html", "figures", "summary.json"})
"""Names of everything that the folder holds afterwards."""


def publish(study: PaperStudy, folder: Path) -> None:
    """Write everything into `folder`, which is there and empty."""
    drawn = figures(study)
    (folder / "figures").mkdir()
    for figure in drawn:
        figure.save(folder / "figures")
    (folder / "report.html").write_text(report_page(study, drawn), encoding="utf-8")
    (folder / "summary.json").write_text(summary_text(study), encoding="utf-8")
