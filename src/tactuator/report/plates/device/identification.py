"""Plates of an identification: the response with its band, and what is left in the residual."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from tactuator.arrays import FloatArray
from tactuator.identification.result import Identification
from tactuator.io.atomic import atomic_folder
from tactuator.report.plate import Plate
from tactuator.report.style import BLUE, FAINT, GREEN, ORANGE, RED, figure, frequency_axis, legend
from tactuator.signals.spectra import power_spectrum

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
