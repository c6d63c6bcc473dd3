"""Haptic clips of other formats: strength and pitch over time, both from 0 to 1, without a unit; and `.haptic` 1.0.

A clip that breaks a rule of its format is refused, with the rule. What a format takes back to its range by itself, as
AHAP does, is done and counted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.text import parse_finite_json
from tactuator.plain import brief

LONGEST_S, MOST_POINTS = 600.0, 100_000
MOST_IN_ALL_S, MOST_IN_ALL_POINTS = 6000.0, 1_000_000
"""Of the tones of a clip together, which may overlap."""
_LARGEST = 1e300


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
    """A vibration from start_s to end_s."""

    start_s: float
    end_s: float
    strength: Breakpoints
    pitch: Breakpoints


@dataclass(frozen=True)
class Tap:
    """A short event, an emphasis or a transient."""

    time_s: float
    strength: float
    pitch: float


@dataclass(frozen=True, eq=False)
class Clip:
    """A clip: tones and taps. clamped: values that the format took back to its range. ignored: what the format says to
    pass over. unrendered: what the format knows, and is not rendered here.
    """

    format: Literal["haptic", "ahap"]
    duration_s: float
    tones: tuple[Tone, ...]
    taps: tuple[Tap, ...]
    clamped: int = 0
    ignored: tuple[str, ...] = ()
    unrendered: tuple[str, ...] = ()

    __repr__ = brief


def number_of(
    document: Mapping[str, Any], key: str, low: float, high: float, *where: str, missing: float | None = None
) -> float:
    """Return a number of a table, refused where it is none or outside its range. missing: where it is not there."""
    value = document.get(key, missing)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise BadInput("missing" if value is None else repr(value)[:60], "a number", where=where, key=key)
    if not abs(value) < _LARGEST:
        raise BadInput("beyond any number", "numbers below 1e300", where=where, key=key)
    if not low <= value <= high:
        bound = f"{low:g} or more" if math.isinf(high) else f"{low:g} to {high:g}"
        raise BadInput(f"{value:.9g}", bound, where=where, key=key)
    return float(value)


def part_of(document: Any, *path: str) -> Any:
    """Return the value at a path of keys. Raises BadInput for a key that is missing."""
    for depth, key in enumerate(path):
        if not isinstance(document, Mapping) or key not in document:
            raise BadInput("missing", where=path[:depth], key=key)
        document = document[key]
    return document


def rows_of(value: Any, *where: str) -> list[Mapping[str, Any]]:
    """Return a list of tables. Raises BadInput for anything else, and for more of them than are read."""
    if not isinstance(value, list) or not all(isinstance(row, Mapping) for row in value):
        raise BadInput("no list of tables", where=where)
    if len(value) > MOST_POINTS:
        raise BadInput(f"{len(value)} points", f"up to {MOST_POINTS}", where=where)
    return value


def check_amount(clip: Clip) -> None:
    """Raise BadInput for a clip with more in it than is rendered."""
    seconds = sum(tone.end_s - tone.start_s for tone in clip.tones)
    points = sum(tone.strength.time_s.size + tone.pitch.time_s.size for tone in clip.tones)
    if clip.duration_s > LONGEST_S or seconds > MOST_IN_ALL_S or points > MOST_IN_ALL_POINTS:
        got = f"{clip.duration_s:g} s, with tones of {seconds:g} s and {points} points"
        raise BadInput(got, f"{LONGEST_S:g} s, {MOST_IN_ALL_S:g} s and {MOST_IN_ALL_POINTS} points")


def parse_haptic(text: str, legacy: bool = False) -> Clip:
    """Return the clip of a .haptic file, version 1 (Meta Haptics SDK, haptic-file-spec.md).

    legacy: take one whose frequency outlasts its amplitude, as players of before the specification do: what comes after
    the end is not played.
    """
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
        end = f"up to the amplitude's end, {times[-1]:g} s; older players take it, and so does `legacy`"
        raise BadInput(f"a point at {at[-1]:g} s", end, where=("frequency",))
    pitch = [number_of(row, "frequency", 0.0, 1.0, f"frequency[{k}]") for k, row in enumerate(rows)]
    course = Breakpoints(np.array(at), np.array(pitch)) if at else Breakpoints(np.zeros(1), np.array([0.5]))
    tone = Tone(times[0], times[-1], Breakpoints(np.array(times), np.array(strength)), course)
    impulses = [f"an impulse of no length at {time_s:g} s" for time_s in _impulses(times, strength)]
    return Clip("haptic", times[-1], (tone,), tuple(taps), unrendered=tuple(impulses))


def _impulses(times: Sequence[float], strength: Sequence[float]) -> list[float]:
    """Return the times at which strength leaves its course and is back at the same instant: nothing comes of it."""
    found = []
    for k in range(1, len(times) - 1):
        if times[k - 1] == times[k] == times[k + 1] and strength[k] > max(strength[k - 1], strength[k + 1]):
            found.append(times[k])
    return found


def _times(rows: Sequence[Mapping[str, Any]], where: str) -> list[float]:
    times = [number_of(row, "time", 0.0, LONGEST_S, f"{where}[{k}]") for k, row in enumerate(rows)]
    for k, (before, after) in enumerate(pairwise(times)):
        if after < before:
            got, place = f"{after:g} s after {before:g} s", f"{where}[{k + 1}]"
            raise BadInput(got, "times that do not decrease", where=(place,))
    return times
