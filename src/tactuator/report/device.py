"""Figures of a device: identification, calibration, motor, response and noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.calibration import Calibration
from tactuator.identification.result import Identification
from tactuator.measure.error import asked_v, expected_v
from tactuator.measure.noise import FeltNoise
from tactuator.model.controller import Controller
from tactuator.perception.curve import AMPLITUDE_JND_DB
from tactuator.report.chart import draw_curve, draw_levels
from tactuator.report.plate import (
    BLUE,
    CYCLE,
    FAINT,
    GREEN,
    INK,
    ORANGE,
    RED,
    Plate,
    figure,
    frequency_axis,
    labelled,
    legend,
    phase_deg,
    save_plates,
    table_of,
)
from tactuator.signals.decibels import db
from tactuator.signals.discretise import zero_order_hold
from tactuator.signals.record import Response
from tactuator.signals.spectra import power_spectrum
from tactuator.signals.systems import ContinuousSystem
from tactuator.table import Chart, ChartLine


def calibration_plate(calibrations: Mapping[str, Calibration]) -> Plate:
    """Draw pairs and lines of one or more channels above, residuals in millivolts below; refused pairs are crossed."""
    drawing, (upper, lower) = figure(2, 1, height_in=4.6, sharex=True, gridspec_kw={"height_ratios": (2.2, 1.0)})
    rows: list[tuple[object, ...]] = []
    for colour, (channel, fit) in zip(CYCLE, calibrations.items(), strict=False):
        ends = np.array([fit.displacement_mm.min(), fit.displacement_mm.max()])
        label = f"{channel}: {fit.gain_v_per_mm:.5f} ± {fit.gain_confidence_v_per_mm:.5f} V/mm"
        upper.plot(ends, fit.gain_v_per_mm * ends + fit.offset_v, color=colour, linewidth=1.0, label=label)
        upper.plot(fit.displacement_mm, fit.voltage_v, "o", color=colour, markersize=3.5, fillstyle="none")
        lower.plot(fit.displacement_mm, 1e3 * fit.residual_v, "o", color=colour, markersize=3.5, fillstyle="none")
        for refused in fit.refused:
            upper.plot(refused.displacement_mm, refused.voltage_v, "x", color=INK)
        rows += labelled((channel,), fit.displacement_mm, fit.voltage_v, fit.residual_v)
    upper.set_ylabel("sensor (V)", fontsize=9)
    lower.set_ylabel("residual (mV)", fontsize=9)
    lower.set_xlabel("displacement at the fingerpad interface (mm)", fontsize=9)
    lower.axhline(0.0, color=INK, linewidth=0.6)
    legend(upper, loc="upper left")
    worst = max(fit.linearity_percent for fit in calibrations.values())
    caption = (
        "Sensor voltage against displacement read with a dial gauge, least-squares line, gain with its 95 % "
        f"confidence; linear within {worst:.2f} % of the span."
    )
    table = table_of(("channel", "displacement_mm", "voltage_v", "residual_v"), rows)
    return Plate("fig05", "Calibration of sensor gain", caption, drawing, table)


def identification_plate(fit: Identification) -> Plate:
    """Draw magnitude and phase of the model with its 95 % band, over the record's own response; the band by itself
    below. Noise and distortion are drawn as the errors that they make of that response.
    """
    frequency = fit.frequency_hz()
    value, band = fit.model.response(frequency), fit.model.band_db(frequency)
    level = db(value)
    drawing, (top, middle, bottom) = figure(3, 1, height_in=6.4, sharex=True)
    seen_hz, seen, relative = fit.shown()
    error, label = np.abs(seen) * relative, "record's own in bands"
    of_bands = "its standard error, a slope within a band included"
    errors: list[tuple[FloatArray, str, str, str, float]] = [(error, of_bands, ORANGE, "-", 1.5)]
    if (lines := fit.distortion) is not None:
        label = "record's own lines"
        inside = np.isin(lines.frequency_hz, seen_hz)
        least = 0.1 * float(np.min(lines.noise[lines.noise > 0.0], initial=np.inf))
        parts = (
            (lines.noise[inside], "noise", ORANGE, "-"),
            (lines.total[inside], "noise and distortion", RED, "-"),
            (lines.odd[inside], "distortion, odd lines", RED, ":"),
            (lines.even[inside], "distortion, even lines", GREEN, ":"),
        )
        errors = [
            (np.where(part > least, part, np.nan) if np.isfinite(least) else part, label, colour, line, 1.2)
            for part, label, colour, line in parts
        ]
        errors = [part for part in errors if np.any(part[0] > 0.0)]
    top.plot(seen_hz, db(seen), ".", color=FAINT, label=label)
    top.plot(frequency, level, color=BLUE, label="model")
    top.fill_between(frequency, level - band, level + band, color=BLUE, alpha=0.25, linewidth=0.0, label="95 % band")
    for part, label, colour, line, width in errors:
        top.plot(seen_hz, 20.0 * np.log10(part), line, color=colour, linewidth=width, label=label)
    unit = f"{fit.model.position_unit or 'unit'}/{fit.model.command_unit or 'unit'}"
    frequency_axis(top, frequency[0], frequency[-1], f"magnitude (dB re 1 {unit})", label=False)
    legend(top, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)  # the lines leave no corner free
    beside = np.degrees(np.angle(seen / fit.model.response(seen_hz)))
    middle.plot(seen_hz, np.interp(seen_hz, frequency, phase_deg(value)) + beside, ".", color=FAINT)
    middle.plot(frequency, phase_deg(value), color=BLUE)
    frequency_axis(middle, frequency[0], frequency[-1], "phase (degrees)", label=False)
    bottom.plot(frequency, band, color=RED)
    bottom.set_ylim(0.0, 1.1 * float(np.max(band)))
    frequency_axis(bottom, frequency[0], frequency[-1], "half-width (dB)")
    names = ("frequency_hz", "magnitude_db", "phase_deg", "band_db")
    caption = (
        f"Model of {fit.order} poles and {fit.model.num.size - 1} zeros by the {fit.model.method} estimator, fit "
        f"{fit.fit_percent:.2f} %. Dots: the record's own response, without what the {fit.between.hold} hold of the "
        "command adds to it."
    )
    table = table_of(names, labelled((), frequency, level, phase_deg(value), band))
    return Plate("identification", "Identified response", caption, drawing, table)


def residual_plate(fit: Identification, rate_hz: float) -> Plate:
    """Draw the spectra of the position and of what the model leaves of it."""
    resolution = max(1.0, 8.0 * rate_hz / fit.measured.size)
    measured = power_spectrum(fit.measured, rate_hz, resolution)
    residual = power_spectrum(fit.measured - fit.simulated, rate_hz, resolution)
    drawing, axes = figure(1, 1, height_in=3.2)
    for spectrum, colour, label in ((measured, BLUE, "position"), (residual, ORANGE, "residual")):
        level = 10.0 * np.log10(spectrum.density[1:] + 1e-300)
        axes.plot(spectrum.frequency_hz[1:], level, color=colour, label=label)
    unit = fit.model.position_unit or "unit"
    frequency_axis(axes, float(measured.frequency_hz[1]), rate_hz / 2.0, f"density (dB re 1 {unit}²/Hz)")
    legend(axes, loc="upper right")
    white = "white" if fit.tests.white else "not white"
    free = "free of" if fit.tests.uncorrelated_with_input else "not free of"
    columns = measured.frequency_hz[1:], measured.density[1:], residual.density[1:]
    table = table_of(("frequency_hz", "position_density", "residual_density"), labelled((), *columns))
    return Plate("residual", "Residual", f"The innovations are {white} and {free} the command.", drawing, table)


def save_identification(fit: Identification, folder: Path) -> None:
    """Write the plates (SVG and CSV) into `folder`, whole or not at all."""
    rate = float(fit.model.record.get("rate_hz", 0.0) or 0.0)
    plates = [identification_plate(fit), *([residual_plate(fit, rate)] if rate > 0.0 else [])]
    save_plates([*plates, *([] if fit.path is None else [path_plate(fit, fit.path)])], folder)


def path_plate(fit: Identification, path: FloatArray) -> Plate:
    """Draw the path (blocks, k) that a recursion's parameters take along the record, each over its last value."""
    names = [f"b{k}" for k in reversed(range(fit.model.num.size))] + [f"a{k}" for k in reversed(range(fit.order))]
    time = np.arange(1.0, path.shape[0] + 1.0) * float(fit.model.record["duration_s"]) / path.shape[0]
    drawing, axes = figure(1, 1, height_in=2.8)
    for name, values, colour in zip(names, path.T, CYCLE, strict=False):
        axes.plot(time, values / values[-1], color=colour, label=name)
    axes.set_ylim(0.0, 2.0)
    axes.set_xlabel("time (s)", fontsize=9)
    axes.set_ylabel("parameter over its last value", fontsize=9)
    legend(axes, loc="upper right")
    caption = "Parameters of the recursion along the record: numerator b, denominator a (monic), by powers of s."
    table = table_of(("time_s", *names), np.column_stack([time, path]).tolist())
    return Plate("recursion", "Path of the recursion", caption, drawing, table)


def motor_plate(
    frequency_hz: FloatArray, measured: ComplexArray, continuous: ContinuousSystem, rate_hz: float, channel: str
) -> Plate:
    """Draw magnitude and phase of y/u: measured at frequency_hz (n,), and the model, continuous and sampled."""
    sampled = zero_order_hold(continuous, rate_hz)
    low, high = float(frequency_hz.min()), float(frequency_hz.max())
    fine = np.geomspace(low, high, 400)
    drawing, (upper, lower) = figure(2, 1, height_in=5.0, sharex=True)
    models = ((continuous, BLUE, "-", "continuous model"), (sampled, RED, "--", "sampled model (zero-order hold)"))
    for system, colour, line, label in models:
        response = system.response(fine)
        upper.plot(fine, db(response), color=colour, linestyle=line, label=label)
        lower.plot(fine, phase_deg(response), color=colour, linestyle=line)
    upper.plot(frequency_hz, db(measured), "o", color=INK, markersize=3.5, fillstyle="none", label="measured")
    lower.plot(frequency_hz, phase_deg(measured), "o", color=INK, markersize=3.5, fillstyle="none")
    frequency_axis(upper, low / 1.1, high * 1.1, "magnitude (dB)", label=False)
    frequency_axis(lower, low / 1.1, high * 1.1, "phase (degrees)")
    legend(upper, loc="lower left")
    levels = [db(measured), *(db(system.response(frequency_hz)) for system in (continuous, sampled))]
    caption = (
        f"Open-loop response of the {channel} motor, y over u, measured by stepped sine to {high:g} Hz, and the model "
        f"identified from one record. At low frequencies friction takes up to "
        f"{abs(float((levels[0] - levels[2]).min())):.2f} dB of the motion."
    )
    names = ("frequency_hz", "measured_db", "measured_deg", "continuous_db", "sampled_db")
    table = table_of(names, labelled((), frequency_hz, levels[0], phase_deg(measured), *levels[1:]))
    return Plate("fig04", "Open-loop response of the motor assembly", caption, drawing, table)


def noise_plate(proportional: Mapping[float, FeltNoise], designed: FeltNoise) -> Plate:
    """Draw one channel: third octaves (left), mains lines (right), by proportional gain and designed loop."""
    drawing, (bands, lines) = figure(1, 2, height_in=4.2, sharey=True)
    shades = colormaps["viridis"](np.linspace(0.0, 0.85, len(proportional)))
    curves: list[tuple[str, str, FeltNoise, object, float]] = [
        (f"gain {gain:g}", f"gain {gain:g}", heard, tuple(shade), 1.0)
        for shade, (gain, heard) in zip(shades, proportional.items(), strict=True)
    ]
    rows: list[tuple[object, ...]] = []
    for name, label, heard, colour, width in (*curves, ("designed", "designed loop", designed, RED, 2.0)):
        bands.plot(heard.band_hz, heard.band_db_sl, color=colour, linewidth=width, label=label)
        lines.plot(heard.line_hz, heard.line_db_sl, "o-", color=colour, linewidth=width, markersize=3)
        if heard.resonance_hz is not None and heard.resonance_db_sl is not None:
            bands.plot(heard.resonance_hz, heard.resonance_db_sl, "v", color=colour, markersize=6)
        rows += labelled((name, "line"), heard.line_hz, heard.line_db_sl)
        rows += labelled((name, "third octave"), heard.band_hz, heard.band_db_sl)
    low, high = float(designed.band_hz.min()), float(designed.band_hz.max())
    frequency_axis(bands, low / 1.2, high * 1.2, "felt level (dB SL)")
    lines.set_xlabel("frequency (Hz)", fontsize=9)
    lines.set_xticks(designed.line_hz)
    for axes, title in ((bands, "third octaves"), (lines, "mains lines")):
        axes.set_title(title, fontsize=9)
        axes.axhline(0.0, color=INK, linewidth=1.0)
    bands.annotate("threshold", (low, 0.0), (0, -10), textcoords="offset points", fontsize=7)
    drawing.legend(loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    caption = (
        f"Channel {designed.channel} at rest, judged from the command through the motor's model: under a proportional "
        f"controller of rising gain and under the designed loop, whose strongest line is felt at "
        f"{designed.worst_line_db_sl:.1f} dB SL and strongest third octave at {designed.band_db_sl.max():.1f} dB SL."
    )
    table = table_of(("controller", "kind", "frequency_hz", "level_db_sl"), rows)
    return Plate("noise", "Felt hum and noise", caption, drawing, table)


@dataclass(frozen=True, eq=False)
class LevelResponse:
    """One channel at one level: peak volts asked for, expected by the model and measured at frequency_hz (n,), the
    half-width ci_db, saturation.
    """

    channel: str
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
    display = controller.display
    runs = [
        LevelResponse(
            response.channel, response.level_db_sl, response.frequency_hz,
            asked_v(response, display),
            expected_v(response, controller), response.magnitude_v, response.confidence_db, response.saturated,
        )
        for response in responses
    ]  # fmt: skip
    load = responses[0].load
    words = "without load" if load == "none" else f"under the load {load!r}"
    save_plates([response_plate(runs, words, "response", display.objectives.flatness_db)], folder)


def response_plate(runs: Sequence[LevelResponse], condition: str, name: str, flatness_db: float) -> Plate:
    """Draw a panel for each channel: felt level (dB SL) against frequency over the levels asked for, below it felt less
    asked with its confidence, the tolerance flatness_db and the just-noticeable difference.
    """
    channels = list(dict.fromkeys(run.channel for run in runs))
    drawing, grid = figure(2, len(channels), 4.8, sharex=True, sharey="row", squeeze=False, height_ratios=(1.6, 1.0))
    for (upper, lower), channel in zip(grid.T, channels, strict=True):
        levels = [run for run in runs if run.channel == channel]
        _draw_response(upper, lower, levels, flatness_db)
        upper.set_title(channel, fontsize=9)
        low, high = float(levels[0].frequency_hz.min()), float(levels[0].frequency_hz.max())
        frequency_axis(upper, low / 1.2, high * 1.2, label=False)
        frequency_axis(lower, low / 1.2, high * 1.2)
        if len(channels) > 1:  # narrow panels are marked at decades only
            lower.set_xticks([1.0, 10.0, 100.0], ["1", "10", "100"])
    grid[0, 0].set_ylabel("felt level (dB SL)", fontsize=9)
    grid[1, 0].set_ylabel("felt minus asked (dB)", fontsize=9)
    marks = [
        Line2D([], [], color=INK, linewidth=0.8, label="asked"),
        Line2D([], [], color=BLUE, marker="o", markersize=4, fillstyle="none", linestyle="", label="measured, ± 95 %"),
        Line2D([], [], color=INK, marker="x", markersize=5, linestyle="", label="a limit was reached"),
        Line2D([], [], color=BLUE, linewidth=0.8, linestyle=":", label="expected by the model"),
        Line2D([], [], color=GREEN, linewidth=0.9, linestyle="--", label=f"tolerance ±{flatness_db:g} dB"),
        Patch(color=FAINT, alpha=0.3, linewidth=0.0, label=f"below a JND ({AMPLITUDE_JND_DB:g} dB)"),
    ]
    drawing.legend(handles=marks, fontsize=7, loc="outside lower center", ncols=3, frameon=False)
    clean = max(
        (float(np.max(np.abs(run.error_db[~run.saturated]), initial=0.0)) for run in runs if run.level_db_sl > 0),
        default=float("nan"),
    )
    caption = (
        f"Felt level at {', '.join(f'{level:g}' for level in sorted({run.level_db_sl for run in runs}))} dB SL, "
        f"{condition}: asked (lines) and measured by the sensor (circles). Below, felt minus asked with its "
        f"confidence, what of it the controller's own model expects, the tolerance, and the smallest "
        f"just-noticeable difference of amplitude ({AMPLITUDE_JND_DB:g} dB). Largest error above 0 dB SL, saturated "
        f"points left out: {clean:.2f} dB, {clean / AMPLITUDE_JND_DB:.1f} JND."
    )
    names = ("frequency_hz", "asked_v", "expected_v", "measured_v", "ci_db", "saturated")
    rows = [
        row for run in runs for row in labelled((run.channel, run.level_db_sl), *(getattr(run, name) for name in names))
    ]
    table = table_of(("channel", "level_db_sl", *names), rows)
    return Plate(name, f"Felt level against frequency, {condition}", caption, drawing, table)


def _draw_response(upper: Axes, lower: Axes, runs: Sequence[LevelResponse], flatness_db: float) -> None:
    runs = sorted(runs, key=lambda run: run.level_db_sl)
    levels = [run.level_db_sl for run in runs]
    upper.set_ylim(levels[0] - 8.0, levels[-1] + 8.0)
    draw_levels(upper, Chart("", "", (), targets=levels))
    draw_levels(lower, Chart("", "", (), targets=(0.0,), tolerance=flatness_db, jnd=AMPLITUDE_JND_DB))
    for number, run in enumerate(runs):
        hertz, cut = run.frequency_hz, run.saturated
        draw_curve(upper, ChartLine("", hertz, run.level_db_sl + run.error_db, "o", run.ci_db, cut, number))
        draw_curve(lower, ChartLine("", hertz, run.error_db, "o", run.ci_db, cut, number))
        lower.plot(hertz, run.model_db, color=CYCLE[number % len(CYCLE)], linewidth=0.8, linestyle=":")
