"""Noise of hum, converters and loop resonance as a finger at rest feels it: the command through the plant's model.

Hum and noise n of the sensor reach the fingertip as -T n and the sensor's own reading as S n: the reading is not what
is felt. The command is (design.md, facts): what it does to the fingertip is the plant's response to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.measure.error import unread
from tactuator.measure.options import LISTENED_S, MAINS_HZ
from tactuator.model.controller import AntiWindup, ChannelController, Controller, Limits
from tactuator.model.description import Channel, Display
from tactuator.model.plant import DERIVATIVES
from tactuator.model.plausibility import doubtful
from tactuator.model.verdict import FELT_HUM, FELT_NOISE, Finding, Outcome, Verdict, compared, verdict_of
from tactuator.perception.curve import FELT_BAND_HZ
from tactuator.plain import brief
from tactuator.rig.rig import Rig, require_sensors
from tactuator.signals.decibels import db, from_db
from tactuator.signals.discretise import discretise
from tactuator.signals.loop import FeedbackLoop
from tactuator.signals.spectra import (
    Band,
    PowerSpectrum,
    lock_in,
    mains_multiples,
    mean_over_frequency,
    power_spectrum,
    third_octave_bands,
)
from tactuator.signals.systems import ContinuousSystem
from tactuator.synthesis.family import UNLOADED, plant_family
from tactuator.synthesis.felt import beside_friction
from tactuator.synthesis.objectives import NO_LOOP, NOISE_REMEDY, hum_remedy

_SEEN = 4.0
"""A line counts from this many standard errors on."""


@dataclass(frozen=True, eq=False)
class SensorNoise:
    """Hum and noise of a sensor.

    hum_hz, hum_v_peak (k,): the visible mains lines, volts peak. noise_v_rms: white, converter's steps taken
    out.
    """

    hum_hz: FloatArray
    hum_v_peak: FloatArray
    noise_v_rms: float

    __repr__ = brief

    def keys(self) -> dict[str, Any]:
        """Return the figures as keys of [environment]."""
        return {key: np.asarray(value).tolist() for key, value in vars(self).items()}

    def environment(self) -> str:
        """Return the keys of [environment] that say so, as a display file has them."""
        lines = ", ".join(f"{hertz:g}" for hertz in self.hum_hz)
        levels = ", ".join(f"{volts:.3g}" for volts in self.hum_v_peak)
        return f"hum_hz = [{lines}], hum_v_peak = [{levels}], noise_v_rms = {self.noise_v_rms:.3g}"


def sensor_noise(
    position_v: FloatArray,
    command_v: FloatArray,
    rate_hz: float,
    channel: Channel,
    plant: ContinuousSystem,
    mains_hz: float | None = MAINS_HZ,
) -> SensorNoise:
    """Return what the sensor adds to a display at rest.

    position_v, command_v: (n,), of one trace, volts at the sensor and of the command; plant: from one to the other.
    """
    spectrum = power_spectrum(position_v, rate_hz, 1.0)
    # of the rate: where the density of the noise is read, above hum and motion
    low, high = (share * rate_hz for share in (0.25, 0.45))
    quiet = (spectrum.frequency_hz > low) & (spectrum.frequency_hz < high)
    power = float(np.median(spectrum.density[quiet])) * 0.5 * rate_hz
    noise_v_rms = float(np.sqrt(max(power - channel.converter.step_v**2 / 12.0, 0.0)))
    lines = mains_multiples(mains_hz, min(channel.threshold.band_hz[1], 0.45 * rate_hz))
    if lines.size == 0:
        return SensorNoise(lines, lines, noise_v_rms)
    still = np.zeros(lines.shape)
    moved = beside_friction(channel.environment, discretise(plant, rate_hz, "zoh").response(lines), still)
    hum = np.abs(lock_in(position_v, lines, rate_hz) - moved * lock_in(command_v, lines, rate_hz))
    seen = hum > _SEEN * np.sqrt(2.0 * power / position_v.size)
    return SensorNoise(lines[seen], hum[seen], noise_v_rms)


def proportional_controller(display: Display, gain: float) -> Controller:
    """Return the controller u = gain (v - y) on every channel of `display`, v the threshold voltage of the lowest
    frequency times r.

    gain: volts of command per volt of y, positive.
    """
    if not (np.isfinite(gain) and gain > 0.0):
        raise BadInput(f"proportional gain is {gain:g}", "a positive number")
    through = np.array([[1.0, 0.0, 0.0, 1.0, 0.0, 0.0]])
    channels = []
    for channel in display.channels:
        voltage = float(channel.threshold_voltage(channel.threshold.band_hz[0]))
        probe = ChannelController(
            name=channel.name,
            threshold_voltage_dc=voltage,
            prefilter_sos=through * np.array([voltage, 1.0, 1.0, 1.0, 1.0, 1.0]),
            feedback_sos=through * np.array([gain, 1.0, 1.0, 1.0, 1.0, 1.0]),
            anti_windup=AntiWindup(),
            limits=Limits(channel.converter.range_v, channel.sensor_gain_v_per_mm * channel.travel_mm),
            designed_for=(),
            report={"proportional_gain": gain},
        )
        channels.append(probe)
    return Controller(display, tuple(channels), "proportional probe")


def unstable_channels(controller: Controller, load: str = "none") -> tuple[str, ...]:
    """Return the channels whose loop the display's own models call unstable, without a load or under `load`: loops
    that must not be closed."""
    display = controller.display
    unstable = []
    for channel, designed in zip(display.channels, controller.channels, strict=True):
        feedback = designed.feedback(display.rate_hz)
        members = plant_family(channel, display.rate_hz, display.delay_samples) if feedback is not None else ()
        plants = [member.sampled for member in members if member.load in (UNLOADED, load)]
        if feedback is not None and not all(FeedbackLoop(feedback, plant).is_stable for plant in plants):
            unstable.append(channel.name)
    return tuple(unstable)


@dataclass(frozen=True)
class FeltNoise:
    """Felt levels of one channel at rest, in dB SL: 0 is threshold.

    line_hz (k,), line_db_sl: mains and its multiples. band_hz (b,), band_db_sl: third octaves, lines left out; the
    level of a band is that of a sinusoid at its centre with the same power. resonance_hz, resonance_db_sl: the loop's
    resonance, None where the felt spectrum has no peak. resonance_gain_db: that peak over the felt density below it.
    saturated: a converter or limit was reached. sensor: hum and noise of the sensor alone; None: not separated.
    line_moved_db_sl, band_moved_db_sl: what they are if what the sensor does not explain is motion.
    """

    channel: str
    load: str
    line_hz: FloatArray
    line_db_sl: FloatArray
    line_moved_db_sl: FloatArray
    band_hz: FloatArray
    band_db_sl: FloatArray
    band_moved_db_sl: FloatArray
    resonance_hz: float | None
    resonance_db_sl: float | None
    resonance_gain_db: float | None
    saturated: bool
    sensor: SensorNoise | None = None

    __repr__ = brief

    @property
    def worst_line_db_sl(self) -> float:
        """Return the highest level of a mains line: the paper's objective ii asks for less than 0."""
        return float(np.max(self.line_db_sl, initial=-np.inf))

    @property
    def worst_noise_db_sl(self) -> float:
        """Return the highest level of a third octave or of the resonance; the paper asks for less than 0."""
        return max(float(np.max(self.band_db_sl, initial=-np.inf)), self.resonance_db_sl or -np.inf)


def felt_noise(
    rig: Rig,
    display: Display,
    *,
    duration_s: float = LISTENED_S,
    settle_s: float = 2.0,
    load: str | None = None,
    mains_hz: float | None = MAINS_HZ,
) -> tuple[FeltNoise, ...]:
    """Let the loaded controller hold the display at rest for duration_s, under `load`; say what would be felt on each
    channel by its plant. At least 3 s, for a resolution of 1 Hz.
    """
    if duration_s < 3.0:
        raise BadInput(f"duration {duration_s:g} s", "3 s or more")
    channels = [display.channel(name) for name in rig.channels]
    require_sensors(rig, rig.channels)
    silent = np.zeros((round((settle_s + duration_s) * rig.rate_hz), len(rig.channels)))
    trace = rig.play(silent)
    start = round(settle_s * rig.rate_hz)
    measured = []
    for name, channel in zip(rig.channels, channels, strict=True):
        plant = channel.loaded_plant(None if load in (None, "none") else channel.load(str(load)))
        column = trace.channel(name)
        command, position = trace.command_v[start:, column], trace.position_v[start:, column]
        sensor = sensor_noise(position, command, rig.rate_hz, channel, plant, mains_hz)
        felt = felt_of_command(command, rig.rate_hz, channel, plant, mains_hz)
        saturated = bool(np.any(trace.saturated[start:, column]))
        felt = replace(felt, load=load or "none", saturated=saturated, sensor=sensor)
        measured.append(_as_motion(felt, (position, command), rig.rate_hz, channel, plant))
    return tuple(measured)


def felt_of_command(
    command_v: FloatArray,
    rate_hz: float,
    channel: Channel,
    plant: ContinuousSystem,
    mains_hz: float | None = MAINS_HZ,
) -> FeltNoise:
    """Return the noise that `command_v` (n,) makes a finger feel through `plant` (volts of command to volts of y)."""
    lines = mains_multiples(mains_hz, min(channel.threshold.band_hz[1], 0.45 * rate_hz))
    amplitudes = np.array([lock_in(command_v, line, rate_hz)[0] for line in lines])
    peaks_mm = np.abs(amplitudes) * np.abs(_displacement_mm(channel, plant, lines, rate_hz))
    spectrum = power_spectrum(command_v, rate_hz, 1.0)
    felt = spectrum.through(_displacement_mm(channel, plant, spectrum.frequency_hz, rate_hz))
    bands = _bands(channel)
    line_levels = db(peaks_mm / channel.threshold.curve.displacement_mm(lines))
    band_levels = np.array([_band_level(felt, band.low_hz, band.high_hz, channel, lines) for band in bands])
    resonance_hz, resonance_db_sl, resonance_gain_db = _resonance(felt, channel, lines) or (None, None, None)
    return FeltNoise(
        channel=channel.name,
        load="none",
        line_hz=lines,
        line_db_sl=line_levels,
        line_moved_db_sl=line_levels,
        band_hz=np.array([band.centre_hz for band in bands]),
        band_db_sl=band_levels,
        band_moved_db_sl=band_levels,
        resonance_hz=resonance_hz,
        resonance_db_sl=resonance_db_sl,
        resonance_gain_db=resonance_gain_db,
        saturated=False,
    )


_AS_STATED_DB, _DEVIATIONS = 2.0, 2.0
"""How near a line's hum is to the display's; standard errors by which a band's power passes that of the noise."""


def _as_motion(
    felt: FeltNoise, trace: tuple[FloatArray, FloatArray], rate_hz: float, channel: Channel, plant: ContinuousSystem
) -> FeltNoise:
    """Return the noise with the levels that there are if what the sensor does not explain is motion, as it shows it.

    Hum at the display's level explains a line; white noise at the level above the band explains a band. Whatever else
    is in the reading, besides the command's motion, entered before the plant or after it; a loop cannot show which.
    """
    (position_v, command_v), known, sensor = trace, channel.environment, felt.sensor
    assert sensor is not None
    stated = dict(zip(known.hum_hz, known.hum_v_peak, strict=True))
    lines, bands = felt.line_moved_db_sl.copy(), felt.band_moved_db_sl.copy()
    for hertz, hum_v in zip(sensor.hum_hz, sensor.hum_v_peak, strict=True):
        if abs(float(db(hum_v / max(stated.get(hertz, 0.0), 1e-12)))) > _AS_STATED_DB:
            shown_v = np.abs(lock_in(position_v, hertz, rate_hz)[0])
            lines[felt.line_hz == hertz] = db(shown_v / channel.threshold_voltage(hertz))
    frequency = np.maximum(np.fft.rfftfreq(position_v.size, 1.0 / rate_hz), 1e-3)
    held = beside_friction(known, discretise(plant, rate_hz, "zoh").response(frequency), np.zeros(1))
    moved_v = np.fft.irfft(np.fft.rfft(command_v) * held, position_v.size)
    beside, reading = (power_spectrum(values, rate_hz, 1.0) for values in (position_v - moved_v, position_v))
    white = (sensor.noise_v_rms**2 + channel.converter.step_v**2 / 12.0) / (0.5 * rate_hz)
    for place, band in enumerate(_bands(channel)):
        edges, width = (band.low_hz, band.high_hz, felt.line_hz), band.high_hz - band.low_hz
        explained = white * width * (1.0 + _DEVIATIONS / np.sqrt(width * position_v.size / rate_hz))
        share = max(0.0, 1.0 - explained / max(beside.power(*edges), 1e-300))
        shown = 2.0 * reading.power(*edges) / channel.threshold_voltage(band.centre_hz) ** 2
        bands[place] = db(np.sqrt(share * shown + (1.0 - share) * from_db(bands[place]) ** 2))
    return replace(felt, line_moved_db_sl=lines, band_moved_db_sl=bands)


def _bands(channel: Channel) -> tuple[Band, ...]:
    low, high = channel.threshold.band_hz
    return third_octave_bands(max(low, FELT_BAND_HZ[0]), high)


def _displacement_mm(
    channel: Channel, plant: ContinuousSystem, frequency_hz: FloatArray, rate_hz: float
) -> NDArray[np.complex128]:
    """Return the millimetres of fingertip per volt of command, held between samples, for motions within presliding;
    nothing at zero frequency, which nobody feels."""
    frequency = np.maximum(frequency_hz, 1e-3)
    omega = 2j * np.pi * frequency
    hold = np.sinc(frequency / rate_hz)
    still = np.zeros(frequency.shape)  # at rest, motion stays within the presliding distance
    moved = beside_friction(channel.environment, plant.response(frequency) * hold, still)
    response = moved / (channel.sensor_gain_v_per_mm * omega ** DERIVATIVES[channel.quantity])
    return np.where(frequency_hz > 0.0, response, 0.0)


def _band_level(felt: PowerSpectrum, low: float, high: float, channel: Channel, lines: FloatArray) -> float:
    peak_mm = np.sqrt(2.0 * felt.power(low, high, lines))
    return float(db(peak_mm / channel.threshold.curve.displacement_mm(np.sqrt(low * high))))


def _resonance(felt: PowerSpectrum, channel: Channel, lines: FloatArray) -> tuple[float, float, float] | None:
    """Return frequency, level and prominence of the felt density's highest peak, lines bridged; None below 3 dB."""
    inside = (felt.frequency_hz >= FELT_BAND_HZ[0]) & (felt.frequency_hz <= channel.threshold.band_hz[1])
    clear = np.min(np.abs(felt.frequency_hz[:, None] - lines), axis=1, initial=np.inf) > 2.5
    frequency = felt.frequency_hz[inside]
    density = np.interp(frequency, felt.frequency_hz[inside & clear], felt.density[inside & clear])
    # share of a frequency that makes a twelfth of an octave
    smooth = mean_over_frequency(
        np.log(np.maximum(density, 1e-300)), frequency, frequency, 2.0 ** (1.0 / 12.0) - 1.0, fewest=5
    )
    peak = int(np.argmax(smooth))
    if peak in (0, smooth.size - 1):
        return None
    below = frequency < 0.5 * frequency[peak]
    floor = np.median(smooth[below]) if np.any(below) else smooth[0]
    prominence = 10.0 / np.log(10.0) * float(smooth[peak] - floor)
    if prominence < 3.0:
        return None
    edge = 2.0 ** (1.0 / 6.0)
    level = _band_level(felt, frequency[peak] / edge, frequency[peak] * edge, channel, lines)
    return float(frequency[peak]), level, prominence


def noise_verdict(felt: Sequence[FeltNoise], display: Display, open_loops: Sequence[str] = ()) -> Verdict:
    """Return the measured noise of the designed loop as a verdict on objectives ii and iii.

    open_loops: channels without a loop, where nothing carries the sensor noise to the finger: not judged.
    """
    allowed = display.objectives
    findings: list[Finding] = []
    for noise in felt:
        if noise.channel in open_loops:
            for number, quantity in (("ii", FELT_HUM), ("iii", FELT_NOISE)):
                remark = NO_LOOP
                findings.append(Finding(number, noise.channel, noise.load, Outcome.NOT_JUDGED, quantity, remark=remark))
            continue
        judged = noise.channel, noise.load
        for line, *levels in zip(noise.line_hz.tolist(), noise.line_db_sl, noise.line_moved_db_sl, strict=True):
            figure = *judged, FELT_HUM, allowed.mains_max_db_sl, line
            findings.append(_compared("ii", *figure, hum_remedy(line), levels))
        if noise.line_hz.size == 0:
            remark = "no mains line was measured"
            findings.append(Finding("ii", *judged, Outcome.NOT_JUDGED, FELT_HUM, remark=remark))
        both, most = np.array([noise.band_db_sl, noise.band_moved_db_sl]), allowed.noise_max_db_sl
        worst = int(np.argmax(both.min(axis=0) if both.min(axis=0).max() > most else both.max(axis=0)))
        levels, at = both[:, worst].tolist(), float(noise.band_hz[worst])
        if noise.resonance_hz is not None and (noise.resonance_db_sl or 0.0) > max(levels):
            levels, at = [noise.resonance_db_sl] * 2, noise.resonance_hz
        findings.append(_compared("iii", *judged, FELT_NOISE, most, at, NOISE_REMEDY, levels))
    assumed = () if len(open_loops) == len(felt) else (_OF_THE_SENSOR,)
    return verdict_of([*findings, *doubtful(display)], assumed, display.channels)


_TELLS = "measure with a vibrometer, or for hum set hum_v_peak from the sensor with the amplifier off"
_OF_THE_SENSOR = "white noise, and hum as loud as hum_v_peak, are of the sensor and stay with the amplifier off"


def _compared(
    number: str, channel: str, load: str, quantity: str, most: float, at_hz: float, remedy: str, levels: list[float]
) -> Finding:
    """Return the finding on a level, dB SL, if the noise is of the sensor, and if it moves the finger."""
    sensed, moved = levels
    low, high = sorted(levels)
    figure = high if low <= most else low, most, "dB SL"
    finding = unread(compared(number, channel, load, quantity, *figure, at_hz, remedy=remedy))
    if not low <= most < high:
        return finding
    remark = f"{sensed:.1f} dB SL if it comes in at the sensor, {moved:.1f} if at the motor: {_TELLS}"
    return replace(finding, outcome=Outcome.NOT_JUDGED, remark=remark)
