"""Reading of clips: a file by the ending of its name, and the format `.haptic` itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tactuator.errors import BadInput, within
from tactuator.io.text import parse_finite_json, read_text
from tactuator.patterns.ahap import parse_ahap
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
    """Return the times of an envelope's points, which do not go back."""
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
