"""The report: report.html, the figures (every counterpart of the paper's, and a few that it has not), summary.json."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path

import numpy as np

from tactuator import __version__
from tactuator.experiment.result.store_results import PersonThresholds
from tactuator.model.verdict import Finding, Objective
from tactuator.paper.run import PaperStudy
from tactuator.paper.steps import LOADED, UNLOADED, ResponsePoint, sampled_loop, worst_error_db
from tactuator.paper.summary import comparison, summary_text
from tactuator.paper.thresholds import bias_and_spread_db, expected_bias_db
from tactuator.perception.curve import COMFORT_DB_SL
from tactuator.report.configuration import loop_plate, mechanism_plate, processor_plate
from tactuator.report.controller import prefilter_plate, resolution_plate
from tactuator.report.device import LevelResponse, calibration_plate, motor_plate, noise_plate, response_plate
from tactuator.report.felt import equality_plate, felt_plate, threshold_plate, thresholds_plate
from tactuator.report.nichols import nichols_plate
from tactuator.report.plate import Plate
from tactuator.speech.options import LEVEL_DB_SL
from tactuator.synthesis import paper

_STYLE = """
:root { color-scheme: light; --ink: #222; --faint: #666; --line: #ddd; --blue: #0072b2; }
body { font: 16px/1.55 system-ui, sans-serif; color: var(--ink); background: #fff; margin: 0 auto; max-width: 52rem;
       padding: 1.5rem 1rem 4rem; }
h1 { font-size: 1.7rem; line-height: 1.2; } h2 { margin-top: 3rem; border-top: 1px solid var(--line);
     padding-top: 1rem; font-size: 1.25rem; }
nav ol { columns: 2; font-size: .92rem; } nav a, p a { color: var(--blue); }
figure { margin: 1.2rem 0; overflow-x: auto; } figure img { width: 100%; min-width: 34rem; height: auto; }
figcaption { color: var(--faint); font-size: .9rem; }
.table { overflow-x: auto; } table { border-collapse: collapse; font-size: .9rem; margin: .8rem 0; }
th, td { padding: .25rem .7rem; border-bottom: 1px solid var(--line); text-align: left; vertical-align: top;
         font-variant-numeric: tabular-nums; }
.met { color: #007a5a; font-weight: 600; } .not-met { color: #b03a00; font-weight: 600; }
footer { margin-top: 3rem; color: var(--faint); font-size: .85rem; }
@media (max-width: 40rem) { nav ol { columns: 1; } }
"""


@dataclass(frozen=True)
class Table:
    """Rows of cells under a header; a cell `met` or `not met` is coloured."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]

    def html(self) -> str:
        """Return the table as HTML."""
        head = "".join(f"<th scope='col'>{escape(cell)}</th>" for cell in self.header)
        kinds = {"met": " class='met'", "not met": " class='not-met'"}
        cells = ("".join(f"<td{kinds.get(cell, '')}>{_with_code(cell)}</td>" for cell in row) for row in self.rows)
        body = "".join(f"<tr>{row}</tr>" for row in cells)
        return f"<div class='table'><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"


@dataclass(frozen=True)
class Section:
    """A heading, paragraphs (plain text), tables and plates, in this order."""

    title: str
    paragraphs: Sequence[str] = ()
    tables: Sequence[Table] = ()
    plates: Sequence[Plate] = ()


def page(title: str, introduction: Sequence[str], sections: Sequence[Section], footer: str) -> str:
    """Return the page as one HTML file without links to anywhere else."""
    contents = "".join(
        f"<li><a href='#{_anchor(section.title)}'>{escape(section.title)}</a></li>" for section in sections
    )
    body = "".join(_section(section) for section in sections)
    lead = "".join(f"<p>{escape(text)}</p>" for text in introduction)
    return (
        "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body>"
        f"<header><h1>{escape(title)}</h1>{lead}</header><nav aria-label='Contents'><ol>{contents}</ol></nav>"
        f"<main>{body}</main><footer>{escape(footer)}</footer></body></html>\n"
    )


def _with_code(text: str) -> str:
    return re.sub("`([^`]+)`", r"<code>\1</code>", escape(text))


def _section(section: Section) -> str:
    parts = [f"<h2>{escape(section.title)}</h2>"]
    parts += [f"<p>{_with_code(text)}</p>" for text in section.paragraphs]
    parts += [table.html() for table in section.tables]
    parts += [_figure(plate) for plate in section.plates]
    return f"<section id='{_anchor(section.title)}'>{''.join(parts)}</section>"


def _figure(plate: Plate) -> str:
    picture = base64.b64encode(plate.svg().encode()).decode()
    number = plate.name.removeprefix("fig").lstrip("0")
    label = f"Figure {number}. " if number.isdigit() else ""
    return (
        f"<figure id='{escape(plate.name)}'><img alt='{escape(plate.title)}' "
        f"src='data:image/svg+xml;base64,{picture}'>"
        f"<figcaption><b>{label}{escape(plate.title)}.</b> {escape(plate.caption)}</figcaption></figure>"
    )


def _anchor(title: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")


def report_page(study: PaperStudy, plates: Sequence[Plate]) -> str:
    """Return the page, with every plate in it."""
    by_name = {plate.name: plate for plate in plates}
    sections = (
        _objectives(study),
        *_design_sections(study, by_name),
        *_measured_sections(study, by_name),
        *_person_sections(study, by_name),
    )
    curve = study.plan.display.channels[0].threshold.curve
    introduction = (
        "The study of IMECE2004-59874, “A two DOF controller for a multi-finger tactual display using a loop-shaping "
        "technique”, run from its first calibration to speech on three fingers, on a simulated display with friction, "
        "hum, noise and 16-bit converters.",
        f"Display: {study.plan.display.name}, {study.plan.display.rate_hz:g} Hz. Threshold curve: {curve.name} "
        f"({curve.provenance}). Seed: {study.plan.seed}; the same seed gives the same figures.",
    )
    return page("The paper, end to end", introduction, sections, f"tactuator {__version__}")


def _objectives(study: PaperStudy) -> Section:
    rows = [
        (objective.number, objective.outcome.value, objective.words, "; ".join(map(_worded, _worst(objective))))
        for objective in study.verdict.objectives
    ]
    return Section(
        "The four objectives, and paper against here",
        ("The paper asks four things of its display (section 2). Here is how this one answers, as measured.",),
        (Table(("objective", "", "asks", "figures"), rows), Table(("", "paper (2004)", "here"), comparison(study))),
    )


def _design_sections(study: PaperStudy, plates: dict[str, Plate]) -> tuple[Section, ...]:
    judged = study.prefilters
    lost = study.loop.continuous_margins.phase_margin_deg - study.loop.sampled_margins.phase_margin_deg
    return (
        Section(
            "The person: threshold and objective",
            (
                "A sinusoid at threshold is at 0 dB SL. A display whose response follows the threshold curve is felt "
                f"equally strongly at every frequency; up to {COMFORT_DB_SL:g} dB SL it is comfortable.",
            ),
            plates=_some(plates, "fig01", "fig02"),
        ),
        Section(
            "The motor: mechanism, identification, sensor",
            (
                "Each motor was driven for one minute with steps, noise and sinusoids; recursive least squares gave a "
                "second-order model. The sensor was calibrated against a dial gauge with an error of 0.01 mm.",
                "Against the simulated truth the identified responses err by at most "
                f"{max(motor.frf_error_db_max for motor in study.motors.values()):.2f} dB over 0.4-300 Hz. The "
                "controllers below are designed for the plants and gains of the display file, so that what "
                "identification missed is seen here and nowhere else.",
            ),
            plates=_some(plates, "fig03", "fig04", "fig05"),
        ),
        Section(
            "The loop and the prefilter",
            (
                f"C is the paper's own. Sampled, one period of computing delay takes {lost:.1f}° of its phase margin.",
                f"The paper's F misses the curve by up to {judged.paper.max_error_db:.1f} dB (at 300 Hz); a prefilter "
                f"of the same order, fitted here to H/T, by {judged.worst_fitted.max_error_db:.2f} dB.",
            ),
            plates=_some(plates, "fig06", "fig07", "prefilter"),
        ),
        Section(
            "The digital implementation",
            (
                "Plants are held (zero-order), C is transformed bilinearly, F is fitted on the sampled loop itself. "
                "The paper chose the lowest rate because coefficients need more resolution at higher ones; sections in "
                "delta form, which run here, hardly do.",
            ),
            plates=_some(plates, "fig08", "resolution"),
        ),
    )


def _measured_sections(study: PaperStudy, plates: dict[str, Plate]) -> tuple[Section, ...]:
    rubbed = min(
        point.unpredicted_db for point in study.responses if point.load == UNLOADED and point.frequency_hz <= 20.0
    )
    return (
        Section(
            "What a resting finger would feel",
            (
                "Hum and noise reach the sensor's own spectrum as S n and the fingertip as -T n, so they are judged "
                "from the command through the motor's model. As the proportional gain rises, hum and the loop's "
                "resonance rise, and the resonance moves up in frequency.",
            ),
            plates=_some(plates, "noise"),
        ),
        Section(
            "The response at 0 to 50 dB SL",
            (
                "Stepped sine with lock-in at 23 frequencies, on three channels, without and with a finger.",
                f"At 0 and 10 dB SL friction takes up to {-rubbed:.2f} dB of the slow motion; the same display without "
                "friction shows no such loss (summary.json, friction). Under the finger's load the response falls by "
                f"up to {worst_error_db(study.responses, LOADED, 30.0):.1f} dB, most of it above 20 Hz, where no "
                "feedback reaches.",
            ),
            plates=_some(plates, "fig09", "fig10"),
        ),
        Section(
            "The product's own default",
            (
                "The same display, designed as `init` proposes: a prefilter of eight poles, and what a finger takes "
                "fed forward. It costs 3 dB of the greatest reference and instructions on the board (docs/touch.md).",
            ),
            plates=_some(plates, "default", "default-finger"),
        ),
    )


def _person_sections(study: PaperStudy, plates: dict[str, Plate]) -> tuple[Section, ...]:
    bias, spread = bias_and_spread_db(study.thresholds)
    speech = study.spoken
    notes = tuple(f"{speech.file.path.name}: {note}." for note in speech.file.notes)
    return (
        Section(
            "Thresholds, and the new curve",
            (
                f"Three simulated observers, on three fingers each, by the paper's procedure: {len(study.thresholds)} "
                "runs, felt through the display. Estimate minus truth: "
                f"{bias:+.2f} dB on average, standard deviation {spread:.2f} dB. Of the procedure itself "
                f"{expected_bias_db(study.plan):+.1f} dB is expected, by runs of these observers without the display.",
                f"The prefilter reshaped to the new curve follows it within {study.reshaped.max_error_db:.2f} dB.",
            ),
            plates=_some(plates, "fig11", "reshaped"),
        ),
        Section(
            "Speech on three fingers",
            (
                f"{speech.file.path.name}, {speech.file.duration_s:.1f} s, band-limited to 300 Hz, at "
                f"{LEVEL_DB_SL:g} dB SL (peak {speech.report.peak_db_sl:.0f} dB SL): felt against asked, "
                f"{speech.report.worst_rms_db:.2f} dB rms over third-octave bands.",
                *notes,
            ),
            plates=_some(plates, "fig12"),
        ),
    )


def _some(plates: dict[str, Plate], *names: str) -> tuple[Plate, ...]:
    return tuple(plates[name] for name in names)


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


def plates(study: PaperStudy) -> tuple[Plate, ...]:
    """Return the plates: fig01 to fig12 as in the paper, then noise, prefilter, resolution, reshaped response."""
    display, flatness_db = study.plan.display, study.plan.display.objectives.flatness_db
    first = display.channels[0]
    curve = first.threshold.curve
    band = np.geomspace(*first.threshold.band_hz, 400)
    motor = study.motors[first.name].estimate.model
    identified = replace(first, plant=motor)
    return (
        threshold_plate(curve),
        equality_plate(first, band, study.controller.response(first.name, band), name="fig02"),
        mechanism_plate(identified),
        motor_plate(
            study.open_loop.frequency_hz, study.open_loop.response[first.name], motor, display.rate_hz, first.name
        ),
        calibration_plate(study.calibration),
        loop_plate(first, paper.FEEDBACK, study.controller.channels[0].prefilter(display.rate_hz)),
        _nichols(study),
        processor_plate(study.controller),
        response_plate(_runs(study.responses, UNLOADED), "unloaded", "fig09", flatness_db),
        response_plate(_runs(study.responses, LOADED), "with a finger", "fig10", flatness_db),
        response_plate(_runs(study.default, UNLOADED), "the default, unloaded", "default", flatness_db),
        response_plate(_runs(study.default, LOADED), "the default, with a finger", "default-finger", flatness_db),
        _thresholds(study),
        felt_plate(study.spoken.report, study.spoken.file.path.name),
        noise_plate(
            {gain: levels.runs[0][1][0] for gain, levels in study.noise.proportional.items()},
            study.noise.designed.channels[0],
        ),
        _prefilters(study),
        resolution_plate(study.resolution),
        response_plate(
            _runs(study.reshaped.responses, UNLOADED), "prefilter reshaped to the new curve", "reshaped", flatness_db
        ),
    )


def _nichols(study: PaperStudy) -> Plate:
    first = study.plan.display.channels[0]
    loops = (sampled_loop(study.plan.display, replace(first, plant=first.loaded_plant(load))) for load in first.loads)
    title = "Loop shaping in the Nichols chart"
    loop = study.loop
    return nichols_plate(loop.sampled, first.plant, loop.continuous, tuple(loops), name="fig07", title=title)


def _prefilters(study: PaperStudy) -> Plate:
    judged = study.prefilters
    errors = {
        "the paper's F": (judged.paper.frequency_hz, judged.paper.error_db),
        "the paper's F, sampled": (judged.paper_sampled.frequency_hz, judged.paper_sampled.error_db),
        **{f"fitted, {name}": (fit.frequency_hz, fit.error_db) for name, fit in judged.fitted.items()},
    }
    return prefilter_plate(errors, study.plan.display.objectives.flatness_db)


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


def _thresholds(study: PaperStudy) -> Plate:
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
    return thresholds_plate(people, study.plan.display.channels[0].threshold.curve, study.curve)


OWN_NAMES = frozenset({"report.html", "figures", "summary.json"})
"""Names of everything that the folder holds afterwards."""


def publish(study: PaperStudy, folder: Path) -> None:
    """Write everything into `folder`, which is there and empty."""
    drawn = plates(study)
    (folder / "figures").mkdir()
    for plate in drawn:
        plate.save(folder / "figures")
    (folder / "report.html").write_text(report_page(study, drawn), encoding="utf-8")
    (folder / "summary.json").write_text(summary_text(study), encoding="utf-8")
