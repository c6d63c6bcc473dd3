"""What is measured of a mechanism: a record of command and position, its response, a response that others give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.plain import brief
from tactuator.result import Chart, ChartLine, Fact, Result, data, fields_of, found
from tactuator.signals.decibels import db
from tactuator.signals.multisine import without_periods

Method = Literal["stepped-sine", "multisine"]


@dataclass(frozen=True, eq=False)
class Response:
    """A measured frequency response of one channel. Arrays of shape (m,), frequencies ascending.

    amplitude_v: complex peak volts of y, phase against the reference. confidence_db: 95 % half-width of the magnitude.
    noise_v, distortion_v: peak volts at that frequency of what does not repeat and of what repeats but is not
    linear. saturated: a converter's, the command's or the travel's limit was reached during that point. reached: the
    confidence asked for was reached in the time allowed. averaged_s: seconds averaged. reference: peak, threshold units
    (m,).
    """

    channel: str
    load: str
    level_db_sl: float
    method: Method
    frequency_hz: FloatArray
    amplitude_v: ComplexArray
    reference: FloatArray
    confidence_db: FloatArray
    noise_v: FloatArray
    distortion_v: FloatArray
    saturated: NDArray[np.bool_]
    reached: NDArray[np.bool_]
    averaged_s: FloatArray
    controller_hash: str = ""

    __repr__ = brief

    def __post_init__(self) -> None:
        shape = self.frequency_hz.shape
        for name in ("amplitude_v", "reference", "confidence_db", "noise_v", "distortion_v", "saturated", "reached"):
            if getattr(self, name).shape != shape:
                raise BadInput(f"response: {name} has shape {getattr(self, name).shape}", f"{shape}")

    @property
    def magnitude_v(self) -> FloatArray:
        """Return the peak of y in volts, (m,)."""
        return np.abs(self.amplitude_v)

    @property
    def magnitude_db(self) -> FloatArray:
        """Return the magnitude in dB of volts of y per threshold unit, (m,)."""
        return db(self.amplitude_v / self.reference)

    @property
    def phase_rad(self) -> FloatArray:
        """Return the phase against the reference, unwrapped from the lowest frequency up, (m,)."""
        return np.unwrap(np.angle(self.amplitude_v))

    @property
    def latency_s(self) -> FloatArray:
        """Return the phase delay in seconds: how much later than the reference a peak of y comes, (m,)."""
        return np.asarray(-self.phase_rad / (2.0 * np.pi * self.frequency_hz))


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """A response at some frequencies, with the uncertainty of its magnitudes.

    frequency_hz ascending, magnitude (position's unit over the command's), phase_rad or None, deviation: relative
    standard error of the magnitude; all (m,). about: where it comes from. remarks: what had to be assumed; assumed: is
    the deviation a guess?
    """

    frequency_hz: FloatArray
    magnitude: FloatArray
    phase_rad: FloatArray | None
    deviation: FloatArray
    about: dict[str, str] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    assumed: bool = False

    __repr__ = brief

    def __post_init__(self) -> None:
        if self.frequency_hz.size < 4:
            raise BadInput(f"a response at {self.frequency_hz.size} frequencies", "4 or more")
        if np.any(np.diff(self.frequency_hz) <= 0.0) or self.frequency_hz[0] <= 0.0:
            raise BadInput("the response's frequencies do not ascend from above zero", "ones that do")
        if np.any(self.magnitude <= 0.0):
            raise BadInput("a magnitude of the response is zero or below", "above zero (dB: in a column _db)")

    def value(self) -> NDArray[np.complex128]:
        """Return the complex response, (m,); of magnitudes alone that of least phase."""
        phase = minimum_phase(self.frequency_hz, self.magnitude) if self.phase_rad is None else self.phase_rad
        return np.asarray(self.magnitude * np.exp(1j * phase))


def minimum_phase(frequency_hz: FloatArray, magnitude: FloatArray) -> FloatArray:
    """Return the phase, radians, of the stable response with that magnitude and the least phase, (m,).

    Bode's relation: 1/pi times the integral of the slope d log|G| / d log f, weighted by log coth |u/2|, u the distance
    in log frequency. Beyond its ends the magnitude goes on with its end slopes. Source: Bode, Network Analysis and
    Feedback Amplifier Design, 1945, chapter 14.
    """
    place, level = np.log(frequency_hz), np.log(magnitude)
    ends = [np.polyfit(place[part], level[part], 1)[0] for part in (slice(0, 3), slice(-3, None))]
    grid = np.arange(place[0] - 8.0, place[-1] + 8.0, 0.01)
    along = np.interp(grid, place, level)
    along = np.where(grid < place[0], level[0] + ends[0] * (grid - place[0]), along)
    along = np.where(grid > place[-1], level[-1] + ends[1] * (grid - place[-1]), along)
    slope = np.diff(along) / np.diff(grid)
    middle = 0.5 * (grid[1:] + grid[:-1])
    phase = []
    for at in place:
        # half a step off a singularity that can be integrated
        away = np.maximum(np.abs(middle - at), 0.0025)
        phase.append(float(np.sum(slope * np.log(1.0 / np.tanh(0.5 * away)) * 0.01)) / np.pi)
    return np.array(phase)


@dataclass(frozen=True, eq=False)
class Record(Result):
    """A measured time series. It draws command and position over time.

    command, position: (n,), finite, at rate_hz, in command_unit and position_unit.
    reference: what a loop around it was asked for, (n,), or None.

    about: what is known of its making (rig, date, channel, load, calibration). remarks: what had to be done to it
    (samples filled, stamps evened out), for the user.
    """

    rate_hz: float
    command: FloatArray
    position: FloatArray
    command_unit: str = "V"
    position_unit: str = "V"
    reference: FloatArray | None = None
    about: dict[str, str] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    __repr__ = Result.__repr__

    def __post_init__(self) -> None:
        if not (np.isfinite(self.rate_hz) and self.rate_hz > 0.0):
            raise BadInput(f"record: rate is {self.rate_hz} Hz", "a positive number")
        if self.command.ndim != 1 or self.command.shape != self.position.shape:
            raise BadInput(f"record: command {self.command.shape}, position {self.position.shape}", "one shape (n,)")
        if self.reference is not None and (
            self.reference.shape != self.command.shape or not np.all(np.isfinite(self.reference))
        ):
            raise BadInput(f"record: reference {self.reference.shape}", f"numbers, {self.command.shape}")
        for name in ("command", "position"):
            bad = np.flatnonzero(~np.isfinite(getattr(self, name)))
            if bad.size:
                raise BadInput(
                    f"record: {name} is not a number in {bad.size} samples, first in sample {bad[0]}", "none"
                )

    def facts(self) -> Sequence[Fact]:
        """Return duration, rate and greatest values, and the fields."""
        peaks = {name: float(np.max(np.abs(getattr(self, name)))) for name in ("command", "position")}
        units = {"command": self.command_unit, "position": self.position_unit}
        return [
            found("duration", self.duration_s, "s"),
            found("rate", self.rate_hz, "Hz"),
            *(found(name, f"up to {peak:.4g} {units[name]}".rstrip()) for name, peak in peaks.items()),
            *data(fields_of(self)),
        ]

    def columns(self) -> Mapping[str, Any]:
        """Return time, command and position."""
        time_s = np.arange(self.command.size) / self.rate_hz
        return {"time_s": time_s, "command": self.command, "position": self.position}

    def chart(self) -> Chart:
        """Return command and position over time."""
        time_s = self.columns()["time_s"]
        command = ChartLine("command", time_s, self.command, right=True, colour=5)
        position = ChartLine("position", time_s, self.position, colour=0)
        labels = [
            f"{name} ({unit or 'no unit'})"
            for name, unit in (("position", self.position_unit), ("command", self.command_unit))
        ]
        return Chart("time (s)", labels[0], [command, position], right_label=labels[1])

    def part(self, piece: slice) -> Record:
        """Return the samples of a piece of the record, periods of a plan no longer known."""
        reference = None if self.reference is None else self.reference[piece]
        about = without_periods(self.about)
        return replace(
            self, command=self.command[piece], position=self.position[piece], reference=reference, about=about
        )

    def between(self, first_s: float, last_s: float) -> Record:
        """Return the record between two times, seconds from its first sample. It knows where it lay in the whole.

        Raises BadInput where that is nothing.
        """
        if not 0.0 <= first_s < last_s <= self.duration_s + 1.0 / self.rate_hz:
            raise BadInput(f"from {first_s:g} s to {last_s:g} s", f"ascending, within 0 .. {self.duration_s:g} s")
        piece = self.part(slice(round(first_s * self.rate_hz), round(last_s * self.rate_hz)))
        lay = {"from_s": f"{self.from_s + first_s:.9g}", "to_s": f"{self.from_s + last_s:.9g}"}
        return replace(piece, about=piece.about | lay)

    @property
    def from_s(self) -> float:
        """Return where the record begins in the whole that it was cut from, seconds."""
        return float(self.about.get("from_s", 0.0))

    @property
    def duration_s(self) -> float:
        """Return the length of the record, seconds."""
        return self.command.size / self.rate_hz
