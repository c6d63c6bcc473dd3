"""AHAP (Apple, "Representing haptic patterns in AHAP files"): events, dynamic parameters and parameter curves.

Core Haptics sets entries that are missing to their defaults, clamps values to their range, and passes over keys that
it does not know; so does this. A continuous event has to have a duration, of 30 s at most ("hapticContinuous").
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, likely
from tactuator.io.text import parse_finite_json
from tactuator.speech.clip import (
    LONGEST_S,
    MOST_IN_ALL_POINTS,
    Breakpoints,
    Clip,
    Tap,
    Tone,
    number_of,
    part_of,
    rows_of,
)

_INTENSITY, _SHARPNESS = "HapticIntensityControl", "HapticSharpnessControl"
_LONGEST_EVENT_S = 30.0
_DEFAULTS = {"HapticIntensity": 1.0, "HapticSharpness": 0.5}
_SHAPING = ("AttackTime", "DecayTime", "ReleaseTime", "Sustained")
_MISSPELT = 0.85
"""Likeness of a word to a known one from which on it is taken for that, misspelt."""
_EVENT_KEYS = {"Event", "EventType", "Time", "EventDuration", "Duration", "EventParameters"}


@dataclass(frozen=True)
class _Event:
    """A haptic event. lasts_s: None of a transient."""

    time_s: float
    lasts_s: float | None
    intensity: float
    sharpness: float


class _Notes:
    """Values taken back to their range, and how many had to be; what is passed over, and what is not rendered."""

    def __init__(self) -> None:
        self.clamped = 0
        self.ignored: list[str] = []
        self.unrendered: list[str] = []

    def clamp(self, value: float, low: float = 0.0, high: float = 1.0) -> float:
        self.clamped += not low <= value <= high
        return min(max(value, low), high)

    def clamp_all(self, values: FloatArray) -> FloatArray:
        self.clamped += int(np.count_nonzero((values < 0.0) | (values > 1.0)))
        return np.clip(values, 0.0, 1.0)

    def pass_over(self, keys: Iterable[object], known: Collection[str], where: str) -> None:
        """Note what is not known; raise BadInput for what is likely a misspelt word of those that are."""
        for key in (str(key)[:40] for key in keys if key not in known):
            if meant := likely(key, known, _MISSPELT):
                raise BadInput(f"not known{meant}", ", ".join(sorted(known)), where=(where,) if where else (), key=key)
            self.ignored.append(f"{where}.{key}".removeprefix("."))


def parse_ahap(text: str) -> Clip:
    """Return the clip of an AHAP. The intensity control multiplies the strength of every event; the sharpness control
    is added to the sharpness of continuous events; the points of a curve count from its own time.

    Raises BadInput, with the reason alone, for what breaks a rule.
    """
    document = parse_finite_json(text)
    entries = rows_of(part_of(document, "Pattern"), "Pattern")
    number_of(document, "Version", 1.0, 1.0, missing=1.0)
    notes, silent_s = _Notes(), 0.0
    events: list[_Event] = []
    notes.pass_over(document, ("Version", "Pattern"), "")
    stretches: dict[str, list[list[tuple[float, float]]]] = {_INTENSITY: [], _SHARPNESS: []}
    for k, entry in enumerate(entries):
        kinds = [kind for kind in ("Event", "ParameterCurve", "Parameter") if isinstance(entry.get(kind), Mapping)]
        if not kinds:
            got = ", ".join(map(str, entry))[:60] or "nothing"
            raise BadInput(got, "Event, ParameterCurve, Parameter", where=(f"Pattern[{k}]",))
        notes.pass_over(entry, kinds, f"Pattern[{k}]")
        for kind in kinds:
            where = f"Pattern[{k}].{kind}"
            if kind != "Event":
                _control_points(entry[kind], kind, where, stretches, notes)
            elif isinstance(event := _event(entry[kind], where, notes), _Event):
                events.append(event)
            else:
                silent_s = max(silent_s, event)
    if not events and silent_s <= 0.0:
        raise BadInput("no haptic event", "one HapticContinuous or HapticTransient or more", where=("Pattern",))
    return _clip_of(events, silent_s, stretches, notes)


def _clip_of(
    events: list[_Event], silent_s: float, stretches: Mapping[str, list[list[tuple[float, float]]]], notes: _Notes
) -> Clip:
    """Return the clip of events under their controls. silent_s: the end of what is heard and not felt."""
    intensity, sharpness = _course(stretches[_INTENSITY], 1.0), _course(stretches[_SHARPNESS], 0.0)
    tones: list[Tone] = []
    taps: list[Tap] = []
    points, end_s = 0, silent_s
    for event in events:
        end_s = max(end_s, event.time_s + (event.lasts_s or 0.0))
        if event.lasts_s is None:
            factor = float(intensity.at(np.array(event.time_s)))
            taps.append(Tap(event.time_s, notes.clamp(event.intensity * factor), event.sharpness))
            continue
        loud, sharp = (_within(course, event.time_s, event.time_s + event.lasts_s) for course in (intensity, sharpness))
        points += loud.time_s.size + sharp.time_s.size
        if points > MOST_IN_ALL_POINTS:
            raise BadInput(f"{points} points of events under curves", f"up to {MOST_IN_ALL_POINTS}")
        strength = Breakpoints(loud.time_s, notes.clamp_all(event.intensity * loud.value))
        pitch = Breakpoints(sharp.time_s, notes.clamp_all(event.sharpness + sharp.value))
        tones.append(Tone(event.time_s, event.time_s + event.lasts_s, strength, pitch))
    return Clip(
        "ahap", end_s, tuple(tones), tuple(taps),
        clamped=notes.clamped, ignored=tuple(notes.ignored), unrendered=tuple(dict.fromkeys(notes.unrendered)),
    )  # fmt: skip


def _event(event: Mapping[str, Any], where: str, notes: _Notes) -> _Event | float:
    """Return an event, or the end of one that is heard and not felt."""
    kind = event.get("EventType")
    if kind not in ("HapticTransient", "HapticContinuous", "AudioCustom", "AudioContinuous"):
        allowed = "HapticTransient, HapticContinuous, AudioCustom, AudioContinuous"
        raise BadInput("missing" if kind is None else repr(kind)[:60], allowed, where=(where,), key="EventType")
    time_s = number_of(event, "Time", 0.0, LONGEST_S, where, missing=0.0)
    duration = "EventDuration" if "EventDuration" in event else "Duration"
    is_continuous = kind == "HapticContinuous"
    if is_continuous and duration not in event:
        raise BadInput("missing", "the seconds that a HapticContinuous lasts", where=(where,), key="EventDuration")
    lasts_s = number_of(event, duration, 0.0, math.inf, where, missing=0.0)
    if is_continuous and lasts_s == 0.0:
        raise BadInput("0", "above 0", where=(where,), key=duration)
    if str(kind).startswith("Audio"):
        notes.ignored.append(where)
        return time_s + notes.clamp(lasts_s, 0.0, LONGEST_S - time_s)
    notes.pass_over(event, _EVENT_KEYS, where)
    values = dict(_DEFAULTS)
    for k, parameter in enumerate(rows_of(event.get("EventParameters", []), where, "EventParameters")):
        name, place = parameter.get("ParameterID"), f"{where}.EventParameters[{k}]"
        if name in values:
            key = "Value" if "ParameterValue" not in parameter and "Value" in parameter else "ParameterValue"
            values[str(name)] = notes.clamp(number_of(parameter, key, -math.inf, math.inf, place))
        elif name in _SHAPING:
            notes.unrendered.append(str(name))
        else:
            notes.pass_over([name], (*_DEFAULTS, *_SHAPING), where)
    whole_s = notes.clamp(lasts_s, 0.0, _LONGEST_EVENT_S) if is_continuous else None
    return _Event(time_s, whole_s, values["HapticIntensity"], values["HapticSharpness"])


def _control_points(
    control: Mapping[str, Any], kind: str, where: str, stretches: Mapping[str, list[list[tuple[float, float]]]],
    notes: _Notes,
) -> None:  # fmt: skip
    name = control.get("ParameterID")
    start_s = number_of(control, "Time", 0.0, LONGEST_S, where, missing=0.0)
    points = [control] if kind == "Parameter" else rows_of(part_of(control, "ParameterCurveControlPoints"), where)
    if name not in stretches:
        if isinstance(name, str) and name.startswith("Haptic") and name.endswith("TimeControl"):
            notes.unrendered.append(name[:40])
        else:
            notes.pass_over([name], stretches, where)
        return
    low = 0.0 if name == _INTENSITY else -1.0
    stretch = []
    for k, point in enumerate(points):
        place = where if kind == "Parameter" else f"{where}.ParameterCurveControlPoints[{k}]"
        after_s = 0.0 if kind == "Parameter" else number_of(point, "Time", 0.0, LONGEST_S, place, missing=0.0)
        value = notes.clamp(number_of(point, "ParameterValue", -math.inf, math.inf, place), low, 1.0)
        stretch.append((start_s + after_s, value))
    stretches[str(name)].append(sorted(stretch, key=lambda point: point[0]))


def _course(stretches: list[list[tuple[float, float]]], rest: float) -> Breakpoints:
    """Return a control over time: at rest before its first point, held between stretches and after the last."""
    points: list[tuple[float, float]] = []
    for stretch in sorted((each for each in stretches if each), key=lambda each: each[0][0]):
        before = points[-1][1] if points else rest
        if stretch[0][0] > (points[-1][0] if points else 0.0):
            points.append((stretch[0][0], before))
        points += stretch
    points = sorted(points, key=lambda point: point[0]) or [(0.0, rest)]
    return Breakpoints(*(np.array(column) for column in zip(*points, strict=True)))


def _within(course: Breakpoints, start_s: float, end_s: float) -> Breakpoints:
    first = max(int(np.searchsorted(course.time_s, start_s)) - 1, 0)
    last = int(np.searchsorted(course.time_s, end_s, side="right")) + 1
    return Breakpoints(course.time_s[first:last], course.value[first:last])
