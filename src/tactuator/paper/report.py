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
from typing import Any

import numpy as np

from tactuator import __version__
from tactuator.paper.measured import LOADED, UNLOADED, of, worst_error_db
from tactuator.paper.people import errors_db, expected_bias_db, over_fingers, standard_error_db
from tactuator.paper.printed import CHANNEL
from tactuator.paper.study import PaperStudy
from tactuator.paper.summary import HEADS, comparison, printed_error_db, summary_text
from tactuator.perception.curve import COMFORT_DB_SL
from tactuator.report.configuration import loop_figure, mechanism_figure, processor_figure
from tactuator.report.design_figures import loop_shape_figure, prefilter_figure, resolution_figure
from tactuator.report.device_figures import (
    LevelResponse,
    calibration_figure,
    excitation_figure,
    motor_figure,
    noise_figure,
    response_figure,
)
from tactuator.report.felt_figures import (
    equality_figure,
    felt_figure,
    spectrogram_figure,
    threshold_figure,
    thresholds_figure,
)
from tactuator.report.figure import ReportFigure, save_figures


def report_page(study: PaperStudy, figures: Sequence[ReportFigure]) -> str:
    """Return the page, one HTML file with every figure in it."""
    template = Template(files("tactuator.paper").joinpath("report.html").read_text("utf-8"))
    words = {name: escape(f"{value}") for name, value in _words(study).items()}
    drawn = {figure.name.replace("-", "_"): _figure(figure) for figure in figures}
    speech = study.spoken[0].result
    return template.substitute(
        words,
        **drawn,
        comparison=_table(HEADS, comparison(study)),
        notes="".join(f"<p>{escape(f'{speech.source.name}: {note}.')}</p>" for note in speech.notices()),
    )


def _words(study: PaperStudy) -> dict[str, object]:
    """Return what the page's sentences state, by the names of the template."""
    display, first = study.lab.display, study.spoken[0]
    curve = display.channels[0].threshold.curve
    slow = [run.error_db - run.model_db for run in of(study.responses, UNLOADED, 0.0)]
    errors = errors_db(study.detected.thresholds)
    return {
        "display": display.name,
        "rate_hz": f"{display.rate_hz:g}",
        "curve": curve.name,
        "provenance": curve.provenance,
        "seed": study.plan.seed,
        "comfort": f"{COMFORT_DB_SL:g}",
        "identified": f"{max(study.truth.motor_error_db.values()):.2g}",
        "design_error": f"{study.truth.design_error_db:.2f}",
        "paper_error": f"{np.max(np.abs(printed_error_db(study)[1])):.1f}",
        "friction": f"{-min(float(np.min(part)) for part in slow):.2f}",
        "printed_loaded": f"{worst_error_db(study.printed_responses, LOADED, 30.0):.1f}",
        "runs": len(study.detected.thresholds),
        "bias": f"{errors.mean():+.2f}",
        "spread": f"{errors.std(ddof=1):.2f}",
        "expected_bias": f"{expected_bias_db(study.plan):+.1f}",
        "reshaped_error": f"{study.reshaped_error_db:.2f}",
        "speech": first.result.source.name,
        "duration": f"{first.result.rendered.duration_s:.1f}",
        "peak": f"{first.report.peak_db_sl:.0f}",
        "frames": _frames(first.report),
        "limited": f"{max(finger.max_reduction_db for finger in first.result.rendered.limiting):.1f}",
        "version": __version__,
    }


def _frames(report: Any) -> str:
    """Return the rms of the worst finger's frames in words."""
    frames = report.figures().values()
    median, most = (max(each[f"{share}_db_all"] for each in frames) for share in ("median", "p95"))
    return f"{median:.2f} dB rms in the median and {most:.2f} dB in the 95th percentile"


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


def figures(study: PaperStudy) -> tuple[ReportFigure, ...]:
    """Return the figures: fig01 to fig12 as in the paper, and those that the paper has not."""
    lab, controller, display = study.lab, study.lab.controller, study.lab.display
    flatness_db, first = display.objectives.flatness_db, display.channels[0]
    curve, name = first.threshold.curve, first.name
    band = np.geomspace(*first.threshold.band_hz, 400)
    first_spoken = study.spoken[0]
    probed = {gain: felt[0] for gain, felt in lab.noise.runs[:-1]}

    def responses(runs: Sequence[LevelResponse], condition: str, name: str) -> ReportFigure:
        return response_figure(runs, condition, name, flatness_db)

    def under(load: str) -> list[LevelResponse]:
        return [run for run in study.responses if run.load == load]

    def printed(load: str) -> list[LevelResponse]:
        return [run for run in study.printed_responses if run.load == load]

    errors = {
        "the paper's F": printed_error_db(study),
        "ours": (band, 20.0 * np.log10(np.abs(controller.response(name, band)) / first.prefilter_voltage(band))),
    }
    return (
        threshold_figure(curve),
        equality_figure(first, band, controller.response(name, band), name="fig02"),
        mechanism_figure(first),
        excitation_figure(lab.records[name], name),
        motor_figure(lab.motors[name], name, display.rate_hz),
        calibration_figure(lab.calibrations),
        loop_figure(controller, name),
        loop_shape_figure(controller, name, "fig07", "Loop shaping in the Nichols chart"),
        loop_shape_figure(study.printed, CHANNEL, "printed-loop", "The paper's printed C in the Nichols chart"),
        processor_figure(controller),
        responses(under(UNLOADED), "unloaded", "fig09"),
        responses(under(LOADED), "with a finger", "fig10"),
        responses(printed(UNLOADED), "the paper's printed F and C, unloaded", "printed"),
        responses(printed(LOADED), "the paper's printed F and C, with a finger", "printed-finger"),
        _thresholds(study),
        *(
            felt_figure(spoken.report, f"{spoken.result.source.name}, coding {spoken.coding}", figure)
            for spoken, figure in zip(study.spoken, ("fig12", "speech-bands"), strict=True)
        ),
        replace(spectrogram_figure(first_spoken.report, first_spoken.result.source.name), name="speech-time"),
        noise_figure(probed, lab.noise.channels[0]),
        prefilter_figure(errors, flatness_db),
        resolution_figure(study.resolution.bits),
        responses(study.reshaped_responses, "prefilter reshaped to the new curve", "reshaped"),
    )


def _thresholds(study: PaperStudy) -> ReportFigure:
    """Draw each subject's mean over the fingers, with the standard error of that mean."""
    known = study.detected.thresholds
    error_db, means = standard_error_db(known), over_fingers(known)
    people = [
        replace(
            person, frequency_hz=means[person.name][:, 0], level_db_re_1um=means[person.name][:, 1], flagged=None,
            standard_error_db=np.full(len(means[person.name]), error_db), bound=None,
        )
        for person in study.detected.people
    ]  # fmt: skip
    figure = thresholds_figure(people, study.lab.display.channels[0].threshold.curve, study.detected.curve)
    fingers = len({each.finger for each in known})
    caption = (
        f"{figure.caption} A point: the mean over {fingers} fingers of one run each (the mean of 12 reversals), "
        f"{len(known)} runs in all; bars: its standard error of {error_db:.2f} dB, from the scatter over the fingers, "
        "pooled over all points."
    )
    return replace(figure, caption=caption)


OWN_NAMES = frozenset({"report.html", "figures", "summary.json", "files"})
"""Names of everything that the folder holds afterwards."""


def publish(study: PaperStudy, folder: Path) -> None:
    """Write page, figures and summary into `folder`, in which the study's files are."""
    drawn = figures(study)
    save_figures(drawn, folder / "figures")
    (folder / "report.html").write_text(report_page(study, drawn), encoding="utf-8")
    (folder / "summary.json").write_text(summary_text(study), encoding="utf-8")
