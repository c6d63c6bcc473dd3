"""A haptic clip as a signal in dB SL, on every channel alike.

A clip has no unit. Strength 1 is taken for a level, strength for a share of the amplitude, and pitch 0 to 1 for the
band of the format's reference device; a tap is two periods, with the tone under it at half.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import within
from tactuator.io.text import read_text
from tactuator.model.controller import Controller
from tactuator.perception.curve import FREQUENCY_JND, check_level
from tactuator.signals.decibels import from_db
from tactuator.signals.excitation import ramps
from tactuator.speech.ahap import parse_ahap
from tactuator.speech.clip import Clip, Tap, Tone, check_amount, parse_haptic
from tactuator.speech.signal import Signal, loss_of

BAND_HZ: Mapping[str, tuple[float, float]] = {"haptic": (55.0, 200.0), "ahap": (65.0, 300.0)}
"""Frequencies of pitch 0 and 1 by format: of the Quest's controllers, and of the range of MPEG's encoder for AHAP."""
TAP_HZ, TAP_S = (55.0, 165.0), (0.0364, 0.0121)
"""Frequency and duration of a tap of pitch 0 and of pitch 1, on the Quest's controllers."""
DUCKING = 0.5
"""Share by which tones are weakened during a tap."""
_RAMP_S = 0.005


def read_clip(path: str | Path, legacy: bool = False) -> Clip:
    """Return the clip in a file, `.haptic` or `.ahap`. Raises BadInput with the rule that it breaks, within its file.

    legacy: as for `parse_haptic`.
    """
    path = Path(path)
    with within(str(path)):
        text = read_text(path)
        clip = parse_ahap(text) if path.suffix.lower() == ".ahap" else parse_haptic(text, legacy)
        check_amount(clip)
    return clip


def clip_signal(clip: Clip, controller: Controller, level_db_sl: float) -> Signal:
    """Return what a clip asks of every channel of a display, strength 1 being `level_db_sl`.

    Pitches beyond the band that all channels have are moved into it. Raises BadInput for a level that is not below
    comfort.
    """
    check_level(level_db_sl)
    rate_hz, channels = controller.rate_hz, controller.display.channels
    lows, highs = zip(*(channel.threshold.band_hz for channel in channels), strict=True)
    band, full = (max(lows), min(highs)), float(from_db(level_db_sl))
    count = round((clip.duration_s + max(TAP_S)) * rate_hz) + 1
    duck, tones, taps, shifts, places = np.ones(count), np.zeros(count), np.zeros(count), [0.0], []
    for tap in clip.taps:
        duck[_slice(tap.time_s, tap.time_s + _between(TAP_S, tap.pitch), rate_hz)] = 1.0 - DUCKING
        places.append(_add_tap(tap, full, taps, rate_hz, band, shifts))
    for tone in clip.tones:
        _add_tone(tone, full, BAND_HZ[clip.format], tones, rate_hz, band, shifts)
    tones *= duck
    asked = np.repeat((tones + taps)[:, None], len(channels), axis=1)
    loss = partial(loss_of, asked, rate_hz=rate_hz, shift_jnd=max(shifts), tones=tones, taps=tuple(places))
    about = {"format": clip.format, "duration_s": clip.duration_s, "pitch_hz": list(BAND_HZ[clip.format])}
    return Signal(count, iter([asked]), about, _notes(clip), loss)


def _notes(clip: Clip) -> tuple[str, ...]:
    lines = {
        f"{clip.clamped} values were outside their range: the format takes them back to it": clip.clamped,
        f"not known to the format, and left out: {_first(clip.ignored)}": clip.ignored,
        f"not rendered: {_first(clip.unrendered)}": clip.unrendered,
    }
    return tuple(line for line, there in lines.items() if there)


def _first(names: tuple[str, ...]) -> str:
    return ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")


def _between(ends: tuple[float, float], share: float) -> float:
    return ends[0] + (ends[1] - ends[0]) * share


def moved_into(frequency_hz: FloatArray, band_hz: tuple[float, float]) -> tuple[FloatArray, float]:
    """Return frequencies within a band, and how far the farthest was moved, in just noticeable differences."""
    inside = np.clip(frequency_hz, *band_hz)
    moved = np.abs(np.log(inside / np.maximum(frequency_hz, 1e-3)))
    return inside, float(np.max(moved, initial=0.0) / np.log1p(FREQUENCY_JND))


def _slice(start_s: float, end_s: float, rate_hz: float) -> slice:
    """Return the samples from a time to another, both with them."""
    return slice(math.ceil(start_s * rate_hz - 1e-9), math.floor(end_s * rate_hz + 1e-9) + 1)


def _add_tone(
    tone: Tone, full: float, pitch_hz: tuple[float, float], wave: FloatArray, rate_hz: float,
    band: tuple[float, float], shifts: list[float],
) -> None:  # fmt: skip
    """Add a tone to the wave (n,), with ramps of 5 ms where it begins or ends loud."""
    place = _slice(tone.start_s, tone.end_s, rate_hz)
    at = np.arange(place.start, min(place.stop, wave.size)) / rate_hz
    wished = pitch_hz[0] + (pitch_hz[1] - pitch_hz[0]) * tone.pitch.at(at)
    strength = tone.strength.at(at)
    shifts.append(moved_into(wished[strength > 0.0], band)[1])
    ramp_s = min(_RAMP_S, 0.5 * at.size / rate_hz - 1.0 / rate_hz)
    amplitude = full * strength * ramps(at.size, rate_hz, max(ramp_s, 0.0))
    wave[place] += amplitude * np.sin(2.0 * np.pi * np.cumsum(np.clip(wished, *band)) / rate_hz)


def _add_tap(
    tap: Tap, full: float, wave: FloatArray, rate_hz: float, band: tuple[float, float], shifts: list[float]
) -> slice:
    """Add a tap to the wave, and return where it is: whole periods of a sinusoid."""
    (frequency,), shift = moved_into(np.array([_between(TAP_HZ, tap.pitch)]), band)
    shifts.append(shift if tap.strength > 0.0 else 0.0)
    periods = max(1, round(_between(TAP_S, tap.pitch) * frequency))
    start, count = round(tap.time_s * rate_hz), max(1, round(periods / frequency * rate_hz))
    place = slice(start, min(start + count, wave.size))
    at = np.arange(place.stop - place.start) / rate_hz
    wave[place] += full * tap.strength * np.sin(2.0 * np.pi * frequency * at)
    return place
