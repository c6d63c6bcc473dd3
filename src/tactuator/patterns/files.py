"""Reading of clips, by the ending of a file's name; the format `.haptic`; and a reference as a clip of another format:
strength and pitch over time, and what of it that does not carry.

A clip of one tone has an amplitude and a frequency at each moment: those of the reference's analytic signal, in steps
of 10 ms, of which points that lie on the line between others are left out. A reference with several tones at once loses
all but the strongest; that is told.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput, within
from tactuator.io.text import parse_finite_json, read_text
from tactuator.patterns.ahap import INTENSITY_CONTROL, LONGEST_EVENT_S, SHARPNESS_CONTROL, parse_ahap
from tactuator.patterns.android import parse_vibration_effect
from tactuator.patterns.clip import (
    LONGEST_S,
    Breakpoints,
    Clip,
    Tap,
    Tone,
    check_amount,
    number_of,
    part_of,
    rows_of,
)
from tactuator.patterns.hjif import parse_hjif
from tactuator.patterns.rendering import SLICE_S, PatternMap, clip_wave
from tactuator.perception.curve import FREQUENCY_JND
from tactuator.signals.decibels import db
from tactuator.table import brief


def is_clip(path: str | Path) -> bool:
    """Tell whether a file's name is that of a clip."""
    return Path(path).suffix.lower() in SUFFIXES


def read_clip(path: str | Path, legacy: bool = False) -> Clip:
    """Return the clip in a file. Raises BadInput with the rule that it breaks, within its file.

    legacy: take a .haptic whose frequency outlasts its amplitude, as players of before the specification do: what
    comes after the end is not played.
    """
    path = Path(path)
    with within(str(path)):
        if not is_clip(path):
            raise BadInput(f"ending {path.suffix!r}", ", ".join(SUFFIXES))
        text, suffix = read_text(path), path.suffix.lower()
        clip = parse_haptic(text, legacy) if suffix == ".haptic" else _PARSERS[suffix](text)
        check_amount(clip)
    return replace(clip, name=path.name)


def _times(rows: Sequence[Mapping[str, Any]], where: str) -> list[float]:
    times = [number_of(row, "time", 0.0, LONGEST_S, f"{where}[{k}]") for k, row in enumerate(rows)]
    for k, (before, after) in enumerate(pairwise(times)):
        if after < before:
            raise BadInput(
                f"{after:g} s after {before:g} s", "times that do not decrease", where=(f"{where}[{k + 1}]",)
            )
    return times


def parse_haptic(text: str, legacy: bool) -> Clip:
    """Return the clip of a .haptic file, version 1 (Meta Haptics SDK, haptic-file-spec.md)."""
    document = parse_finite_json(text)
    major = part_of(document, "version", "major")
    if major != 1 or isinstance(major, bool):
        raise BadInput(repr(major)[:60], "1", where=("version",), key="major")
    envelopes = part_of(document, "signals", "continuous", "envelopes")
    rows = rows_of(part_of(envelopes, "amplitude"), "amplitude")
    times = _times(rows, "amplitude")
    if len(times) < 2 or times[-1] <= times[0]:
        lasts = f"{len(times)} points" if len(times) < 2 else f"a duration of {times[-1] - times[0]:g} s"
        raise BadInput(lasts, "two points or more, and a duration above 0", where=("amplitude",))
    strength = [number_of(row, "amplitude", 0.0, 1.0, f"amplitude[{k}]") for k, row in enumerate(rows)]
    taps = []
    for k, (time_s, row) in enumerate(zip(times, rows, strict=True)):
        if row.get("emphasis") is not None:
            emphasis, where = row["emphasis"], f"amplitude[{k}].emphasis"
            if not isinstance(emphasis, Mapping):
                raise BadInput(repr(emphasis)[:60], "a table", where=(where,))
            level = number_of(emphasis, "amplitude", 0.0, 1.0, where)
            if level < strength[k]:
                raise BadInput(f"{level:g}", f"the envelope's {strength[k]:g} or more", where=(where,), key="amplitude")
            taps.append(Tap(time_s, level, number_of(emphasis, "frequency", 0.0, 1.0, where)))
    rows = rows_of(envelopes.get("frequency") or [], "frequency")
    at = _times(rows, "frequency")
    if at and at[-1] > times[-1] and not legacy:
        end = f"up to the amplitude's end, {times[-1]:g} s; older players take it, and so does --legacy"
        raise BadInput(f"a point at {at[-1]:g} s", end, where=("frequency",))
    pitch = [number_of(row, "frequency", 0.0, 1.0, f"frequency[{k}]") for k, row in enumerate(rows)]
    course = Breakpoints(np.array(at), np.array(pitch)) if at else Breakpoints(np.zeros(1), np.array([0.5]))
    tone = Tone(times[0], times[-1], Breakpoints(np.array(times), np.array(strength)), course)
    return Clip("", "haptic", times[-1], (tone,), tuple(taps))


_PARSERS: Mapping[str, Callable[[str], Clip]] = {
    ".haptic": partial(parse_haptic, legacy=False),
    ".ahap": parse_ahap,
    ".xml": parse_vibration_effect,
    ".hjif": parse_hjif,
}
SUFFIXES = tuple(_PARSERS)
"""Endings of clips' names."""


_STRENGTH_STEP, _PITCH_STEP = 0.004, 0.004
"""Points that are so near to the line between others are left out."""
_FRAME_S = 0.05
_CURVE_POINTS = 16
"""Points of one parameter curve: those which Meta's own writer of AHAP allows itself."""
_DIGITS = 5


@dataclass(frozen=True, eq=False)
class MovingTone:
    """A reference as a tone whose amplitude (threshold units) and frequency (Hz) move; times (s) of both, (n,)."""

    time_s: FloatArray
    amplitude: FloatArray
    frequency_hz: FloatArray

    __repr__ = brief


def moving_tone(wave: FloatArray, rate_hz: float) -> MovingTone:
    """Return the course of a wave (n,) in steps of 10 ms. Raises BadInput for an empty one, or one too long."""
    if not LONGEST_S >= wave.size / rate_hz >= 2.0 * SLICE_S or not wave.any():
        got = f"{wave.size / rate_hz:g} s with a peak of {np.abs(wave).max(initial=0.0):g}"
        raise BadInput(got, f"{2.0 * SLICE_S:g} to {LONGEST_S:g} s of something")
    analytic = _analytic(wave)
    step = max(1, round(SLICE_S * rate_hz))
    weight = np.abs(analytic[:-1]) * np.abs(analytic[1:])
    turns = np.angle(analytic[1:] * analytic[:-1].conj()) * rate_hz / (2.0 * np.pi)
    starts = np.arange(0, wave.size - 1, step)
    loud = np.add.reduceat(weight, starts)
    weighed = np.add.reduceat(weight * np.abs(turns), starts)
    hertz = np.where(loud > 0.0, weighed / np.maximum(loud, 1e-300), 0.0)
    held = np.maximum.accumulate(np.where(loud > 0.0, np.arange(hertz.size), 0))
    amplitude = np.sqrt(np.add.reduceat(np.abs(analytic) ** 2, starts) / np.diff([*starts, wave.size]))
    middle = (starts + 0.5 * np.diff([*starts, wave.size])) / rate_hz
    time = np.concatenate(([0.0], middle, [wave.size / rate_hz]))
    ends = (amplitude, hertz[held])
    return MovingTone(time, *(np.concatenate((each[:1], each, each[-1:])) for each in ends))


def _analytic(wave: FloatArray) -> ComplexArray:
    return np.asarray(scipy.signal.hilbert(wave, scipy.fft.next_fast_len(wave.size))[: wave.size])


def _sparse(time_s: FloatArray, value: FloatArray, within: float) -> Breakpoints:
    """Return the points that the straight lines between them need to stay `within` of all (Douglas and Peucker)."""
    kept = {0, time_s.size - 1}
    stretches = [(0, time_s.size - 1)]
    while stretches:
        first, last = stretches.pop()
        if last - first < 2:
            continue
        inner = slice(first + 1, last)
        ends = ([time_s[first], time_s[last]], [value[first], value[last]])
        off = np.abs(value[inner] - np.interp(time_s[inner], *ends))
        worst = int(np.argmax(off))
        if off[worst] > within:
            middle = first + 1 + worst
            kept.add(middle)
            stretches += [(first, middle), (middle, last)]
    index = np.array(sorted(kept))
    return Breakpoints(time_s[index], value[index])


def shares_of(course: MovingTone, mapping: PatternMap) -> tuple[Breakpoints, Breakpoints]:
    """Return strength and pitch (0 to 1) of a course by a map; frequencies beyond its band are moved into it."""
    low, high = mapping.band_hz
    strength = np.clip(course.amplitude / mapping.amplitude(np.array(1.0), np.array(low)), 0.0, 1.0)
    pitch = np.clip((course.frequency_hz - low) / (high - low), 0.0, 1.0)
    return _sparse(course.time_s, strength, _STRENGTH_STEP), _sparse(course.time_s, pitch, _PITCH_STEP)


def haptic_text(strength: Breakpoints, pitch: Breakpoints, description: str) -> str:
    """Return strength and pitch as the text of a `.haptic` 1.0."""
    envelopes = {
        name: [{"time": at, name: value} for at, value in _pairs(course)]
        for name, course in (("amplitude", strength), ("frequency", pitch))
    }
    document = {
        "version": {"major": 1, "minor": 0, "patch": 0},
        "metadata": {"editor": "tactuator", "description": description},
        "signals": {"continuous": {"envelopes": envelopes}},
    }
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def ahap_text(strength: Breakpoints, pitch: Breakpoints, description: str) -> str:
    """Return strength and pitch as the text of an AHAP: events of 30 s at most, under curves of 16 points at most."""
    end_s = float(strength.time_s[-1])
    pattern: list[Mapping[str, Any]] = []
    for start_s in np.arange(0.0, end_s, LONGEST_EVENT_S):
        parameters = [{"ParameterID": name, "ParameterValue": value} for name, value in _EVENT.items()]
        event = {
            "Time": float(start_s), "EventType": "HapticContinuous",
            "EventDuration": round(min(LONGEST_EVENT_S, end_s - float(start_s)), _DIGITS),
            "EventParameters": parameters,
        }  # fmt: skip
        pattern.append({"Event": event})
    for name, course in ((INTENSITY_CONTROL, strength), (SHARPNESS_CONTROL, pitch)):
        pairs = _pairs(course)
        for first in range(0, max(len(pairs) - 1, 1), _CURVE_POINTS - 1):
            points = pairs[first : first + _CURVE_POINTS]
            start_s = points[0][0]
            rows = [{"Time": round(at - start_s, _DIGITS), "ParameterValue": value} for at, value in points]
            curve = {"ParameterID": name, "Time": start_s, "ParameterCurveControlPoints": rows}
            pattern.append({"ParameterCurve": curve})
    document = {"Version": 1.0, "Metadata": {"Description": description}, "Pattern": pattern}
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


_EVENT = {"HapticIntensity": 1.0, "HapticSharpness": 0.0}


def _pairs(course: Breakpoints) -> list[tuple[float, float]]:
    return [(round(float(at), _DIGITS), round(float(value), _DIGITS)) for at, value in
            zip(course.time_s, course.value, strict=True)]  # fmt: skip


@dataclass(frozen=True)
class GivenLoss:
    """What a clip that was made of a reference does not carry of it, where the reference is above threshold.

    level_rms_db, level_worst_db: difference of the levels in slices of 10 ms. frequency_shift_jnd: difference of the
    frequencies in just noticeable ones, rms by the power of the slices. carried: share of the power that is the
    clip's tone (in frames of 50 ms, whatever its phase); the rest is other tones and noise.
    """

    level_rms_db: float
    level_worst_db: float
    frequency_shift_jnd: float
    carried: float


def loss_of_clip(clip: Clip, mapping: PatternMap, wave: FloatArray, rate_hz: float) -> GivenLoss:
    """Return what a clip loses of the wave (n,) that it was made of; the clip is rendered anew by its map."""
    band = 1e-3, 0.5 * rate_hz
    again = clip_wave(clip, mapping, rate_hz, band).wave
    again = np.concatenate((again, np.zeros(max(0, wave.size - again.size))))[: wave.size]
    return loss_between(wave, again, rate_hz)


def loss_between(asked: FloatArray, given: FloatArray, rate_hz: float) -> GivenLoss:
    """Return what a wave (n,) does not carry of another one of its length."""
    before, after = moving_tone(asked, rate_hz), moving_tone(given, rate_hz)
    loud = before.amplitude >= 1.0
    off_db = np.where(loud, db(np.maximum(after.amplitude, 1.0)) - db(np.maximum(before.amplitude, 1.0)), 0.0)
    positive = np.maximum(before.frequency_hz, 1e-3), np.maximum(after.frequency_hz, 1e-3)
    jnds = np.where(loud, np.log(positive[1] / positive[0]) / np.log1p(FREQUENCY_JND), 0.0)
    weight = np.where(loud, before.amplitude**2, 0.0)
    first, second = _analytic(asked), _analytic(given)
    starts = np.arange(0, asked.size, max(1, round(_FRAME_S * rate_hz)))
    power = np.add.reduceat(np.abs(first) ** 2, starts)
    share = np.abs(np.add.reduceat(first * second.conj(), starts)) ** 2
    share = share / np.maximum(np.add.reduceat(np.abs(second) ** 2, starts), 1e-300)
    return GivenLoss(
        float(np.sqrt(np.sum(off_db**2) / max(1, loud.sum()))), float(np.abs(off_db).max()),
        float(np.sqrt(np.sum(weight * jnds**2) / max(weight.sum(), 1e-300))), float(share.sum() / power.sum()),
    )  # fmt: skip
