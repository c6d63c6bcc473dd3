"""The chain's nouns with a result's manners: displays, records, curves, models."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from tactuator.model.description import Display, display_document
from tactuator.model.plant_model import PlantModel
from tactuator.perception.curve import ThresholdCurve
from tactuator.signals.decibels import db
from tactuator.signals.record import Record
from tactuator.verbs.result import Result, figure, lines_of

if TYPE_CHECKING:
    from tactuator.report.lines import Lines

_LEVEL = "level (dB re 1 µm, peak)"


def coefficients(values: Any) -> str:
    """Return the coefficients of a polynomial as they are told in a line."""
    return "[" + ", ".join(f"{value:.5g}" for value in np.atleast_1d(values)) + "]"


class DisplayResult(Result, Display):
    """A display as its file describes it. It draws the threshold curve of every channel."""

    def headline(self) -> Mapping[str, str]:
        curves = ", ".join(dict.fromkeys(channel.threshold.curve.name for channel in self.channels))
        names = ", ".join(channel.name for channel in self.channels)
        return {"name": self.name, "rate": figure(self.rate_hz, "Hz"), "channels": names, "curve": curves}

    def lines(self) -> Lines:
        curves = [(channel.name, channel.threshold.curve) for channel in self.channels]
        each = [(name, curve.frequency_hz, curve.level_db_re_1um) for name, curve in curves]
        return lines_of("frequency (Hz)", _LEVEL, each, log_x=True)

    def to_dict(self) -> dict[str, Any]:
        return display_document(self)


class RecordResult(Result, Record):
    """A record of command and position. It draws both over time."""

    def headline(self) -> Mapping[str, str]:
        return {
            "duration": figure(self.duration_s, "s"),
            "rate": figure(self.rate_hz, "Hz"),
            "command": f"up to {figure(float(np.max(np.abs(self.command))), self.command_unit)}",
            "position": f"up to {figure(float(np.max(np.abs(self.position))), self.position_unit)}",
        }

    def columns(self) -> Mapping[str, Any]:
        time_s = np.arange(self.command.size) / self.rate_hz
        return {"time_s": time_s, "command": self.command, "position": self.position}

    def lines(self) -> Lines:
        time_s = self.columns()["time_s"]
        each = [("command", time_s, self.command), ("position", time_s, self.position)]
        return lines_of("time (s)", f"command ({self.command_unit}), position ({self.position_unit})", each)


class CurveResult(Result, ThresholdCurve):
    """A threshold curve. It draws level over frequency."""

    def headline(self) -> Mapping[str, str]:
        band = f"{self.frequency_hz[0]:g} to {self.frequency_hz[-1]:g} Hz"
        return {"name": self.name, "provenance": self.provenance, "band": band, "points": str(self.frequency_hz.size)}

    def columns(self) -> Mapping[str, Any]:
        return {"frequency_hz": self.frequency_hz, "level_db_re_1um": self.level_db_re_1um}

    def lines(self) -> Lines:
        return lines_of("frequency (Hz)", _LEVEL, [(self.name, *self.columns().values())], log_x=True)


class ModelResult(Result, PlantModel):
    """A plant as it was identified. It draws the magnitude of its response."""

    def headline(self) -> Mapping[str, str]:
        return {
            "num": coefficients(self.num),
            "den": coefficients(self.den),
            "dead time": figure(1e3 * self.delay_s, "ms"),
            "band": f"{self.band_hz[0]:.3g} to {self.band_hz[1]:.3g} Hz",
        }

    def lines(self) -> Lines:
        frequency = np.geomspace(*self.band_hz, 300)
        each = [("model", frequency, db(np.abs(self.response(frequency))))]
        return lines_of("frequency (Hz)", "magnitude (dB)", each, log_x=True)
