"""A clip onto a display: what it asks for in dB SL by a stated map, the reference that the display can play of it, and
what is lost.

A clip has no unit. The map says what its numbers mean: the level of strength 1, whether strength is an amplitude or a
share of that level, which frequencies the pitches 0 and 1 are, and what a tap is. The display's limiter then takes back
what the display cannot do; that, and pitches beyond the display's band, is the loss.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from tactuator.arrays import FloatArray
from tactuator.io.reference import ReferenceHead, curves_of
from tactuator.model.controller import Controller
from tactuator.parameters import Band, Number, Positive, table
from tactuator.patterns.clip import Clip, Format, Tap, Tone
from tactuator.perception.curve import COMFORT_DB_SL, FREQUENCY_JND, check_level
from tactuator.signals.excitation import ramps
from tactuator.speech.limiter import Limiter
from tactuator.speech.options import LEVEL_DB_SL
from tactuator.table import brief

SLICE_S = 0.01
"""Length of the slices of time in which a loss is told."""
_RAMP_S = 0.005
_HEARD_DB = 0.05
"""Reductions of less are none."""


@table("pattern map")
class PatternMap:
    """What the numbers of a clip stand for on the device that it was made for."""

    full_db_sl: Annotated[Positive, Field(le=COMFORT_DB_SL, description="level of strength 1")] = LEVEL_DB_SL
    strength: Annotated[
        Literal["amplitude", "level"], Field(description="a share of the amplitude, or of the level in dB SL")
    ] = "amplitude"
    band_hz: Annotated[Band, Field(description="frequencies of pitch 0 and pitch 1")] = (55.0, 200.0)
    tap_hz: Annotated[Band, Field(description="frequencies of a tap of pitch 0 and of pitch 1")] = (55.0, 165.0)
    tap_s: Annotated[tuple[Positive, Positive], Field(description="durations of a tap of pitch 0 and of pitch 1")] = (
        0.0364,
        0.0121,
    )
    ducking: Annotated[Number, Field(ge=0.0, le=1.0, description="share by which tones are weakened during a tap")] = (
        0.5
    )

    def amplitude(self, strength: FloatArray) -> FloatArray:
        """Return amplitudes in threshold units for strengths of 0 to 1; 0 is silence."""
        if self.strength == "amplitude":
            return np.asarray(10.0 ** (self.full_db_sl / 20.0) * strength)
        return np.where(strength > 0.0, 10.0 ** (self.full_db_sl * strength / 20.0), 0.0)


MAPS: Mapping[Format, PatternMap] = {
    "haptic": PatternMap(),
    "ahap": PatternMap(band_hz=(65.0, 300.0)),
    "android-basic": PatternMap(strength="level", band_hz=(65.0, 300.0)),
    "android-advanced": PatternMap(),
}
"""The map of each format's reference device: Quest controllers for .haptic (its ACF), the range of MPEG's encoder for
AHAP and for Android's sharpness. Android takes intensity as a share of the greatest sensation level."""


@dataclass(frozen=True, eq=False)
class Loss:
    """What a display does not give of a clip, over all of its channels.

    time_s, asked_db_sl, delivered_db_sl: of slices of 10 ms, the greatest of each, (n,), NaN where nothing above
    threshold is asked. shortfall_db_sl: the greatest difference; mean_shortfall_db: over slices above threshold.
    clipped_s: time in which the display's limits take something back. frequency_shift_jnd: the greatest shift of a
    pitch into the display's band, in just noticeable differences of frequency. emphasis_rise_db: what the taps rise
    above the tones about them, asked and delivered, on average; None without taps.
    """

    time_s: FloatArray = field(repr=False)
    asked_db_sl: FloatArray = field(repr=False)
    delivered_db_sl: FloatArray = field(repr=False)
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
    band = max(lows), min(highs)
    count = round((clip.duration_s + mapping.tap_s[0]) * rate_hz) + 1
    time_s = np.arange(count) / rate_hz
    duck = np.ones(count)
    for tap in clip.taps:
        duck[(time_s >= tap.time_s) & (time_s < tap.time_s + _tap_s(tap, mapping))] = 1.0 - mapping.ducking
    tones, shifts = np.zeros(count), [0.0]
    for tone in clip.tones:
        tones += duck * _tone_wave(tone, clip, mapping, time_s, rate_hz, band, shifts)
    taps, rises = np.zeros(count), []
    for tap in clip.taps:
        rises.append(_tap_wave(tap, mapping, taps, rate_hz, band, shifts))
    wave = tones + taps
    asked = np.repeat(wave[:, None], len(channels), axis=1)
    limiter = Limiter(controller)
    delivered = np.concatenate([block.copy() for block in limiter.process(iter([asked]))])[:count]
    head = ReferenceHead(
        rate_hz=rate_hz,
        channels=tuple(channel.name for channel in channels),
        curves=curves_of(channels),
        band_hz=(min(lows), max(highs)),
        provenance={"clip": clip.name, "format": clip.format, "map": vars(mapping)},
    )
    return RenderedClip(clip, mapping, head, delivered, _loss(asked, delivered, rate_hz, max(shifts), tones, rises))


def _moved(frequency_hz: FloatArray, band: tuple[float, float], shifts: list[float]) -> FloatArray:
    """Return frequencies within the band, and add to `shifts` how far the farthest was moved, in JNDs."""
    inside = np.clip(frequency_hz, *band)
    positive = np.maximum(frequency_hz, 1e-3)
    shifts.append(float(np.max(np.abs(np.log(inside / positive)), initial=0.0) / np.log1p(FREQUENCY_JND)))
    return inside


def _tone_wave(
    tone: Tone, clip: Clip, mapping: PatternMap, time_s: FloatArray, rate_hz: float, band: tuple[float, float],
    shifts: list[float],
) -> FloatArray:  # fmt: skip
    """Return a tone's wave, (n,), with ramps of 5 ms where it begins or ends loud."""
    inside = (time_s >= tone.start_s) & (time_s <= tone.end_s)
    at = time_s[inside]
    low, high = mapping.band_hz
    pitch = tone.pitch.at(at)
    frequency = _moved(pitch if clip.pitch_in_hz else low + (high - low) * pitch, band, shifts)
    ramp_s = min(_RAMP_S, 0.5 * at.size / rate_hz - 1.0 / rate_hz)
    amplitude = mapping.amplitude(tone.strength.at(at)) * ramps(at.size, rate_hz, max(ramp_s, 0.0))
    wave = np.zeros(time_s.size)
    wave[inside] = amplitude * np.sin(2.0 * np.pi * np.cumsum(frequency) / rate_hz)
    return wave


def _tap_s(tap: Tap, mapping: PatternMap) -> float:
    first, last = mapping.tap_s
    return first + (last - first) * tap.pitch


def _tap_wave(
    tap: Tap, mapping: PatternMap, wave: FloatArray, rate_hz: float, band: tuple[float, float], shifts: list[float]
) -> slice:
    """Add a tap to the wave, and return where it stands: whole periods of a sinusoid."""
    low, high = mapping.tap_hz
    frequency = float(_moved(np.array([low + (high - low) * tap.pitch]), band, shifts)[0])
    periods = max(1, round(_tap_s(tap, mapping) * frequency))
    start, count = round(tap.time_s * rate_hz), max(1, round(periods / frequency * rate_hz))
    place = slice(start, min(start + count, wave.size))
    at = np.arange(place.stop - place.start) / rate_hz
    wave[place] += float(mapping.amplitude(np.array(tap.strength))) * np.sin(2.0 * np.pi * frequency * at)
    return place


def _loss(
    asked: FloatArray, delivered: FloatArray, rate_hz: float, shift: float, tones: FloatArray, rises: list[slice]
) -> Loss:
    step = max(1, round(SLICE_S * rate_hz))
    starts = np.arange(0, len(asked), step)
    want, got = (np.maximum.reduceat(np.abs(wave), starts).T for wave in (asked, delivered))
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
        shortfall_db_sl=float(lost.max(initial=0.0)),
        mean_shortfall_db=float(lost[felt].mean()) if felt.any() else 0.0,
        clipped_s=float(clipped.sum() * step / rate_hz),
        frequency_shift_jnd=shift,
        emphasis_rise_db=_rise(asked, delivered, tones, rises) if rises else None,
    )


def _rise(asked: FloatArray, delivered: FloatArray, tones: FloatArray, taps: list[slice]) -> tuple[float, float]:
    """Return by how much the taps' peaks rise above the tones beneath them, or above threshold, asked and delivered."""
    levels = []
    for tap in taps:
        beneath = max(1.0, float(np.abs(tones[tap]).max(initial=0.0)))
        peaks = [max(1.0, float(np.abs(wave[tap]).max(axis=0).min())) for wave in (asked, delivered)]
        levels.append([20.0 * np.log10(peak / beneath) for peak in peaks])
    first, second = np.mean(levels, axis=0)
    return float(first), float(second)
