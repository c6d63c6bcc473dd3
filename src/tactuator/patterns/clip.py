"""Haptic clips as other formats write them: strength and pitch over time, none of it with a unit.

Three formats are read: `.haptic` 1.0 (Meta), AHAP (Apple) and Android's envelopes of vibration (XML). Each is held to
its own rules; a clip that breaks one is refused, with the rule. What a format takes back to its range by itself, as
AHAP does, is done and counted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.text import parse_finite_json, read_text
from tactuator.table import brief

Format = Literal["haptic", "ahap", "android-basic", "android-advanced"]
SUFFIXES = (".haptic", ".ahap", ".xml")
LONGEST_S, MOST_POINTS = 600.0, 100_000


@dataclass(frozen=True, eq=False)
class Breakpoints:
    """A quantity over time: straight between its points, held before the first and after the last; (n,) each."""

    time_s: FloatArray
    value: FloatArray

    __repr__ = brief

    def at(self, time_s: FloatArray) -> FloatArray:
        """Return the quantity at times of any shape; of two points at one time the later holds from there on."""
        return np.asarray(np.interp(time_s, self.time_s, self.value))


@dataclass(frozen=True, eq=False)
class Tone:
    """A vibration from start_s to end_s. strength: 0 to 1. pitch: 0 to 1, or hertz where the clip says so."""

    start_s: float
    end_s: float
    strength: Breakpoints
    pitch: Breakpoints


@dataclass(frozen=True)
class Tap:
    """A short event, an emphasis or a transient, of that strength and pitch (0 to 1)."""

    time_s: float
    strength: float
    pitch: float


@dataclass(frozen=True, eq=False)
class Clip:
    """A clip: tones and taps. pitch_in_hz: pitches are frequencies. clamped: values that the format took back to its
    range. ignored: keys that the format says to pass over.
    """

    name: str
    format: Format
    duration_s: float
    tones: tuple[Tone, ...]
    taps: tuple[Tap, ...]
    pitch_in_hz: bool = False
    clamped: int = 0
    ignored: tuple[str, ...] = ()

    __repr__ = brief


def is_clip(path: str | Path) -> bool:
    """Tell whether a file's name is that of a clip."""
    return Path(path).suffix.lower() in SUFFIXES


def read_clip(path: str | Path, legacy: bool = False) -> Clip:
    """Return the clip in a file. Raises BadInput with the rule that it breaks, within its file.

    legacy: take a .haptic whose frequency outlasts its amplitude, as players of before the specification do: what
    comes after the end is not played.
    """
    path = Path(path)
    try:
        text, suffix = read_text(path), path.suffix.lower()
        if not is_clip(path):
            raise BadInput(f"ending {path.suffix!r}", ", ".join(SUFFIXES))
        clip = _haptic(text, legacy) if suffix == ".haptic" else _ahap(text) if suffix == ".ahap" else _android(text)
    except BadInput as error:
        raise error.within(str(path)) from None
    return replace(clip, name=path.name)


def _number(document: Mapping[str, Any], key: str, low: float, high: float, *where: str) -> float:
    """Return a number of a table, refused where it is none or outside its range."""
    value = document.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise BadInput("missing" if value is None else repr(value)[:60], "a number", where=where, key=key)
    if not low <= value <= high:
        bound = f"{low:g} or more" if math.isinf(high) else f"{low:g} to {high:g}"
        raise BadInput(f"{value:g}", bound, where=where, key=key)
    return float(value)


def _part(document: Any, *path: str) -> Any:
    """Return what stands at a path of keys. Raises BadInput for a key that is missing."""
    for depth, key in enumerate(path):
        if not isinstance(document, Mapping) or key not in document:
            raise BadInput("missing", where=path[:depth], key=key)
        document = document[key]
    return document


def _rows(value: Any, *where: str) -> list[Mapping[str, Any]]:
    if not isinstance(value, list) or not all(isinstance(row, Mapping) for row in value):
        raise BadInput("no list of tables", where=where)
    if len(value) > MOST_POINTS:
        raise BadInput(f"{len(value)} points", f"up to {MOST_POINTS}", where=where)
    return value


def _times(rows: Sequence[Mapping[str, Any]], where: str) -> list[float]:
    """Return the times of an envelope's points, which do not go back."""
    times = [_number(row, "time", 0.0, LONGEST_S, f"{where}[{k}]") for k, row in enumerate(rows)]
    for k, (before, after) in enumerate(pairwise(times)):
        if after < before:
            raise BadInput(
                f"{after:g} s after {before:g} s", "times that do not decrease", where=(f"{where}[{k + 1}]",)
            )
    return times


def _haptic(text: str, legacy: bool) -> Clip:
    """Return the clip of a .haptic file, version 1 (Meta Haptics SDK, haptic-file-spec.md)."""
    document = parse_finite_json(text)
    major = _part(document, "version", "major")
    if major != 1 or isinstance(major, bool):
        raise BadInput(repr(major)[:60], "1", where=("version",), key="major")
    envelopes = _part(document, "signals", "continuous", "envelopes")
    rows = _rows(_part(envelopes, "amplitude"), "amplitude")
    times = _times(rows, "amplitude")
    if len(times) < 2 or times[-1] <= times[0]:
        lasts = f"{len(times)} points" if len(times) < 2 else f"a duration of {times[-1] - times[0]:g} s"
        raise BadInput(lasts, "two points or more, and a duration above 0", where=("amplitude",))
    strength = [_number(row, "amplitude", 0.0, 1.0, f"amplitude[{k}]") for k, row in enumerate(rows)]
    taps = []
    for k, (time_s, row) in enumerate(zip(times, rows, strict=True)):
        if row.get("emphasis") is not None:
            emphasis, where = row["emphasis"], f"amplitude[{k}].emphasis"
            if not isinstance(emphasis, Mapping):
                raise BadInput(repr(emphasis)[:60], "a table", where=(where,))
            level = _number(emphasis, "amplitude", 0.0, 1.0, where)
            if level < strength[k]:
                raise BadInput(f"{level:g}", f"the envelope's {strength[k]:g} or more", where=(where,), key="amplitude")
            taps.append(Tap(time_s, level, _number(emphasis, "frequency", 0.0, 1.0, where)))
    rows = _rows(envelopes.get("frequency") or [], "frequency")
    at = _times(rows, "frequency")
    if at and at[-1] > times[-1] and not legacy:
        end = f"up to the amplitude's end, {times[-1]:g} s; older players take it, and so does --legacy"
        raise BadInput(f"a point at {at[-1]:g} s", end, where=("frequency",))
    pitch = [_number(row, "frequency", 0.0, 1.0, f"frequency[{k}]") for k, row in enumerate(rows)]
    course = Breakpoints(np.array(at), np.array(pitch)) if at else Breakpoints(np.zeros(1), np.array([0.5]))
    tone = Tone(times[0], times[-1], Breakpoints(np.array(times), np.array(strength)), course)
    return Clip("", "haptic", times[-1], (tone,), tuple(taps))


_CONTROLS = ("HapticIntensityControl", "HapticSharpnessControl")


class _Clamped:
    """Values taken back to 0 to 1, and how many had to be; keys that AHAP passes over."""

    def __init__(self) -> None:
        self.count = 0
        self.ignored: list[str] = []

    def __call__(self, value: float) -> float:
        self.count += not 0.0 <= value <= 1.0
        return min(max(value, 0.0), 1.0)


def _ahap(text: str) -> Clip:
    """Return the clip of an AHAP file (Apple, "Representing haptic patterns in AHAP files").

    A curve of HapticIntensityControl multiplies the strength of the events, one of HapticSharpnessControl is added to
    their sharpness; the points of a curve count from its own time. Values beyond the range are clamped.
    """
    document = parse_finite_json(text)
    _number(document if isinstance(document, Mapping) else {}, "Version", 1.0, 1.0)
    clamp, events = _Clamped(), []
    curves: dict[str, list[tuple[float, float]]] = {name: [] for name in _CONTROLS}
    for k, entry in enumerate(_rows(_part(document, "Pattern"), "Pattern")):
        where = f"Pattern[{k}]"
        if isinstance(entry.get("Event"), Mapping):
            event = _event(entry["Event"], f"{where}.Event", clamp)
            events += [] if event is None else [event]
        elif isinstance(entry.get("ParameterCurve"), Mapping):
            _curve(entry["ParameterCurve"], f"{where}.ParameterCurve", curves, clamp)
        elif isinstance(entry.get("Parameter"), Mapping):
            clamp.ignored.append(f"{where}.Parameter")
        else:
            raise BadInput(f"{', '.join(map(str, entry))[:60] or 'empty'}", "Event, ParameterCurve", where=(where,))
    if not events:
        raise BadInput("no haptic event", "one HapticContinuous or HapticTransient or more", where=("Pattern",))
    strength, pitch = (_control(curves[name], rest) for name, rest in zip(_CONTROLS, (1.0, 0.0), strict=True))
    tones, taps = [], []
    for time_s, lasts_s, level, sharpness in events:
        if lasts_s is None:
            loud, sharp = (float(course.at(np.array(time_s))) for course in (strength, pitch))
            taps.append(Tap(time_s, clamp(level * loud), clamp(sharpness + sharp)))
        else:
            loudness = Breakpoints(strength.time_s, np.array([clamp(level * each) for each in strength.value]))
            sharper = Breakpoints(pitch.time_s, np.array([clamp(sharpness + each) for each in pitch.value]))
            tones.append(Tone(time_s, time_s + lasts_s, loudness, sharper))
    end_s = max([*(tone.end_s for tone in tones), *(tap.time_s for tap in taps)])
    return Clip("", "ahap", end_s, tuple(tones), tuple(taps), clamped=clamp.count, ignored=tuple(clamp.ignored))


def _event(event: Mapping[str, Any], where: str, clamp: _Clamped) -> tuple[float, float | None, float, float] | None:
    """Return time, duration (None: a tap), strength and sharpness of an event; None for one that is not haptic."""
    kind = event.get("EventType")
    if isinstance(kind, str) and kind.startswith("Audio"):
        clamp.ignored.append(where)
        return None
    if kind not in ("HapticTransient", "HapticContinuous"):
        allowed = "HapticTransient, HapticContinuous, AudioCustom, AudioContinuous"
        raise BadInput(repr(kind)[:60], allowed, where=(where,), key="EventType")
    time_s = _number(event, "Time", 0.0, LONGEST_S, where)
    values = {"HapticIntensity": 1.0, "HapticSharpness": 0.5}
    for k, parameter in enumerate(_rows(event.get("EventParameters", []), where, "EventParameters")):
        name = parameter.get("ParameterID")
        if name in values:
            place = f"{where}.EventParameters[{k}]"
            values[name] = clamp(_number(parameter, "ParameterValue", -math.inf, math.inf, place))
        else:
            clamp.ignored.append(f"{where}.{str(name)[:40]}")
    lasts_s = None
    if kind == "HapticContinuous":
        lasts_s = _number(event, "EventDuration", 1e-6, LONGEST_S, where)
    return time_s, lasts_s, values["HapticIntensity"], values["HapticSharpness"]


def _curve(curve: Mapping[str, Any], where: str, curves: dict[str, list[tuple[float, float]]], clamp: _Clamped) -> None:
    """Add the points of a parameter curve to those of its control."""
    name = curve.get("ParameterID")
    start_s = _number(curve, "Time", 0.0, LONGEST_S, where)
    rows = _rows(_part(curve, "ParameterCurveControlPoints"), where)
    if name not in curves:
        clamp.ignored.append(f"{where}.{str(name)[:40]}")
        return
    low = 0.0 if name == _CONTROLS[0] else -1.0
    for k, row in enumerate(rows):
        place = f"{where}.ParameterCurveControlPoints[{k}]"
        value = _number(row, "ParameterValue", -math.inf, math.inf, place)
        inside = min(max(value, low), 1.0)
        clamp.count += inside != value
        curves[name].append((start_s + _number(row, "Time", 0.0, LONGEST_S, place), inside))


def _control(points: list[tuple[float, float]], rest: float) -> Breakpoints:
    """Return a control over time: at rest before its first point, held after its last."""
    if not points:
        return Breakpoints(np.zeros(1), np.array([rest]))
    points = sorted(points, key=lambda point: point[0])
    if points[0][0] > 0.0:
        points = [(points[0][0], rest), *points]
    return Breakpoints(*(np.array(column) for column in zip(*points, strict=True)))


_ANDROID: Mapping[str, tuple[Format, str, str, str, float]] = {
    "basic-envelope-effect": ("android-basic", "initialSharpness", "intensity", "sharpness", 1.0),
    "waveform-envelope-effect": ("android-advanced", "initialFrequencyHz", "amplitude", "frequencyHz", 20_000.0),
}


def _android(text: str) -> Clip:
    """Return the clip of an envelope effect of Android 16 (android.os.vibrator.persistence: vibration-effect).

    An effect begins at zero strength, each control point is reached in its duration, and the last has to be zero.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise BadInput("a document type or entity", "a vibration-effect without one")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError):
        raise BadInput("it is not XML") from None
    if root.tag != "vibration-effect" or len(root) != 1 or root[0].tag not in _ANDROID:
        raise BadInput(
            f"<{root.tag[:40]}> with {len(root)} parts", f"vibration-effect with one of {', '.join(_ANDROID)}"
        )
    effect = root[0]
    kind, initial, strength_key, pitch_key, most = _ANDROID[effect.tag]
    points = list(effect)
    if not points or len(points) > MOST_POINTS or any(point.tag != "control-point" for point in points):
        raise BadInput(f"{len(points)} parts", f"1 to {MOST_POINTS} control points", where=(effect.tag,))
    times, strengths, pitches = [0.0], [0.0], []
    for k, point in enumerate(points):
        row, where = _attributes(point, effect.tag, k, (strength_key, pitch_key, "durationMs")), f"{effect.tag}[{k}]"
        times.append(times[-1] + 1e-3 * _number(row, "durationMs", 1.0, 1e3 * LONGEST_S, where))
        strengths.append(_number(row, strength_key, 0.0, 1.0, where))
        pitches.append(_number(row, pitch_key, 0.0, most, where))
    first = {key: float(effect.attrib[key]) for key in (initial,) if _is_number(effect.attrib.get(key))}
    if initial in effect.attrib and not first:
        raise BadInput(repr(effect.attrib[initial])[:60], "a number", where=(effect.tag,), key=initial)
    begins = _number(first, initial, 0.0, most, effect.tag) if first else pitches[0]
    if kind == "android-basic" and strengths[-1] != 0.0:
        raise BadInput(f"{strengths[-1]:g}", "0 at the end", where=(effect.tag,), key=strength_key)
    if times[-1] > LONGEST_S:
        raise BadInput(f"{times[-1]:g} s", f"up to {LONGEST_S:g} s", where=(effect.tag,))
    at = np.array(times)
    tone = Tone(0.0, times[-1], Breakpoints(at, np.array(strengths)), Breakpoints(at, np.array([begins, *pitches])))
    return Clip("", kind, times[-1], (tone,), (), pitch_in_hz=kind == "android-advanced")


def _is_number(text: str | None) -> bool:
    try:
        return text is not None and math.isfinite(float(text))
    except ValueError:
        return False


def _attributes(point: ElementTree.Element, tag: str, k: int, keys: Sequence[str]) -> dict[str, float]:
    """Return the attributes of a control point as numbers. Raises BadInput for another attribute, or another text."""
    for key, text in point.attrib.items():
        if key not in keys:
            raise BadInput("not a key that is known", ", ".join(keys), where=(f"{tag}[{k}]",), key=key[:40])
        if not _is_number(text):
            raise BadInput(repr(text)[:60], "a number", where=(f"{tag}[{k}]",), key=key)
    return {key: float(text) for key, text in point.attrib.items()}
