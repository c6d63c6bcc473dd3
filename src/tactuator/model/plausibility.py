"""Figures that can hardly be: a unit of another size, columns in another order, a rate in kilohertz.

Each file may be right by itself; a slip shows where two values describe the same thing. Each check
is one row of `EXPECTED`: what is compared, between which bounds it lies in a sound setup, and the slip that brings it
below or above them. Its bounds leave room for whatever a person can feel: a slip of units is a factor of a thousand.
What cannot be speaks against a verdict, and what is only unusual leaves it open.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.model.plant import DERIVATIVES
from tactuator.model.plant_model import QualityCheck
from tactuator.model.verdict import Finding, Outcome
from tactuator.parameters import HIGHEST_RATE_HZ
from tactuator.perception.curve import ThresholdCurve, curve
from tactuator.signals.record import FrequencyResponse, Record, minimum_phase

if TYPE_CHECKING:  # what a record's doubts do not need
    from tactuator.model.description import Channel, Display


@dataclass(frozen=True)
class Plausible:
    """One check: what is compared, its unit, its bounds, and the likely slip below and above them.

    impossible: no sound setup lies outside; otherwise it is only unusual.
    """

    what: str
    unit: str
    low: float
    high: float
    below: str
    above: str
    impossible: bool = False

    def doubts(self, value: float) -> Iterator[Doubt]:
        """Yield the doubt about a value outside the bounds; nothing for one within them."""
        if not self.low <= value <= self.high:
            yield Doubt(self, float(value))


@dataclass(frozen=True)
class Doubt:
    """A value outside the bounds of its check."""

    expected: Plausible
    value: float

    @property
    def slip(self) -> str:
        """Return what was likely done."""
        return self.expected.above if self.value > self.expected.high else self.expected.below

    @property
    def bound(self) -> float:
        """Return the bound that is passed."""
        return self.expected.high if self.value > self.expected.high else self.expected.low

    def quality_check(self) -> QualityCheck:
        """Return it as a number that a model is judged by: what cannot be refuses trust."""
        check, decides = self.expected, "refuses trust" if self.expected.impossible else "cannot tell"
        least = self.value < check.low
        return QualityCheck(check.what, self.value, check.unit, self.bound, decides, least, self.slip)  # type: ignore[arg-type]

    def __str__(self) -> str:
        check, side = self.expected, "up to" if self.value > self.expected.high else "from"
        unit = f" {check.unit}" if check.unit else ""
        return f"{check.what} is {self.value:.3g}{unit}, expected {side} {self.bound:.3g}{unit}: {self.slip}"


EXPECTED: Mapping[str, Plausible] = {
    "rate": Plausible(
        "the sampling rate", "Hz", 20.0, HIGHEST_RATE_HZ,
        "time in milliseconds where seconds are read, or a rate in kHz",
        "time in seconds where milliseconds are read, or a rate in mHz", impossible=True,
    ),
    "position": Plausible(
        "position amplitude (sensor volts)", "V", 5e-3, 100.0,
        "metres or millimetres where volts are read, or a position that hardly moves",
        "millivolts, or counts of a converter, where volts are read",
    ),
    "command": Plausible(
        "command amplitude (volts)", "V", 5e-3, 2000.0,
        "kilovolts where volts are read, or a command that hardly moves",
        "millivolts, or counts of a converter, where volts are read",
    ),
    "lead": Plausible(
        "the lead of the position before the command", "rad", -np.inf, 0.8, "",
        "input and output look swapped: the position leads the command and rises with frequency, as no mechanism can "
        "(not causal)", impossible=True,
    ),
    "rise": Plausible(
        "the rise of the phase over the band", "rad", -np.inf, 2.0, "",
        "input and output look swapped, since a mechanism's phase falls",
    ),
    "highest frequency": Plausible(
        "the highest frequency of the response", "Hz", 5.0, np.inf, "kilohertz where hertz are read", "",
        impossible=True,
    ),
    "lowest frequency": Plausible(
        "the lowest frequency of the response", "Hz", 0.0, 2e4, "", "millihertz where hertz are read", impossible=True,
    ),
    "displacements": Plausible(
        "half the span of the displacements", "mm", 1e-3, 150.0,
        "metres where millimetres are read", "micrometres where millimetres are read",
    ),
    "voltages": Plausible(
        "half the span of the voltages", "V", 1e-3, 100.0,
        "kilovolts where volts are read", "millivolts where volts are read",
    ),
    "acceleration": Plausible(
        "the acceleration by full command", "m/s²", 0.3, 1.5e4,
        "sensor_gain_v_per_mm per metre, a plant in mm or m per volt, or range_v in kilovolts",
        "sensor_gain_v_per_mm per micrometre, a plant in millivolts per volt, or range_v in millivolts",
    ),
    "reach": Plausible(
        "the travel that full command reaches", "", 0.01, np.inf,
        "travel_mm in micrometres, sensor_gain_v_per_mm per metre, or a plant in mm or m per volt", "",
    ),
    "level": Plausible(
        "the least level that the travel allows in the band", "dB SL", 0.0, np.inf,
        "travel_mm in metres, or a curve in other units than dB re 1 µm", "", impossible=True,
    ),
    "codes": Plausible(
        "the steps of the converter over the travel", "", 50.0, np.inf,
        "sensor_gain_v_per_mm per micrometre, travel_mm in metres, or range_v in millivolts", "",
    ),
    "seen": Plausible(
        "what full travel reads as a share of range_v, beyond which nothing is read,", "", 0.0, 1.0, "",
        "sensor_gain_v_per_mm per metre, travel_mm in micrometres, or range_v in kilovolts",
        impossible=True,
    ),
    "noise": Plausible(
        "the noise of the sensor as a share of what full travel reads", "", 0.0, 0.03, "",
        "noise_v_rms in millivolts",
    ),
    "hum": Plausible(
        "the hum of the sensor as a share of what full travel reads", "", 0.0, 0.1, "", "hum_v_peak in millivolts",
    ),
    "friction": Plausible(
        "friction as a share of the range of the command", "", 0.0, 0.35, "", "friction_v in millivolts",
    ),
    "presliding": Plausible(
        "the presliding distance as a share of what full travel reads", "", 0.0, 0.5, "", "presliding_v in millivolts",
    ),
    "recorded rate": Plausible(
        "the sampling rate of the record over the display's", "", 0.03, 100.0,
        "time of the record in milliseconds, or rate_hz of another device",
        "time of the record in seconds where milliseconds are read, or rate_hz in kHz",
    ),
    "recorded position": Plausible(
        "the position in the record as a share of what full travel reads", "", 1e-3, 1.5,
        "position of the record in mm or m where volts are read, or sensor_gain_v_per_mm per metre",
        "position of the record in millivolts or counts, sensor_gain_v_per_mm per micrometre, or travel_mm in metres",
    ),
    "recorded command": Plausible(
        "the command in the record as a share of range_v", "", 3e-3, 5.0,
        "command of the record in kilovolts, or range_v in millivolts",
        "command of the record in millivolts or counts, or range_v in kilovolts",
    ),
    "curve": Plausible(
        "the threshold curve over the library's", "dB", -30.0, 45.0,
        "levels in dB re 1 mm or 1 m where dB re 1 µm are read", "levels in dB re 1 nm where dB re 1 µm are read",
    ),
    "curve's shape": Plausible(
        "the distance of the curve's shape from the library's, over that of its logarithm,", "", 0.0, 2.5, "",
        "micrometres where dB re 1 µm are read",
    ),
    "curve's span": Plausible(
        "the span of the curve's levels over that of the library's", "", 0.1, np.inf,
        "micrometres, millimetres or metres where dB re 1 µm are read", "",
    ),
    "load": Plausible(
        "the mass of a load over the mass that moves", "", 0.0, 30.0, "", "mass in grams where the plant has kilograms",
    ),
}  # fmt: skip
"""The checks by name."""


def swing(values: FloatArray) -> float:
    """Return half the span of a signal: its amplitude whatever its offset."""
    return 0.5 * float(np.ptp(values))


def record_doubts(record: Record) -> tuple[Doubt, ...]:
    """Return what can hardly be of a record by itself; of a signal in another unit than volts, or in none, nothing."""
    doubts = [*EXPECTED["rate"].doubts(record.rate_hz)]
    for name in ("command", "position"):
        if getattr(record, f"{name}_unit") == "V":
            doubts += EXPECTED[name].doubts(swing(getattr(record, name)))
    return tuple(doubts)


def pairs_doubts(displacement_mm: FloatArray, voltage_v: FloatArray) -> tuple[Doubt, ...]:
    """Return what can hardly be of the pairs of a calibration, (n,) each."""
    spans = {"displacements": displacement_mm, "voltages": voltage_v}
    return tuple(doubt for name, values in spans.items() for doubt in EXPECTED[name].doubts(swing(values)))


def channel_doubts(channel: Channel, rate_hz: float) -> Iterator[Doubt]:
    """Yield what can hardly be of a display's channel: motion, reading, disturbances, record, curve and loads."""
    travel_v = channel.travel_mm * channel.sensor_gain_v_per_mm
    yield from _motion_doubts(channel)
    shares = {"friction": channel.environment.friction_v / channel.converter.range_v}
    if channel.quantity == "displacement":
        environment = channel.environment
        hum = max(environment.hum_v_peak, default=0.0)
        stated = {"noise": environment.noise_v_rms, "hum": hum, "presliding": environment.presliding_v}
        moved = {"noise", "hum"} - set(environment.assumed) | ({"presliding"} if environment.friction_v else set())
        shares |= {name: volts / travel_v for name, volts in stated.items() if name in moved}
        if channel.feedback.structure != "none":
            yield from EXPECTED["codes"].doubts(travel_v / channel.converter.step_v)
            yield from EXPECTED["seen"].doubts(travel_v / channel.converter.range_v)
    for name, share in shares.items():
        yield from EXPECTED[name].doubts(share)
    yield from _recorded_doubts(channel, rate_hz, travel_v)
    yield from curve_doubts(channel.threshold.curve)
    if channel.plant.poles.size - channel.plant.zeros.size == 2 - DERIVATIVES[channel.quantity]:
        heaviest = max((channel.impedance(load)[0] for load in channel.loads), default=0.0)
        yield from EXPECTED["load"].doubts(channel.plant.gain * heaviest)  # in units of the plant's own mass


def channel_reasons(channel: Channel, rate_hz: float) -> list[str]:
    """Return why nothing should be designed for a channel: what can hardly be, and a plant not to be trusted."""
    distrust = () if channel.recorded is None else channel.recorded.distrust
    doubts = map(str, channel_doubts(channel, rate_hz))
    return [*doubts, *(f"the plant is not to be trusted: {reason}" for reason in distrust)]


def _motion_doubts(channel: Channel) -> Iterator[Doubt]:
    """Yield doubts about how far and how fast full command moves a channel, and how far its travel is felt."""
    low, high = channel.threshold.band_hz
    frequency = np.geomspace(low, high, 120)
    speed = 2.0 * np.pi * frequency
    volts = channel.converter.range_v * np.abs(channel.plant.response(frequency))
    reached_mm = volts / channel.sensor_gain_v_per_mm / speed ** DERIVATIVES[channel.quantity]
    felt_mm = channel.threshold.curve.displacement_mm(frequency)
    top = frequency >= max(low, 0.1 * high)  # where a mass is moved; the median leaves a resonance out
    yield from EXPECTED["acceleration"].doubts(1e-3 * float(np.median((reached_mm * speed**2)[top])))
    yield from EXPECTED["reach"].doubts(float(np.max(reached_mm)) / channel.travel_mm)
    yield from EXPECTED["level"].doubts(20.0 * float(np.log10(np.min(channel.travel_mm / felt_mm))))


def _recorded_doubts(channel: Channel, rate_hz: float, travel_v: float) -> Iterator[Doubt]:
    recorded = channel.recorded
    if recorded is None:
        return
    if recorded.rate_hz is not None:
        yield from EXPECTED["recorded rate"].doubts(recorded.rate_hz / rate_hz)
    if recorded.command is not None:
        yield from EXPECTED["recorded command"].doubts(recorded.command / channel.converter.range_v)
    if recorded.position is not None and channel.quantity == "displacement":
        yield from EXPECTED["recorded position"].doubts(recorded.position / travel_v)


def curve_doubts(given: ThresholdCurve) -> Iterator[Doubt]:
    """Yield what can hardly be of a threshold curve, beside the library's over the frequencies of both."""
    usual = curve("bolanowski-1988")
    frequency = np.array([hertz for hertz in given.frequency_hz.tolist() if usual.covers(hertz, hertz)])
    if frequency.size < 3:
        return
    level, known = given.level_db_re_1um_at(frequency), usual.level_db_re_1um_at(frequency)
    yield from EXPECTED["curve"].doubts(float(np.median(level - known)))
    if np.all(level > 0.0):
        if np.ptp(known) > 20.0:  # a few close points may be alike
            yield from EXPECTED["curve's span"].doubts(float(np.ptp(level) / np.ptp(known)))
        as_read, as_linear = float(np.std(level - known)), float(np.std(20.0 * np.log10(level) - known))
        # distance of a curve's shape from the library's below which it is like it
        if as_read > 4.0:
            yield from EXPECTED["curve's shape"].doubts(as_read / max(as_linear, 0.1))


def response_doubts(given: FrequencyResponse) -> tuple[str, ...]:
    """Return what can hardly be of a response, in sentences: its frequencies, and magnitudes and phases that do not go
    together as read, but do in other units.
    """
    first, last = float(given.frequency_hz[0]), float(given.frequency_hz[-1])
    doubts = [*EXPECTED["highest frequency"].doubts(last), *EXPECTED["lowest frequency"].doubts(first)]
    said = [str(doubt) for doubt in doubts]
    if not doubts and _is_round(first / (2.0 * np.pi), last / (2.0 * np.pi)) and not _is_round(first, last):
        said.append(
            f"the frequencies go from {first:.6g} to {last:.6g} Hz, which are {first / 2.0 / np.pi:.4g} and "
            f"{last / 2.0 / np.pi:.4g} times 2π: rad/s where hertz are read"
        )
    return (*said, *_phase_doubt(given))


def _is_round(*values: float) -> bool:
    return all(abs(float(f"{value:.1e}") / value - 1.0) < 2e-4 for value in values)


_POOR_RAD, _BETTER = 0.35, 0.35
"""Rms of a phase beside that of its magnitudes from which on it does not fit, and the share of it that another reading
has to leave."""


@np.errstate(all="ignore")
def _phase_doubt(given: FrequencyResponse) -> Iterator[str]:
    """Yield the reading under which magnitudes and phases go together by Bode's relation, where they do not as read."""
    if given.phase_rad is None:
        return
    least, phase = minimum_phase(given.frequency_hz, given.magnitude), given.phase_rad
    as_read = _apart_rad(given.frequency_hz, least, phase)
    level = 20.0 * np.log10(given.magnitude)
    others = {
        "radians where degrees are read": (least, np.degrees(phase)),
        "degrees where radians are read": (least, np.radians(phase)),
        "a lag written without its sign": (least, -phase),
    }
    if np.all(level > 0.0):
        others["linear magnitudes where dB are read"] = (minimum_phase(given.frequency_hz, level), phase)
    if 3.0 < np.ptp(given.magnitude) < 200.0:  # dB of less are no more than flat
        decibels = minimum_phase(given.frequency_hz, 10.0 ** (given.magnitude / 20.0))
        others["dB where linear magnitudes are read"] = (decibels, phase)
    apart = {slip: _apart_rad(given.frequency_hz, *pair) for slip, pair in others.items()}
    slip = min(apart, key=lambda name: apart[name])
    if as_read > _POOR_RAD and apart[slip] < _BETTER * as_read:
        yield (
            f"the phase is {as_read:.2g} rad (rms) off what the magnitudes call for, and {apart[slip]:.2g} rad with "
            f"another reading: {slip}"
        )


def _apart_rad(frequency_hz: FloatArray, least: FloatArray, phase: FloatArray) -> float:
    """Return the rms by which a phase departs from that of least lag, of either sign and with any dead time.

    Phases are compared within a turn: between sparse points a wrapped one turns by more than half of that.
    """
    apart = np.exp(1j * (phase - least))
    last, step = float(frequency_hz[-1]), float(np.min(np.diff(frequency_hz)))
    delays = np.arange(0.0, min(1.0 / step, _MOST_DELAYS / last), _DELAY_STEP / last)
    best = np.inf
    for some in np.array_split(delays, 1 + delays.size // 500):
        turned = apart * np.exp(2j * np.pi * some[:, None] * frequency_hz)
        for sign in (1.0, -1.0):
            best = min(best, float(np.min(np.mean(np.angle(sign * turned) ** 2, axis=1))))
    return float(np.sqrt(best))


_DELAY_STEP, _MOST_DELAYS = 0.02, 100.0
"""Dead times that are tried, in periods of the last frequency: their distance (0.06 rad off at most), and the last."""


def doubtful(display: Display) -> Iterator[Finding]:
    """Yield a finding for each figure of a display that can hardly be, and for a plant that is not to be trusted."""
    for channel in display.channels:
        for doubt in channel_doubts(channel, display.rate_hz):
            check = doubt.expected
            outcome = Outcome.NOT_MET if check.impossible else Outcome.NOT_JUDGED
            yield Finding(
                "numbers", channel.name, "none", outcome, check.what, doubt.value, doubt.bound, check.unit,
                remark=f"{check.what} is {doubt.value:.3g} {check.unit}".rstrip() + f": {doubt.slip}?",
            )  # fmt: skip
        for reason in channel.recorded.distrust if channel.recorded is not None else ():
            yield Finding(
                "numbers", channel.name, "none", Outcome.NOT_MET, "the plant is not to be trusted", remark=reason
            )
