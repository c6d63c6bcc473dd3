"""The chain's nouns with a result's manners: displays, records, curves, models, controllers, verdicts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactuator.api.result import Result, lines_of, told
from tactuator.identification.calibration import Calibration
from tactuator.identification.result import Identification
from tactuator.io.controller import write_controller
from tactuator.io.model import write_identified
from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.model.document import display_document
from tactuator.model.plant_model import PlantModel
from tactuator.model.verdict import Verdict
from tactuator.perception.curve import ThresholdCurve
from tactuator.signals.decibels import db
from tactuator.signals.record import Record

if TYPE_CHECKING:
    from tactuator.report.lines import Lines

_LEVEL = "level (dB re 1 µm, peak)"


def _coefficients(values: Any) -> str:
    return "[" + ", ".join(f"{value:.5g}" for value in np.atleast_1d(values)) + "]"


class DisplayResult(Result, Display):
    """A display as its file describes it. It draws the threshold curve of every channel."""

    def headline(self) -> Mapping[str, str]:
        """Return name, rate, channels and curves."""
        curves = ", ".join(dict.fromkeys(one.threshold.curve.name for one in self.channels))
        names = ", ".join(one.name for one in self.channels)
        return {"name": self.name, "rate": told(self.rate_hz, "Hz"), "channels": names, "curve": curves}

    def lines(self) -> Lines:
        """Return the threshold curves over frequency."""
        curves = [(one.name, one.threshold.curve) for one in self.channels]
        each = [(name, curve.frequency_hz, curve.level_db_re_1um) for name, curve in curves]
        return lines_of("frequency (Hz)", _LEVEL, each, log_x=True)

    def to_dict(self) -> dict[str, Any]:
        """Return the tables of the display file."""
        return display_document(self)


class RecordResult(Result, Record):
    """A record of command and position. It draws both over time."""

    def headline(self) -> Mapping[str, str]:
        """Return duration, rate and extremes."""
        return {
            "duration": told(self.duration_s, "s"),
            "rate": told(self.rate_hz, "Hz"),
            "command": f"up to {told(float(np.max(np.abs(self.command))), self.command_unit)}",
            "position": f"up to {told(float(np.max(np.abs(self.position))), self.position_unit)}",
        }

    def columns(self) -> Mapping[str, Any]:
        """Return time (s), command and position."""
        time_s = np.arange(self.command.size) / self.rate_hz
        return {"time_s": time_s, "command": self.command, "position": self.position}

    def lines(self) -> Lines:
        """Return command and position over time."""
        time_s = self.columns()["time_s"]
        each = [("command", time_s, self.command), ("position", time_s, self.position)]
        return lines_of("time (s)", f"command ({self.command_unit}), position ({self.position_unit})", each)


class CurveResult(Result, ThresholdCurve):
    """A threshold curve. It draws level over frequency."""

    def headline(self) -> Mapping[str, str]:
        """Return name, provenance, range and number of points."""
        band = f"{self.frequency_hz[0]:g} to {self.frequency_hz[-1]:g} Hz"
        return {"name": self.name, "provenance": self.provenance, "band": band, "points": str(self.frequency_hz.size)}

    def columns(self) -> Mapping[str, Any]:
        """Return frequency (Hz) and level (dB re 1 µm, peak)."""
        return {"frequency_hz": self.frequency_hz, "level_db_re_1um": self.level_db_re_1um}

    def lines(self) -> Lines:
        """Return the level over frequency."""
        return lines_of("frequency (Hz)", _LEVEL, [(self.name, *self.columns().values())], log_x=True)


class ModelResult(Result, PlantModel):
    """A plant as it was identified. It draws the magnitude of its response."""

    def headline(self) -> Mapping[str, str]:
        """Return numerator, denominator, dead time and band."""
        return {
            "num": _coefficients(self.num),
            "den": _coefficients(self.den),
            "dead time": told(1e3 * self.delay_s, "ms"),
            "band": f"{self.band_hz[0]:.3g} to {self.band_hz[1]:.3g} Hz",
        }

    def lines(self) -> Lines:
        """Return the magnitude over the band."""
        frequency = np.geomspace(*self.band_hz, 300)
        each = [("model", frequency, db(np.abs(self.response(frequency))))]
        return lines_of("frequency (Hz)", "magnitude (dB)", each, log_x=True)


class IdentificationResult(Result, Identification):
    """A model with the evidence for it. It draws model and record's own response."""

    def headline(self) -> Mapping[str, str]:
        """Return the model, how well it fits, and whether it is to be trusted."""
        trusted = "no: " + "; ".join(self.distrust) if self.distrust else "yes"
        model = {"num": _coefficients(self.model.num), "den": _coefficients(self.model.den)}
        return {**model, "fit": told(self.fit_percent, "%", 5), "trusted": trusted}

    def columns(self) -> Mapping[str, Any]:
        """Return frequency (Hz), magnitude (dB), phase (degrees) and the 95 % half-width (dB)."""
        frequency = self.frequency_hz()
        response = self.model.response(frequency)
        return {
            "frequency_hz": frequency,
            "magnitude_db": db(np.abs(response)),
            "phase_deg": np.degrees(np.unwrap(np.angle(response))),
            "band_db": self.model.band_db(frequency),
        }

    def lines(self) -> Lines:
        """Return the magnitude of model and record over frequency."""
        columns = self.columns()
        each = [("model", columns["frequency_hz"], columns["magnitude_db"])]
        return lines_of("frequency (Hz)", "magnitude (dB)", each, log_x=True)

    def write(self, path: str | Path) -> None:
        """Write model.json, which a display file names as a channel's plant."""
        write_identified(path, self.model)


class CalibrationResult(Result, Calibration):
    """A sensor gain. It draws the pairs."""

    def headline(self) -> Mapping[str, str]:
        """Return gain and offset with their 95 % half-widths, and the pairs that were refused."""
        return {
            "gain": f"{self.gain_v_per_mm:.5g} ± {self.gain_confidence_v_per_mm:.2g} V/mm",
            "offset": f"{self.offset_v:.4g} ± {self.offset_confidence_v:.2g} V",
            "refused": ", ".join(pair.name for pair in self.refused) or "none",
        }

    def columns(self) -> Mapping[str, Any]:
        """Return displacement (mm), voltage (V) and residual (V) of the pairs that were kept."""
        return {"displacement_mm": self.displacement_mm, "voltage_v": self.voltage_v, "residual_v": self.residual_v}

    def lines(self) -> Lines:
        """Return the voltage of every pair over its displacement."""
        return lines_of(
            "displacement (mm)", "voltage (V)", [("pairs", self.displacement_mm, self.voltage_v)], points=True
        )


class ControllerResult(Result, Controller):
    """A controller. It draws the error of the response against the curve, as the design tells it."""

    def headline(self) -> Mapping[str, str]:
        """Return rate, and for every channel phase margin and error."""
        figures = {"rate": told(self.rate_hz, "Hz")}
        for one in self.channels:
            margins, fit = one.report.get("margins") or {}, one.report.get("prefilter") or {}
            margin = f"phase margin {margins['phase_margin_deg']:.1f}°, " if margins else ""
            figures[one.name] = f"{margin}within {fit.get('max_error_db', np.nan):.2f} dB of the curve"
        return figures

    def to_dict(self) -> dict[str, Any]:
        """Return the document of controller.json."""
        return self.document()

    def lines(self) -> Lines:
        """Return the magnitude of every prefilter over its band."""
        each = []
        for one in self.channels:
            frequency = np.geomspace(*self.display.channel(one.name).threshold.band_hz, 300)
            each.append((one.name, frequency, db(np.abs(one.prefilter(self.rate_hz).response(frequency)))))
        return lines_of("frequency (Hz)", "prefilter (dB re 1 V per threshold unit)", each, log_x=True)

    def write(self, path: str | Path) -> None:
        """Write the controller file, whole or not at all."""
        write_controller(path, self)


class VerdictResult(Result, Verdict):
    """A verdict on the paper's four objectives. It draws what was found as a share of what is allowed."""

    def headline(self) -> Mapping[str, str]:
        """Return the outcome and the sentence of the verdict."""
        return {"outcome": self.outcome.value, "verdict": self.sentence}

    def to_dict(self) -> dict[str, Any]:
        """Return the document that `tactuator check --json` prints."""
        return self.document()

    def columns(self) -> Mapping[str, Any]:
        """Return objective, channel, load, quantity, value, allowed, unit and outcome, a row for each finding."""
        found = [one for objective in self.objectives for one in objective.findings]
        names = ("objective", "channel", "load", "quantity", "value", "allowed", "unit", "outcome")
        return {
            name: [str(v) if name == "outcome" else v for v in (getattr(one, name) for one in found)] for name in names
        }

    def lines(self) -> Lines:
        """Return value and limit of every finding that has both, in the order of the findings."""
        found = [one for objective in self.objectives for one in objective.findings if one.allowed is not None]
        number = np.arange(len(found))
        each = [("found", number, [one.value for one in found]), ("allowed", number, [one.allowed for one in found])]
        return lines_of("finding", "value (each in its unit)", each, points=True)
