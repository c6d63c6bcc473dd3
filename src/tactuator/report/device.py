"""Figures of a device: identification, calibration, motor, response and noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.calibration import Calibration
from tactuator.identification.result import Identification
from tactuator.io.atomic import atomic_folder
from tactuator.measure.error import expected_v
from tactuator.measure.noise import FeltNoise
from tactuator.model.controller import Controller
from tactuator.report.plate import Plate, save_plates
from tactuator.report.style import BLUE, CYCLE, FAINT, GREEN, INK, ORANGE, RED, dress, figure, frequency_axis, legend
from tactuator.signals.decibels import db
from tactuator.signals.record import Response
from tactuator.signals.spectra import power_spectrum
from tactuator.signals.systems import ContinuousSystem, SampledSystem


def calibration_plate(found: Mapping[str, Calibration], name: str = "fig05") -> Plate:
    """Draw pairs and lines of one or more channels above, residuals in millivolts below; refused pairs are crossed."""
    made, (upper, lower) = figure(2, 1, height_in=4.6, sharex=True, gridspec_kw={"height_ratios": (2.2, 1.0)})
    table: dict[str, list[object]] = {"channel": [], "displacement_mm": [], "voltage_v": [], "residual_v": []}
    for colour, (channel, one) in zip(CYCLE, found.items(), strict=False):
        ends = np.array([one.displacement_mm.min(), one.displacement_mm.max()])
        label = f"{channel}: {one.gain_v_per_mm:.5f} ± {one.gain_confidence_v_per_mm:.5f} V/mm"
        upper.plot(ends, one.gain_v_per_mm * ends + one.offset_v, color=colour, linewidth=1.0, label=label)
        upper.plot(one.displacement_mm, one.voltage_v, "o", color=colour, markersize=3.5, fillstyle="none")
        lower.plot(one.displacement_mm, 1e3 * one.residual_v, "o", color=colour, markersize=3.5, fillstyle="none")
        for refused in one.refused:
            upper.plot(refused.displacement_mm, refused.voltage_v, "x", color=INK)
        columns = (one.displacement_mm, one.voltage_v, one.residual_v)
        for row in zip(*(column.tolist() for column in columns), strict=True):
            for cells, cell in zip(table.values(), (channel, *row), strict=True):
                cells.append(cell)
    upper.set_ylabel("sensor (V)", fontsize=9)
    lower.set_ylabel("residual (mV)", fontsize=9)
    lower.set_xlabel("displacement at the fingerpad interface (mm)", fontsize=9)
    lower.axhline(0.0, color=INK, linewidth=0.6)
    legend(upper, loc="upper left")
    worst = max(one.linearity_percent for one in found.values())
    caption = (
        "Sensor voltage against displacement read with a dial gauge, least-squares line, gain with its 95 % "
        f"confidence; linear within {worst:.2f} % of the span."
    )
    return Plate(name, "Calibration of sensor gain", caption, made, table)


_OWN_NAMES = frozenset(f"{name}.{ending}" for name in ("identification", "residual") for ending in ("svg", "csv"))


def identification_plate(found: Identification) -> Plate:
    """Draw magnitude and phase of the model with its 95 % band, over the record's own response; the band by itself
    below.
    """
    frequency = found.frequency_hz()
    value, band = found.model.response(frequency), found.model.band_db(frequency)
    level = 20.0 * np.log10(np.abs(value))
    made, (top, middle, bottom) = figure(3, 1, height_in=6.4, sharex=True)
    shown = found.empirical.trusted()
    inside = (shown.frequency_hz >= frequency[0]) & (shown.frequency_hz <= frequency[-1])
    own_hz, own, label = shown.frequency_hz[inside], shown.value[inside], "record's own in bands, hold included"
    if found.distortion is not None:
        own_hz, own, label = found.distortion.frequency_hz, found.distortion.value, "record's own lines, hold included"
    top.plot(own_hz, 20.0 * np.log10(np.abs(own)), ".", color=FAINT, label=label)
    top.plot(frequency, level, color=BLUE, label="model")
    top.fill_between(frequency, level - band, level + band, color=BLUE, alpha=0.25, linewidth=0.0, label="95 % band")
    _draw_levels(top, found, frequency)
    top.set_ylabel(f"magnitude (dB {_ratio(found)})", fontsize=9)
    legend(top, loc="lower left")
    middle.plot(own_hz, np.degrees(np.unwrap(np.angle(own))), ".", color=FAINT)
    middle.plot(frequency, np.degrees(np.unwrap(np.angle(value))), color=BLUE)
    middle.set_ylabel("phase (degrees)", fontsize=9)
    bottom.plot(frequency, band, color=RED)
    bottom.set_ylabel("half-width (dB)", fontsize=9)
    for axes in (top, middle):
        frequency_axis(axes, frequency[0], frequency[-1], label=False)
    frequency_axis(bottom, frequency[0], frequency[-1])
    columns = {
        "frequency_hz": frequency.tolist(),
        "magnitude_db": level.tolist(),
        "phase_deg": np.degrees(np.unwrap(np.angle(value))).tolist(),
        "band_db": band.tolist(),
    }
    caption = (
        f"Model of {found.order} poles and {found.model.num.size - 1} zeros by the {found.model.method} estimator, "
        f"command {found.between.hold}, "
        f"fit {found.fit_percent:.2f} %."
    )
    return Plate("identification", "Identified response", caption, made, columns)


def _draw_levels(axes: Axes, found: Identification, frequency: FloatArray) -> None:
    """Draw noise and distortion as the errors that they make of the record's own response."""
    seen = found.distortion
    if seen is None:
        shown = found.empirical.trusted()
        inside = (shown.frequency_hz >= frequency[0]) & (shown.frequency_hz <= frequency[-1])
        error = (np.abs(shown.value) * shown.relative_error)[inside]
        axes.plot(
            shown.frequency_hz[inside], 20.0 * np.log10(error), color=ORANGE, label="noise and distortion in bands"
        )
        return
    levels = (
        (seen.noise, "noise", ORANGE, "-"),
        (seen.total, "noise and distortion", RED, "-"),
        (seen.odd, "distortion, odd lines", RED, ":"),
        (seen.even, "distortion, even lines", GREEN, ":"),
    )
    lowest = 0.1 * float(np.min(seen.noise[seen.noise > 0.0], initial=np.inf))
    for level, label, color, line in levels:
        drawn = np.where(level > lowest, level, np.nan) if np.isfinite(lowest) else level
        if np.any(drawn > 0.0):
            axes.plot(seen.frequency_hz, 20.0 * np.log10(drawn), line, color=color, linewidth=1.2, label=label)


def residual_plate(found: Identification, rate_hz: float) -> Plate:
    """Draw the spectra of the position and of what the model leaves of it."""
    resolution = max(1.0, 8.0 * rate_hz / found.measured.size)
    measured = power_spectrum(found.measured, rate_hz, resolution)
    left = power_spectrum(found.measured - found.simulated, rate_hz, resolution)
    made, axes = figure(1, 1, height_in=3.2)
    shown = slice(1, None)
    axes.plot(
        measured.frequency_hz[shown], 10.0 * np.log10(measured.density[shown] + 1e-300), color=BLUE, label="position"
    )
    axes.plot(left.frequency_hz[shown], 10.0 * np.log10(left.density[shown] + 1e-300), color=ORANGE, label="residual")
    unit = found.model.position_unit or "unit"
    axes.set_ylabel(f"density (dB re 1 {unit}²/Hz)", fontsize=9)
    frequency_axis(axes, float(measured.frequency_hz[1]), rate_hz / 2.0)
    legend(axes, loc="upper right")
    white = "white" if found.tests.white else "not white"
    free = "free of" if found.tests.uncorrelated_with_input else "not free of"
    columns = {
        "frequency_hz": measured.frequency_hz[shown].tolist(),
        "position_density": measured.density[shown].tolist(),
        "residual_density": left.density[shown].tolist(),
    }
    return Plate("residual", "Residual", f"The innovations are {white} and {free} the command.", made, columns)


def save_identification(found: Identification, folder: Path) -> None:
    """Write both plates (SVG and CSV) into `folder`, whole or not at all."""
    rate = float(found.model.record.get("rate_hz", 0.0) or 0.0)
    with atomic_folder(folder, _OWN_NAMES) as beside:
        identification_plate(found).save(beside)
        if rate > 0.0:
            residual_plate(found, rate).save(beside)


def _ratio(found: Identification) -> str:
    position, command = found.model.position_unit, found.model.command_unit
    return f"re 1 {position or 'unit'}/{command or 'unit'}"


def motor_plate(
    frequency_hz: FloatArray,
    measured: ComplexArray,
    continuous: ContinuousSystem,
    sampled: SampledSystem,
    channel: str,
    name: str = "fig04",
) -> Plate:
    """Draw magnitude and phase of y/u: measured at frequency_hz (n,), and both models between its ends."""
    low, high = float(frequency_hz.min()), float(frequency_hz.max())
    fine = np.geomspace(low, high, 400)
    made, (upper, lower) = figure(2, 1, height_in=5.0, sharex=True)
    models = ((continuous, BLUE, "-", "continuous model"), (sampled, RED, "--", "sampled model (zero-order hold)"))
    for system, colour, line, label in models:
        response = system.response(fine)
        upper.plot(fine, db(response), color=colour, linestyle=line, label=label)
        lower.plot(fine, np.degrees(np.unwrap(np.angle(response))), color=colour, linestyle=line)
    upper.plot(frequency_hz, db(measured), "o", color=INK, markersize=3.5, fillstyle="none", label="measured")
    phase = np.degrees(np.unwrap(np.angle(measured)))
    lower.plot(frequency_hz, phase, "o", color=INK, markersize=3.5, fillstyle="none")
    upper.set_ylabel("magnitude (dB)", fontsize=9)
    lower.set_ylabel("phase (degrees)", fontsize=9)
    frequency_axis(upper, low / 1.1, high * 1.1, label=False)
    frequency_axis(lower, low / 1.1, high * 1.1)
    legend(upper, loc="lower left")
    missing = db(measured) - db(sampled.response(frequency_hz))
    caption = (
        f"Open-loop response of the {channel} motor, y over u, measured by stepped sine to {high:g} Hz, and the model "
        f"identified from one record. At low frequencies friction takes up to {abs(float(missing.min())):.2f} dB of "
        "the motion."
    )
    table = {
        "frequency_hz": frequency_hz.tolist(),
        "measured_db": db(measured).tolist(),
        "measured_deg": phase.tolist(),
        "continuous_db": db(continuous.response(frequency_hz)).tolist(),
        "sampled_db": db(sampled.response(frequency_hz)).tolist(),
    }
    return Plate(name, "Open-loop response of the motor assembly", caption, made, table)


def noise_plate(proportional: Mapping[float, FeltNoise], designed: FeltNoise, name: str = "noise") -> Plate:
    """Draw one channel: felt third octaves (left), mains lines (right), by proportional gain and under the designed
    loop.
    """
    made, (left, right) = figure(1, 2, height_in=4.2, sharey=True)
    shades = colormaps["viridis"](np.linspace(0.0, 0.85, len(proportional)))
    for shade, (gain, heard) in zip(shades, proportional.items(), strict=True):
        _draw_noise(left, right, heard, tuple(shade), f"gain {gain:g}", 1.0)
    _draw_noise(left, right, designed, RED, "designed loop", 2.0)
    low, high = float(designed.band_hz.min()), float(designed.band_hz.max())
    frequency_axis(left, low / 1.2, high * 1.2)
    right.set_xlabel("frequency (Hz)", fontsize=9)
    right.set_xticks(designed.line_hz)
    left.set_ylabel("felt level (dB SL)", fontsize=9)
    left.set_title("third octaves", fontsize=9)
    right.set_title("mains lines", fontsize=9)
    for axes in (left, right):
        axes.axhline(0.0, color=INK, linewidth=1.0)
    left.annotate("threshold", (low, 0.0), (0, -10), textcoords="offset points", fontsize=7)
    made.legend(loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    caption = (
        f"Channel {designed.channel} at rest, judged from the command through the motor's model: under a proportional "
        f"controller of rising gain and under the designed loop, whose strongest line is felt at "
        f"{designed.worst_line_db_sl:.1f} dB SL and strongest third octave at {designed.band_db_sl.max():.1f} dB SL."
    )
    return Plate(name, "Felt hum and noise", caption, made, _noise_table(proportional, designed))


def _draw_noise(left: Axes, right: Axes, heard: FeltNoise, colour: object, label: str, width: float) -> None:
    left.plot(heard.band_hz, heard.band_db_sl, color=colour, linewidth=width, label=label)
    right.plot(heard.line_hz, heard.line_db_sl, "o-", color=colour, linewidth=width, markersize=3)
    if heard.resonance_hz is not None and heard.resonance_db_sl is not None:
        left.plot(heard.resonance_hz, heard.resonance_db_sl, "v", color=colour, markersize=6)


def _noise_table(proportional: Mapping[float, FeltNoise], designed: FeltNoise) -> dict[str, list[object]]:
    table: dict[str, list[object]] = {"controller": [], "kind": [], "frequency_hz": [], "level_db_sl": []}
    named = [*((f"gain {gain:g}", heard) for gain, heard in proportional.items()), ("designed", designed)]
    for controller, heard in named:
        kinds = (("line", heard.line_hz, heard.line_db_sl), ("third octave", heard.band_hz, heard.band_db_sl))
        for kind, frequency, level in kinds:
            for row in zip(frequency.tolist(), level.tolist(), strict=True):
                for cells, cell in zip(table.values(), (controller, kind, *row), strict=True):
                    cells.append(cell)
    return table


@dataclass(frozen=True, eq=False)
class LevelResponse:
    """One channel at one level: peak volts expected and measured at frequency_hz (n,), half-width ci_db, saturation."""

    channel: str
    level_db_sl: float
    frequency_hz: FloatArray
    expected_v: FloatArray
    measured_v: FloatArray
    ci_db: FloatArray
    saturated: NDArray[np.bool_]

    @property
    def error_db(self) -> FloatArray:
        """Return the measured less the expected level, dB."""
        return db(self.measured_v) - db(self.expected_v)


def save_measured(responses: Sequence[Response], controller: Controller, folder: Path) -> None:
    """Write the figure of measured responses (SVG, with its numbers as CSV) into `folder`, whole or not at all.

    Raises BadInput for a folder that holds anything else.
    """
    runs = [
        LevelResponse(
            one.channel,
            one.level_db_sl,
            one.frequency_hz,
            expected_v(one, controller),
            one.magnitude_v,
            one.confidence_db,
            one.saturated,
        )
        for one in responses
    ]
    load = responses[0].load
    words = "without load" if load == "none" else f"under the load {load!r}"
    save_plates([response_plate(runs, words, "response", f"the nominal plant {words}")], folder)


def response_plate(
    runs: Sequence[LevelResponse], condition: str, name: str, plant: str = "the nominal plant without load"
) -> Plate:
    """Draw a panel for each channel: sensor output (dB re 1 V) against frequency, below it the error with its
    confidence; `plant`: what the expected output was computed from, in words.
    """
    channels = list(dict.fromkeys(run.channel for run in runs))
    made, grid = figure(2, len(channels), 4.8, sharex=True, sharey="row", squeeze=False, height_ratios=(2.4, 1.0))
    for column, channel in enumerate(channels):
        own = [run for run in runs if run.channel == channel]
        _draw_response(grid[0, column], own)
        _errors(grid[1, column], own)
        grid[0, column].set_title(channel, fontsize=9)
        low, high = float(own[0].frequency_hz.min()), float(own[0].frequency_hz.max())
        frequency_axis(grid[0, column], low / 1.2, high * 1.2, label=False)
        frequency_axis(grid[1, column], low / 1.2, high * 1.2)
        _thin_ticks(grid[1, column], len(channels))
    grid[0, 0].set_ylabel("sensor output (dB re 1 V peak)", fontsize=9)
    grid[1, 0].set_ylabel("error (dB)", fontsize=9)
    _key(grid[0, -1])
    clean = max(
        (float(np.max(np.abs(run.error_db[~run.saturated]), initial=0.0)) for run in runs if run.level_db_sl > 0),
        default=float("nan"),
    )
    quiet = ", 0 dB SL in orange, higher levels in deeper blue" if any(run.level_db_sl == 0.0 for run in runs) else ""
    caption = (
        f"Sensor output at {', '.join(f'{level:g}' for level in sorted({run.level_db_sl for run in runs}))} dB SL, "
        f"{condition}: measured (circles) and expected from the shipped sections and {plant} "
        f"(lines). Below, the difference with its confidence{quiet}. Largest difference above 0 dB SL, "
        f"saturated points left out: {clean:.2f} dB."
    )
    return Plate(name, f"Measured and expected output, {condition}", caption, made, _response_table(runs))


def _draw_response(axes: Axes, runs: Sequence[LevelResponse]) -> None:
    for run in runs:
        axes.plot(run.frequency_hz, db(run.expected_v), color=BLUE, linewidth=1.0)
        good = ~run.saturated
        axes.plot(run.frequency_hz[good], db(run.measured_v[good]), "o", color=INK, markersize=3, fillstyle="none")
        axes.plot(run.frequency_hz[~good], db(run.measured_v[~good]), "x", color=RED, markersize=5)
        at = (float(run.frequency_hz[0]), float(db(run.expected_v[0])))
        axes.annotate(f"{run.level_db_sl:g} dB SL", at, (2, 4), textcoords="offset points", fontsize=7)


def _errors(axes: Axes, runs: Sequence[LevelResponse]) -> None:
    shades = np.linspace(1.0, 0.25, len(runs))[::-1]
    for shade, run in zip(shades, sorted(runs, key=lambda one: one.level_db_sl), strict=True):
        good = ~run.saturated
        error, ci = run.error_db[good], run.ci_db[good]
        axes.errorbar(
            run.frequency_hz[good], error, ci, fmt="o", color=ORANGE if run.level_db_sl == 0.0 else BLUE, markersize=2,
            elinewidth=0.7, alpha=float(shade) if run.level_db_sl else 1.0,
        )  # fmt: skip
    axes.axhline(0.0, color=INK, linewidth=0.6)
    dress(axes)


def _thin_ticks(axes: Axes, panels: int) -> None:
    """Mark decades only, where panels are narrow."""
    if panels > 1:
        axes.set_xticks([1.0, 10.0, 100.0], ["1", "10", "100"])


def _key(axes: Axes) -> None:
    marks = [
        Line2D([], [], color=BLUE, linewidth=1.0, label="expected"),
        Line2D([], [], color=INK, marker="o", markersize=3, fillstyle="none", linestyle="", label="measured"),
        Line2D([], [], color=RED, marker="x", markersize=5, linestyle="", label="saturated"),
    ]
    axes.legend(handles=marks, fontsize=7, frameon=False, loc="lower left")


def _response_table(runs: Sequence[LevelResponse]) -> dict[str, list[object]]:
    table: dict[str, list[object]] = {
        name: []
        for name in ("channel", "level_db_sl", "frequency_hz", "expected_v", "measured_v", "ci_db", "saturated")
    }
    for run in runs:
        columns = (run.frequency_hz, run.expected_v, run.measured_v, run.ci_db, run.saturated)
        for row in zip(*(column.tolist() for column in columns), strict=True):
            for cells, cell in zip(table.values(), (run.channel, run.level_db_sl, *row), strict=True):
                cells.append(cell)
    return table
