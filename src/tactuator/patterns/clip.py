"""Haptic clips as other formats write them: strength and pitch over time, none of it with a unit.

The nouns, and the checks that the readers of all formats share. A clip that breaks a rule of its format is refused,
with the rule. What a format takes back to its range by itself, as AHAP does, is done and counted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.table import brief

Format = Literal["haptic", "ahap", "android-basic", "android-advanced", "hjif"]
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
    range. ignored: what the format says to pass over. unrendered: what the format knows, and is not rendered here.
    unsure: what the format allows, and not every device has to play.
    """

    name: str
    format: Format
    duration_s: float
    tones: tuple[Tone, ...]
    taps: tuple[Tap, ...]
    pitch_in_hz: bool = False
    clamped: int = 0
    ignored: tuple[str, ...] = ()
    unrendered: tuple[str, ...] = ()
    unsure: tuple[str, ...] = ()

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
    """Return what stands at a path of keys. Raises BadInput for a key that is missing."""
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


def whole_of(document: Any, key: str, low: int, high: int, *where: str) -> int:
    """Return a whole number of a table, as `number_of` does."""
    value = number_of(document, key, low, high, *where)
    if value != int(value):
        raise BadInput(f"{value:g}", "a whole number", where=where, key=key)
    return int(value)


def check_amount(clip: Clip) -> None:
    """Raise BadInput for a clip with more in it than is rendered."""
    seconds = sum(tone.end_s - tone.start_s for tone in clip.tones)
    points = sum(tone.strength.time_s.size + tone.pitch.time_s.size for tone in clip.tones)
    if clip.duration_s > LONGEST_S or seconds > MOST_IN_ALL_S or points > MOST_IN_ALL_POINTS:
        got = f"{clip.duration_s:g} s, with tones of {seconds:g} s and {points} points"
        raise BadInput(got, f"{LONGEST_S:g} s, {MOST_IN_ALL_S:g} s and {MOST_IN_ALL_POINTS} points")
