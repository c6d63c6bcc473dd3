"""The chain's nouns with a result's manners: displays, records, curves, models."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from tactuator.api.identified import response_chart
from tactuator.model.description import Display, display_document
from tactuator.model.plant_model import PlantModel
from tactuator.perception.curve import COMFORT_DB_SL, ThresholdCurve
from tactuator.result import Result, coefficients, figure
from tactuator.signals.record import Record
from tactuator.table import FREQUENCY, Chart, ChartLine

_Z95 = 1.959964


def _thresholds(curves: Mapping[str, ThresholdCurve], comfort_db_sl: float) -> Chart:
    drawn = []
    for number, (label, curve) in enumerate(curves.items()):
        hertz, level, error = curve.frequency_hz, curve.level_db_re_1um, curve.standard_error_db
        half = None if error is None else _Z95 * error
        words = f"comfort, {comfort_db_sl:g} dB above it" if number == 0 else ""
        drawn.append(ChartLine(label, hertz, level, "o-", half, colour=number))
        drawn.append(ChartLine(words, hertz, level + comfort_db_sl, "--", colour=number))
    return Chart(FREQUENCY, "level (dB re 1 µm, peak)", drawn, log_x=True)


class DisplayResult(Result, Display):
    """A display as its file describes it. It draws the threshold curve of every channel."""

    def headline(self) -> Mapping[str, str]:
        curves = ", ".join(dict.fromkeys(channel.threshold.curve.name for channel in self.channels))
        names = ", ".join(channel.name for channel in self.channels)
        return {"name": self.name, "rate": figure(self.rate_hz, "Hz"), "channels": names, "curve": curves}

    def chart(self) -> Chart:
        curves = {channel.threshold.curve.name: channel.threshold.curve for channel in self.channels}
        names = {name: [c.name for c in self.channels if c.threshold.curve.name == name] for name in curves}
        labelled = {f"{', '.join(names[name])}: {name}": curve for name, curve in curves.items()}
        return _thresholds(labelled, self.objectives.comfort_db_sl)

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

    def chart(self) -> Chart:
        time_s = self.columns()["time_s"]
        of_signals = {"command": self.command_unit, "position": self.position_unit}
        units = [f"{name} ({unit or 'no unit'})" for name, unit in of_signals.items()]
        command = ChartLine("command", time_s, self.command, right=True, colour=5)
        position = ChartLine("position", time_s, self.position, colour=0)
        return Chart("time (s)", units[1], [command, position], right_label=units[0])


class CurveResult(Result, ThresholdCurve):
    """A threshold curve. It draws level over frequency."""

    def headline(self) -> Mapping[str, str]:
        band = f"{self.frequency_hz[0]:g} to {self.frequency_hz[-1]:g} Hz"
        return {"name": self.name, "provenance": self.provenance, "band": band, "points": str(self.frequency_hz.size)}

    def columns(self) -> Mapping[str, Any]:
        return {"frequency_hz": self.frequency_hz, "level_db_re_1um": self.level_db_re_1um}

    def chart(self) -> Chart:
        return _thresholds({f"{self.name} ({self.provenance})": self}, COMFORT_DB_SL)


class ModelResult(Result, PlantModel):
    """A plant as it was identified. It draws the magnitude of its response with its 95 % confidence."""

    def headline(self) -> Mapping[str, str]:
        return {
            "num": coefficients(self.num),
            "den": coefficients(self.den),
            "dead time": figure(1e3 * self.delay_s, "ms"),
            "band": f"{self.band_hz[0]:.3g} to {self.band_hz[1]:.3g} Hz",
        }

    def chart(self) -> Chart:
        return response_chart(self)
