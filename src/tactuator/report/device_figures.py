"""Figures of a device: identification, calibration, motor, response and noise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.identification.calibration import Calibration
from tactuator.identification.result import Identification
from tactuator.measure.error import asked_v, expected_v
from tactuator.measure.noise import FeltNoise
from tactuator.model.controller import Controller
from tactuator.perception.curve import AMPLITUDE_JND_DB
from tactuator.report.chart import panels
from tactuator.report.figure import (
    BLUE,
    FAINT,
    GREEN,
    INK,
    ORANGE,
    RED,
    ReportFigure,
    labelled,
    phase_deg,
    save_figures,
    table_of,
)
from tactuator.result import FREQUENCY, Chart, ChartLine
from tactuator.signals.decibels import db
from tactuator.signals.discretise import discretise
from tactuator.signals.record import Record, Response
from tactuator.signals.spectra import power_spectrum


def calibration_figure(calibrations: Mapping[str, Calibration]) -> ReportFigure:
    """Draw pairs and lines of one or more channels above, residuals in millivolts below; refused pairs are crossed."""
    lines, pairs, residuals = [], [], []
    rows: list[tuple[object, ...]] = []
    for number, (channel, fit) in enumerate(calibrations.items()):
        ends = np.array([fit.displacement_mm.min(), fit.displacement_mm.max()])
        label = f"{channel}: {fit.gain_v_per_mm:.5f} ± {fit.gain_confidence_v_per_mm:.5f} V/mm"
        lines.append(ChartLine(label, ends, fit.gain_v_per_mm * ends + fit.offset_v, colour=number, width=1.0))
        pairs.append(ChartLine("", fit.displacement_mm, fit.voltage_v, "o", colour=number))
        residuals.append(ChartLine("", fit.displacement_mm, 1e3 * fit.residual_v, "o", colour=number))
        if fit.refused:
            refused = np.array([(pair.displacement_mm, pair.voltage_v) for pair in fit.refused]).T
            pairs.append(ChartLine("refused", refused[0], refused[1], "x", colour=INK))
        rows += labelled((channel,), fit.displacement_mm, fit.voltage_v, fit.residual_v)
    x_label = "displacement at the fingerpad interface (mm)"
    charts = [[Chart(x_label, "sensor (V)", [*lines, *pairs])], [Chart(x_label, "residual (mV)", residuals)]]
    worst = max(fit.linearity_percent for fit in calibrations.values())
    caption = (
        "Sensor voltage against displacement read with a dial gauge, least-squares line, gain with its 95 % "
        f"confidence; linear within {worst:.2f} % of the span."
    )
    table = table_of(("channel", "displacement_mm", "voltage_v", "residual_v"), rows)
    return ReportFigure("fig05", "Calibration of sensor gain", caption, panels(charts, 4.6, (2.2, 1.0)), table)


def identification_figure(fit: Identification) -> ReportFigure:
    """Draw magnitude and phase of the model with its 95 % band, over the record's own response; the band by itself
    below. Noise and distortion are drawn as the errors that they make of that response.
    """
    frequency = fit.frequency_hz()
    value, band = fit.model.response(frequency), fit.model.band_db(frequency)
    level, phase = db(value), phase_deg(value)
    seen_hz, seen, _ = fit.shown()
    beside = np.degrees(np.angle(seen / fit.model.response(seen_hz)))
    own = f"record's own {'in bands' if fit.distortion is None else 'lines'}"
    unit = f"{fit.model.position_unit or 'unit'}/{fit.model.command_unit or 'unit'}"
    magnitudes = [
        ChartLine(own, seen_hz, db(seen), ".", colour=FAINT),
        ChartLine("model, with its 95 % band", frequency, level, half=band, colour=BLUE),
        *(ChartLine(label, seen_hz, db(part), style, colour=colour) for label, part, style, colour in _errors(fit)),
    ]
    phases = [
        ChartLine("", seen_hz, np.interp(seen_hz, frequency, phase) + beside, ".", colour=FAINT),
        ChartLine("", frequency, phase, colour=BLUE),
    ]
    half_widths = [ChartLine("", frequency, band, colour=RED)]
    charts = [
        [Chart(FREQUENCY, f"magnitude (dB re 1 {unit})", magnitudes, log_x=True)],
        [Chart(FREQUENCY, "phase (degrees)", phases, log_x=True)],
        [Chart(FREQUENCY, "half-width (dB)", half_widths, log_x=True, y_range=(0.0, 1.1 * float(np.max(band))))],
    ]
    caption = (
        f"Model of {fit.order} poles and {fit.model.num.size - 1} zeros by the {fit.model.method} estimator, fit "
        f"{fit.fit_percent:.2f} %. Dots: the record's own response, without what the {fit.between.hold} hold of the "
        "command adds to it."
    )
    names = ("frequency_hz", "magnitude_db", "phase_deg", "band_db")
    table = table_of(names, labelled((), frequency, level, phase, band))
    return ReportFigure("identification", "Identified response", caption, panels(charts, 6.4), table)


def _errors(fit: Identification) -> list[tuple[str, FloatArray, str, str]]:
    """Return what may be wrong with the record's own response at its frequencies: words, size, style and colour."""
    seen_hz, seen, relative = fit.shown()
    if (lines := fit.distortion) is None:
        return [("its standard error, a slope within a band included", np.abs(seen) * relative, "-", ORANGE)]
    inside = np.isin(lines.frequency_hz, seen_hz)
    parts = [
        ("noise", lines.noise[inside], "-", ORANGE),
        ("noise and distortion", lines.total[inside], "-", RED),
        ("distortion, odd lines", lines.odd[inside], ":", RED),
        ("distortion, even lines", lines.even[inside], ":", GREEN),
    ]
    least = 0.1 * float(np.min(lines.noise[lines.noise > 0.0], initial=np.inf))
    if np.isfinite(least):  # what is far below the noise is nothing, and would take most of the axis
        parts = [(words, np.where(part > least, part, np.nan), style, colour) for words, part, style, colour in parts]
    return [part for part in parts if np.any(part[1] > 0.0)]


def residual_figure(fit: Identification, rate_hz: float) -> ReportFigure:
    """Draw the spectra of the position and of what the model leaves of it."""
    resolution = max(1.0, 8.0 * rate_hz / fit.measured.size)
    measured = power_spectrum(fit.measured, rate_hz, resolution)
    residual = power_spectrum(fit.measured - fit.simulated, rate_hz, resolution)
    curves = [
        ChartLine(label, spectrum.frequency_hz[1:], 10.0 * np.log10(spectrum.density[1:] + 1e-300), colour=colour)
        for spectrum, colour, label in ((measured, BLUE, "position"), (residual, ORANGE, "residual"))
    ]
    chart = Chart(FREQUENCY, f"density (dB re 1 {fit.model.position_unit or 'unit'}²/Hz)", curves, log_x=True)
    white = "white" if fit.tests.white else "not white"
    free = "free of" if fit.tests.uncorrelated_with_input else "not free of"
    columns = measured.frequency_hz[1:], measured.density[1:], residual.density[1:]
    table = table_of(("frequency_hz", "position_density", "residual_density"), labelled((), *columns))
    caption = f"The innovations are {white} and {free} the command."
    return ReportFigure("residual", "Residual", caption, panels([[chart]], 3.2), table)


def save_identification(fit: Identification, folder: Path) -> None:
    """Write the figures (SVG and CSV) into `folder`, whole or not at all."""
    rate = float(fit.model.record.get("rate_hz", 0.0) or 0.0)
    figures = [identification_figure(fit), *([residual_figure(fit, rate)] if rate > 0.0 else [])]
    save_figures([*figures, *([] if fit.path is None else [path_figure(fit, fit.path)])], folder)


def path_figure(fit: Identification, path: FloatArray) -> ReportFigure:
    """Draw the path (blocks, k) that a recursion's parameters take along the record, each over its last value."""
    names = [f"b{k}" for k in reversed(range(fit.model.num.size))] + [f"a{k}" for k in reversed(range(fit.order))]
    time = np.arange(1.0, path.shape[0] + 1.0) * float(fit.model.record["duration_s"]) / path.shape[0]
    curves = [ChartLine(name, time, values / values[-1]) for name, values in zip(names, path.T, strict=False)]
    chart = Chart("time (s)", "parameter over its last value", curves, y_range=(0.0, 2.0))
    caption = "Parameters of the recursion along the record: numerator b, denominator a (monic), by powers of s."
    table = table_of(("time_s", *names), np.column_stack([time, path]).tolist())
    return ReportFigure("recursion", "Path of the recursion", caption, panels([[chart]], 2.8), table)


def excitation_figure(record: Record, channel: str, shown_s: float = 10.0) -> ReportFigure:
    """Draw the first seconds of the command and of the position that a motor was identified from."""
    count = min(record.command.size, round(shown_s * record.rate_hz))
    step = max(1, round(record.rate_hz / 500.0))
    time = np.arange(0, count, step) / record.rate_hz
    command, position = record.command[:count:step], record.position[:count:step]
    charts = [
        [Chart("time (s)", "command (V)", [ChartLine("", time, command, colour=BLUE, width=0.5)])],
        [Chart("time (s)", "sensor (V)", [ChartLine("", time, position, colour=ORANGE, width=0.8)])],
    ]
    caption = (
        f"First {shown_s:g} of the {record.duration_s:g} s from which the {channel} motor was identified: a "
        "delimiter, then steps, noise and sinusoids. The paper does not say what its “delimiter” is; it is taken for a "
        "pulse to either side that marks where the record begins and ends."
    )
    table = table_of(("time_s", "command_v", "position_v"), labelled((), time, command, position))
    return ReportFigure("excitation", "Excitation of the motor", caption, panels(charts, 3.6), table)


def motor_figure(fit: Identification, channel: str, rate_hz: float) -> ReportFigure:
    """Draw magnitude and phase of y/u as the record shows it, and of the model, continuous and sampled."""
    frequency, measured, _ = fit.shown()
    continuous = fit.model.system
    sampled = discretise(continuous, rate_hz, "zoh")
    fine = np.geomspace(float(frequency.min()), float(frequency.max()), 400)
    models = ((continuous, BLUE, "-", "continuous model"), (sampled, RED, "--", "sampled model (zero-order hold)"))
    upper, lower = [], []
    for system, colour, style, label in models:
        response = system.response(fine)
        upper.append(ChartLine(label, fine, db(response), style, colour=colour))
        lower.append(ChartLine("", fine, phase_deg(response), style, colour=colour))
    upper.append(ChartLine("measured", frequency, db(measured), ".", colour=INK))
    lower.append(ChartLine("", frequency, phase_deg(measured), ".", colour=INK))
    charts = [[Chart(FREQUENCY, "magnitude (dB)", upper, True)], [Chart(FREQUENCY, "phase (degrees)", lower, True)]]
    caption = (
        f"Open-loop response of the {channel} motor, y over u: the record's own in bands, without what the hold of the "
        "command adds, and the model identified from the same record, which the controller is designed for."
    )
    columns = (db(measured), phase_deg(measured), *(db(system.response(frequency)) for system in (continuous, sampled)))
    names = ("frequency_hz", "measured_db", "measured_deg", "continuous_db", "sampled_db")
    table = table_of(names, labelled((), frequency, *columns))
    return ReportFigure("fig04", "Open-loop response of the motor assembly", caption, panels(charts, 5.0), table)


def noise_figure(probed: Mapping[str, FeltNoise], designed: FeltNoise) -> ReportFigure:
    """Draw one channel: third octaves (left), mains lines (right), under each probing controller and the designed."""
    shades = colormaps["viridis"](np.linspace(0.0, 0.85, len(probed)))
    by_source: list[tuple[str, str, FeltNoise, Any, float]] = [
        (name, name, noise, tuple(shade), 1.0) for shade, (name, noise) in zip(shades, probed.items(), strict=True)
    ]
    bands, lines = [], []
    rows: list[tuple[object, ...]] = []
    for name, label, noise, colour, width in (*by_source, ("designed", "designed loop", designed, RED, 2.0)):
        bands.append(ChartLine(label, noise.band_hz, noise.band_db_sl, colour=colour, width=width))
        lines.append(ChartLine("", noise.line_hz, noise.line_db_sl, "o-", colour=colour, width=width))
        if noise.resonance_hz is not None and noise.resonance_db_sl is not None:
            resonance = ([noise.resonance_hz], [noise.resonance_db_sl])
            bands.append(ChartLine("", resonance[0], resonance[1], "v", colour=colour))
        rows += labelled((name, "line"), noise.line_hz, noise.line_db_sl)
        rows += labelled((name, "third octave"), noise.band_hz, noise.band_db_sl)
    of: dict[str, Any] = {"limits": {"threshold": 0.0}}
    charts = [
        Chart(FREQUENCY, "felt level (dB SL)", bands, log_x=True, title="third octaves", **of),
        Chart(FREQUENCY, "felt level (dB SL)", lines, title="mains lines", **of),
    ]
    caption = (
        f"Channel {designed.channel} at rest, judged from the command through the motor's model: under a proportional "
        f"controller of rising gain and under the designed loop, whose strongest line is felt at "
        f"{designed.worst_line_db_sl:.1f} dB SL and strongest third octave at {designed.band_db_sl.max():.1f} dB SL."
    )
    table = table_of(("controller", "kind", "frequency_hz", "level_db_sl"), rows)
    return ReportFigure("noise", "Felt hum and noise", caption, panels([charts], 4.2), table)


@dataclass(frozen=True, eq=False)
class LevelResponse:
    """One channel under one load at one level: peak volts asked for, expected by the model and measured at
    frequency_hz (n,), the half-width ci_db, saturation.
    """

    channel: str
    load: str
    level_db_sl: float
    frequency_hz: FloatArray
    asked_v: FloatArray
    expected_v: FloatArray
    measured_v: FloatArray
    ci_db: FloatArray
    saturated: NDArray[np.bool_]

    @property
    def error_db(self) -> FloatArray:
        """Return the level felt minus the level asked, dB."""
        return db(self.measured_v / self.asked_v)

    @property
    def model_db(self) -> FloatArray:
        """Return the error that the model expects, dB."""
        return db(self.expected_v / self.asked_v)


def save_measured(responses: Sequence[Response], controller: Controller, folder: Path) -> None:
    """Write the figure of measured responses (SVG, with its numbers as CSV) into `folder`, whole or not at all.

    Raises BadInput for a folder that holds anything else.
    """
    runs = level_responses(responses, controller)
    load = responses[0].load
    words = "without load" if load == "none" else f"under the load {load!r}"
    save_figures([response_figure(runs, words, "response", controller.display.objectives.flatness_db)], folder)


def level_responses(responses: Sequence[Response], controller: Controller) -> list[LevelResponse]:
    """Return measured responses beside what was asked for and what the controller's model expects under their load."""
    return [
        LevelResponse(
            response.channel, response.load, response.level_db_sl, response.frequency_hz,
            asked_v(response, controller.display), expected_v(response, controller), response.magnitude_v,
            response.confidence_db, response.saturated,
        )
        for response in responses
    ]  # fmt: skip


def response_figure(runs: Sequence[LevelResponse], condition: str, name: str, flatness_db: float) -> ReportFigure:
    """Draw a row for each channel: the sensor's output against frequency with what was asked for, and beside it felt
    less asked with its confidence, the tolerance flatness_db and the just-noticeable difference.
    """
    rows = []
    for channel in dict.fromkeys(run.channel for run in runs):
        own = sorted((run for run in runs if run.channel == channel), key=lambda run: run.level_db_sl)
        asked = [ChartLine("asked", run.frequency_hz, run.asked_v, colour=INK, width=0.8) for run in own]
        volts = [line for number, run in enumerate(own) for line in _measured(run, run.measured_v, number)]
        errors = [line for number, run in enumerate(own) for line in _measured(run, run.error_db, number, run.ci_db)]
        errors += [
            ChartLine("expected by the model", run.frequency_hz, run.model_db, ":", colour=number, width=0.8)
            for number, run in enumerate(own)
        ]
        held_against: dict[str, Any] = {"tolerance": flatness_db, "jnd": AMPLITUDE_JND_DB}
        pair = (
            Chart(FREQUENCY, "sensor output (V)", [*asked, *volts], True, log_y=True, title=channel),
            Chart(FREQUENCY, "level error (dB)", errors, True, (0.0,), title=channel, **held_against),
        )
        rows.append(pair)
    clean = max(
        (float(np.max(np.abs(run.error_db[~run.saturated]), initial=0.0)) for run in runs if run.level_db_sl > 0),
        default=float("nan"),
    )
    caption = (
        f"Sensor output at {', '.join(f'{level:g}' for level in sorted({run.level_db_sl for run in runs}))} dB SL, "
        f"{condition}: asked (lines) and measured (circles). Right: level error (felt − requested) with its "
        f"confidence, what of it the controller's own model expects, the tolerance, and the smallest "
        f"just-noticeable difference of amplitude ({AMPLITUDE_JND_DB:g} dB). Largest error above 0 dB SL, saturated "
        f"points left out: {clean:.2f} dB, {clean / AMPLITUDE_JND_DB:.1f} JND."
    )
    names = ("frequency_hz", "asked_v", "expected_v", "measured_v", "ci_db", "saturated")
    cells = (
        row for run in runs for row in labelled((run.channel, run.level_db_sl), *(getattr(run, name) for name in names))
    )
    table = table_of(("channel", "level_db_sl", *names), cells)
    drawing = panels(rows, 1.2 + 2.1 * len(rows))
    return ReportFigure(name, f"Response, {condition}", caption, drawing, table)


def _measured(run: LevelResponse, y: FloatArray, number: int, half: FloatArray | None = None) -> Iterator[ChartLine]:
    """Yield the points of a run, and those at which a limit was reached."""
    cut, hertz = run.saturated, run.frequency_hz
    bars = None if half is None else half[~cut]
    yield ChartLine("measured, ± 95 %", hertz[~cut], y[~cut], "o", bars, colour=number, width=0.0)
    if cut.any():
        yield ChartLine("a limit was reached", hertz[cut], y[cut], "x", colour=INK)
