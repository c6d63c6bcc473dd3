"""Figure 4: a motor's measured response with its continuous and sampled models."""

from __future__ import annotations

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.report.plate import Plate
from tactuator.report.style import BLUE, INK, RED, figure, frequency_axis, legend
from tactuator.signals.decibels import db
from tactuator.signals.systems import ContinuousSystem, SampledSystem


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
