"""A clip onto a display: what it asks for in dB SL by a stated map, the reference that the display can play of it, and
what is lost.

A clip has no unit. The map says what its numbers mean: the level of strength 1, whether strength is an amplitude or a
share of that level, which frequencies the pitches 0 and 1 are, and what a tap is. The display's limiter then takes back
what the display cannot do; that, and pitches beyond the display's band, is the loss.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
import scipy
from pydantic import AfterValidator, Field

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.reference import ReferenceHead, curves_of
from tactuator.measure.error import ChannelPrediction
from tactuator.model.controller import Controller
from tactuator.parameters import Number, Positive, Wording, plain, table
from tactuator.patterns.android import FrequencyProfile
from tactuator.patterns.clip import Clip, Format, Tap, Tone
from tactuator.patterns.hjif import TRANSIENT_S
from tactuator.perception.curve import COMFORT_DB_SL, FREQUENCY_JND, check_level
from tactuator.signals.decibels import db, from_db
from tactuator.signals.excitation import ramps
from tactuator.speech.limiter import Limiter
from tactuator.speech.options import LEVEL_DB_SL
from tactuator.table import brief

SLICE_S = 0.01
"""Length of the slices of time in which a loss is told."""
_RAMP_S = 0.005
_HEARD_DB = 0.05
"""Reductions of less are none."""


Shape = Literal["sine", "square", "triangle", "saw"]
SHAPES: Mapping[str, float] = {"sine": 1.0, "square": 4.0 / np.pi, "triangle": 8.0 / np.pi**2, "saw": 2.0 / np.pi}
"""Amplitude of the fundamental of a wave of amplitude 1 (Fourier series)."""


def _not_descending(ends: tuple[float, float]) -> tuple[float, float]:
    if ends[0] > ends[1]:
        raise BadInput(f"[{ends[0]:g}, {ends[1]:g}]", "0 < low <= high")
    return ends


_Ends = Annotated[tuple[Positive, Positive], AfterValidator(_not_descending), Wording("two frequencies, low <= high")]


@table("pattern map")
class PatternMap:
    """What the numbers of a clip stand for on the device that it was made for."""

    full_db_sl: Annotated[Positive, Field(le=COMFORT_DB_SL, description="level of strength 1")] = LEVEL_DB_SL
    strength: Annotated[
        Literal["amplitude", "level"], Field(description="a share of the amplitude, or of the level in dB SL")
    ] = "amplitude"
    band_hz: Annotated[_Ends, Field(description="frequencies of pitch 0 and pitch 1")] = (55.0, 200.0)
    gain: Annotated[Number, Field(ge=0.0, le=1.0, description="factor of the amplitude of tones")] = 1.0
    tap_hz: Annotated[_Ends, Field(description="frequencies of a tap of pitch 0 and of pitch 1")] = (55.0, 165.0)
    tap_s: Annotated[tuple[Positive, Positive], Field(description="durations of a tap of pitch 0 and of pitch 1")] = (
        0.0364,
        0.0121,
    )
    tap_gain: Annotated[Number, Field(ge=0.0, le=1.0, description="factor of the amplitude of taps")] = 1.0
    tap_fade: Annotated[Number, Field(ge=0.0, le=1.0, description="share of a tap that is gone at its end")] = 0.0
    tap_shape: Annotated[
        tuple[Shape, Shape],
        Field(description="waves of a tap of pitch 0 and of 1; their fundamental is rendered"),
    ] = ("sine", "sine")
    ducking: Annotated[Number, Field(ge=0.0, le=1.0, description="share by which tones are weakened during a tap")] = (
        0.5
    )
    profile: FrequencyProfile | None = None

    def amplitude(self, strength: FloatArray, frequency_hz: FloatArray) -> FloatArray:
        """Return amplitudes in threshold units for strengths of 0 to 1 at frequencies (Hz); 0 is silence.

        With a frequency profile, strength 1 is what the device reaches at each frequency.
        """
        full_db = self.full_db_sl if self.profile is None else self.profile.headroom_db_sl(frequency_hz)
        if self.strength == "amplitude":
            return np.asarray(from_db(full_db) * strength)
        return np.where(strength > 0.0, from_db(self.full_db_sl * strength), 0.0)

    def tap_amplitude(self, tap: Tap, frequency_hz: float) -> float:
        """Return the amplitude in threshold units of a tap's fundamental."""
        first, last = (SHAPES[shape] for shape in self.tap_shape)
        share = self.tap_gain * (first + (last - first) * tap.pitch)
        return share * float(self.amplitude(np.array(tap.strength), np.array(frequency_hz)))


MAPS: Mapping[Format, PatternMap] = {
    "haptic": PatternMap(),
    "ahap": PatternMap(band_hz=(65.0, 300.0)),
    "android-basic": PatternMap(strength="level", band_hz=(65.0, 300.0)),
    "android-advanced": PatternMap(),
    "hjif": PatternMap(tap_hz=(1.0 / 0.011, 1.0 / 0.011), tap_s=(TRANSIENT_S, TRANSIENT_S), ducking=0.0),
}
"""The map of each format's reference device: Quest controllers for .haptic (its ACF), the range of MPEG's encoder for
AHAP and for Android's sharpness, the reference software's transient for HJIF. Android takes intensity as a share of the
greatest sensation level."""


def android_map(profile: FrequencyProfile, format: Format) -> PatternMap:
    """Return what Android 16 makes of an envelope on a device: of a basic one by its level, of an advanced one by the
    greatest acceleration. Raises BadInput for a device that does not reach 10 dB SL, or goes beyond comfort.
    """
    check_level(profile.full_db_sl)
    if format == "android-basic":
        return PatternMap(full_db_sl=profile.full_db_sl, strength="level", band_hz=profile.band_hz)
    return PatternMap(profile=profile)


@dataclass(frozen=True, eq=False)
class Loss:
    """What a display does not give of a clip, over all of its channels.

    time_s, asked_db_sl, delivered_db_sl, felt_db_sl: of slices of 10 ms, the greatest of each, (n,), NaN where nothing
    above threshold is asked; felt is what the delivered becomes by the controller's model. shortfall_db_sl: the
    greatest difference; mean_shortfall_db: over slices above threshold. clipped_s: time in which the display's limits
    take something back. frequency_shift_jnd: the greatest shift of a pitch into the display's band, in just noticeable
    differences of frequency. emphasis_rise_db: what the taps rise above the tones about them, asked and delivered, on
    average; None without taps.
    """

    time_s: FloatArray = field(repr=False)
    asked_db_sl: FloatArray = field(repr=False)
    delivered_db_sl: FloatArray = field(repr=False)
    felt_db_sl: FloatArray = field(repr=False)
    shortfall_db_sl: float
    mean_shortfall_db: float
    clipped_s: float
    frequency_shift_jnd: float
    emphasis_rise_db: tuple[float, float] | None

    __repr__ = brief

    def document(self) -> dict[str, Any]:
        """Return the figures, without the courses of time."""
        names = ("shortfall_db_sl", "mean_shortfall_db", "clipped_s", "frequency_shift_jnd", "emphasis_rise_db")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True, eq=False)
class RenderedClip:
    """A clip as a reference. reference: (n, channels), threshold units. map: what its numbers were taken for."""

    clip: Clip
    map: PatternMap
    head: ReferenceHead
    reference: FloatArray
    loss: Loss

    __repr__ = brief


def render_clip(clip: Clip, controller: Controller, mapping: PatternMap | None = None) -> RenderedClip:
    """Return the reference of a clip on every channel of a controller's display, and its loss.

    mapping: None for that of the format's reference device. Raises BadInput for a level that is not below comfort.
    """
    mapping = MAPS[clip.format] if mapping is None else mapping
    check_level(mapping.full_db_sl)
    rate_hz, channels = controller.rate_hz, controller.display.channels
    lows, highs = zip(*(channel.threshold.band_hz for channel in channels), strict=True)
    signal = clip_wave(clip, mapping, rate_hz, (max(lows), min(highs)))
    asked = np.repeat(signal.wave[:, None], len(channels), axis=1)
    limiter = Limiter(controller)
    delivered = np.concatenate([block.copy() for block in limiter.process(iter([asked]))])[: len(asked)]
    head = ReferenceHead(
        rate_hz=rate_hz,
        channels=tuple(channel.name for channel in channels),
        curves=curves_of(channels),
        band_hz=(min(lows), max(highs)),
        provenance={"clip": clip.name, "format": clip.format, "map": plain(mapping)},
    )
    return RenderedClip(clip, mapping, head, delivered, loss_of(asked, delivered, controller, signal))


@dataclass(frozen=True, eq=False)
class ClipWave:
    """A clip as a signal in threshold units, (n,): tones and taps together. tones: those alone. taps: where each tap
    stands. shift_jnd: by how much the farthest pitch was moved into the band.
    """

    wave: FloatArray
    tones: FloatArray
    taps: tuple[slice, ...]
    shift_jnd: float

    __repr__ = brief


def clip_wave(clip: Clip, mapping: PatternMap, rate_hz: float, band_hz: tuple[float, float]) -> ClipWave:
    """Return the signal that a clip asks for by a map, with its pitches moved into the band (Hz)."""
    count = round((clip.duration_s + max(mapping.tap_s)) * rate_hz) + 1
    duck, tones, taps, shifts, rises = np.ones(count), np.zeros(count), np.zeros(count), [0.0], []
    for tap in clip.taps:
        duck[_slice(tap.time_s, tap.time_s + _tap_s(tap, mapping), rate_hz)] = 1.0 - mapping.ducking
        rises.append(_add_tap(tap, mapping, taps, rate_hz, band_hz, shifts))
    for tone in clip.tones:
        _add_tone(tone, clip, mapping, tones, rate_hz, band_hz, shifts)
    tones *= duck
    return ClipWave(tones + taps, tones, tuple(rises), max(shifts))


def _moved(frequency_hz: FloatArray, band: tuple[float, float], shifts: list[float], loud: Any) -> FloatArray:
    """Return frequencies within the band, and add to `shifts` how far the farthest was moved, in JNDs.

    loud: where there is something to move, (n,).
    """
    inside = np.clip(frequency_hz, *band)
    moved = np.abs(np.log(inside[loud] / np.maximum(frequency_hz[loud], 1e-3)))
    shifts.append(float(np.max(moved, initial=0.0) / np.log1p(FREQUENCY_JND)))
    return inside


def _slice(start_s: float, end_s: float, rate_hz: float) -> slice:
    """Return the samples from a time to another, both with them."""
    return slice(math.ceil(start_s * rate_hz - 1e-9), math.floor(end_s * rate_hz + 1e-9) + 1)


def _add_tone(
    tone: Tone, clip: Clip, mapping: PatternMap, wave: FloatArray, rate_hz: float, band: tuple[float, float],
    shifts: list[float],
) -> None:  # fmt: skip
    """Add a tone to the wave (n,), with ramps of 5 ms where it begins or ends loud."""
    place = _slice(tone.start_s, tone.end_s, rate_hz)
    at = np.arange(place.start, min(place.stop, wave.size)) / rate_hz
    low, high = mapping.band_hz
    pitch = tone.pitch.at(at)
    wished = pitch if clip.pitch_in_hz else low + (high - low) * pitch
    strength = tone.strength.at(at)
    frequency = _moved(wished, band, shifts, strength > 0.0)
    ramp_s = min(_RAMP_S, 0.5 * at.size / rate_hz - 1.0 / rate_hz)
    amplitude = mapping.gain * mapping.amplitude(strength, wished) * ramps(at.size, rate_hz, max(ramp_s, 0.0))
    wave[place] += amplitude * np.sin(2.0 * np.pi * np.cumsum(frequency) / rate_hz)


def _tap_s(tap: Tap, mapping: PatternMap) -> float:
    first, last = mapping.tap_s
    return first + (last - first) * tap.pitch


def _add_tap(
    tap: Tap, mapping: PatternMap, wave: FloatArray, rate_hz: float, band: tuple[float, float], shifts: list[float]
) -> slice:
    """Add a tap to the wave, and return where it stands: whole periods of a sinusoid."""
    low, high = mapping.tap_hz
    wished = low + (high - low) * tap.pitch
    frequency = float(_moved(np.array([wished]), band, shifts, np.array([tap.strength > 0.0]))[0])
    periods = max(1, round(_tap_s(tap, mapping) * frequency))
    start, count = round(tap.time_s * rate_hz), max(1, round(periods / frequency * rate_hz))
    place = slice(start, min(start + count, wave.size))
    at = np.arange(place.stop - place.start) / rate_hz
    fading = 1.0 - mapping.tap_fade * np.arange(at.size) / count
    wave[place] += mapping.tap_amplitude(tap, wished) * fading * np.sin(2.0 * np.pi * frequency * at)
    return place


def _felt(delivered: FloatArray, controller: Controller) -> FloatArray:
    """Return what is felt of a reference (n, channels) by the controller's model, untouched, in threshold units."""
    size = scipy.fft.next_fast_len(len(delivered) + round(controller.rate_hz))
    hertz = scipy.fft.rfftfreq(size, 1.0 / controller.rate_hz)
    names = [channel.name for channel in controller.display.channels]
    answers = np.stack([ChannelPrediction.of(controller, name).felt(hertz) for name in names], axis=1)
    spectrum = scipy.fft.rfft(delivered, size, axis=0) * answers
    return np.asarray(scipy.fft.irfft(spectrum, size, axis=0)[: len(delivered)])


def loss_of(asked: FloatArray, delivered: FloatArray, controller: Controller, signal: ClipWave) -> Loss:
    """Return what is lost between what was asked for and what the display delivers, (n, channels), threshold units."""
    rate_hz, felt_wave = controller.rate_hz, _felt(delivered, controller)
    step = max(1, round(SLICE_S * rate_hz))
    starts = np.arange(0, len(asked), step)
    want, got, felt_peak = (np.maximum.reduceat(np.abs(wave), starts).T for wave in (asked, delivered, felt_wave))
    with np.errstate(divide="ignore", invalid="ignore"):
        wanted, given = 20.0 * np.log10(want), 20.0 * np.log10(got)
        missing = np.where(wanted >= 0.0, wanted - np.maximum(given, 0.0), np.nan)
    felt = np.isfinite(missing)
    lost = np.where(felt, np.maximum(missing, 0.0), 0.0)
    worst, columns = np.argmax(lost, axis=0), np.arange(starts.size)
    felt_at = felt[worst, columns]
    clipped = np.any(lost > _HEARD_DB, axis=0)
    return Loss(
        time_s=starts / rate_hz,
        asked_db_sl=np.where(felt_at, wanted[worst, columns], np.nan),
        delivered_db_sl=np.where(felt_at, given[worst, columns], np.nan),
        felt_db_sl=np.where(felt_at, db(np.maximum(felt_peak[worst, columns], 1e-3)), np.nan),
        shortfall_db_sl=float(lost.max(initial=0.0)),
        mean_shortfall_db=float(lost[felt].mean()) if felt.any() else 0.0,
        clipped_s=float(clipped.sum() * step / rate_hz),
        frequency_shift_jnd=signal.shift_jnd,
        emphasis_rise_db=_rise(asked, delivered, signal) if signal.taps else None,
    )


def _rise(asked: FloatArray, delivered: FloatArray, signal: ClipWave) -> tuple[float, float]:
    """Return by how much the taps' peaks rise above the tones beneath them, or above threshold, asked and delivered."""
    levels = []
    for tap in signal.taps:
        beneath = max(1.0, float(np.abs(signal.tones[tap]).max(initial=0.0)))
        peaks = [max(1.0, float(np.abs(wave[tap]).max(axis=0).min())) for wave in (asked, delivered)]
        levels.append([20.0 * np.log10(peak / beneath) for peak in peaks])
    first, second = np.mean(levels, axis=0)
    return float(first), float(second)
