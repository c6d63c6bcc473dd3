"""TAPS, the phonemic code for 24 tactors on a forearm (Reed et al., IEEE Trans. Haptics 12:2, 2019).

Tactors are counted from 0: columns of four from the elbow to the wrist, in each the first two dorsal, the last two
volar. The codes' parameters are those of google/audio-to-tactile's rebuild, extras/references/taps (facts, not code). A
burst there has one digital gain for both carriers; here each has its level in dB SL, the same for all.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import ceil
from pathlib import Path

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.text import read_text
from tactuator.model.controller import Controller
from tactuator.perception.curve import check_level
from tactuator.signals.decibels import from_db
from tactuator.speech.clip_signal import moved_into
from tactuator.speech.signal import Signal, loss_of

TACTORS, COLUMNS = 24, 6
HIGH_HZ, LOW_HZ = 300.0, 60.0
_SPACING_S = 0.05
"""Least silence between two codes, as in the rebuild's lessons."""
Tactors = tuple[int, ...]


@dataclass(frozen=True)
class Burst:
    """A carrier on some tactors. transition_s: of its squared Tukey window. depth: of its modulation, a sine."""

    tactors: Tactors
    start_s: float
    duration_s: float
    carrier_hz: float = HIGH_HZ
    modulation_hz: float = 0.0
    depth: float = 0.0
    transition_s: float = 0.005

    def wave(self, rate_hz: float, carrier_hz: float, code_s: float = 0.0) -> tuple[int, FloatArray]:
        """Return its first sample where its code begins at `code_s`, and its wave at `carrier_hz`, (n,), with the
        energy of an unmodulated burst of amplitude 1.
        """
        start_s = code_s + self.start_s
        first = ceil(start_s * rate_hz)
        time = np.arange(first, ceil((start_s + self.duration_s) * rate_hz)) / rate_hz - start_s
        edge = np.minimum(time, self.duration_s - time) / self.transition_s
        window = np.sin(0.5 * np.pi * np.clip(edge, 0.0, 1.0)) ** 4
        modulated = window * (1.0 + self.depth * np.sin(2.0 * np.pi * self.modulation_hz * time))
        scale = np.sqrt(np.sum(window**2) / np.sum(modulated**2))
        return first, np.asarray(scale * modulated * np.sin(2.0 * np.pi * carrier_hz * time))


Code = tuple[Burst, ...]


def _still(tactors: Iterable[int], duration_s: float, **more: float) -> Code:
    return (Burst(tuple(tactors), 0.0, duration_s, **more),)


def _moving(groups: Sequence[Tactors], starts_s: Sequence[float], duration_s: float, **more: float) -> Code:
    return tuple(Burst(group, start, duration_s, **more) for group, start in zip(groups, starts_s, strict=True))


_FAST, _SLOW = {"modulation_hz": 30.0, "depth": 0.5}, {"modulation_hz": 8.0, "depth": 0.5}
_NASAL = {"carrier_hz": LOW_HZ, "modulation_hz": 8.0, "depth": 1.0}
_SHORT_S, _LONG_S = 0.14, 0.4
_WRIST_BACK, _MIDDLE_FRONT, _ELBOW_BACK = (16, 17, 20, 21), (10, 11, 14, 15), (0, 1, 4, 5)
_MIDDLE_BACK, _ELBOW_FRONT, _WRIST_FRONT = (8, 9, 12, 13), (2, 3, 6, 7), (18, 19, 22, 23)
_ENDS, _SIDE = (0, 1, 20, 21), tuple(range(8, 24, 2))
_J_DEPTH = (0.1375 - 0.0155) / (0.1375 + 0.0155)
_TWINKLE_S = tuple(start + turn for turn in (0.0, 0.2) for start in (0.0, 0.0333, 0.0666, 0.1, 0.1332, 0.166))
_TAPS_S = (0.0, 0.0472, 0.0939, 0.1412, 0.1888, 0.236, 0.2824, 0.3295, 0.3767)
_RUMBLE_S = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.3495)


def _each(*tactors: int) -> list[Tactors]:
    return [(tactor,) for tactor in tactors]


def _pairs(*firsts: int) -> list[Tactors]:
    return [(first, first + 1) for first in firsts]


CODES: Mapping[str, Code] = {
    "P": _still(_WRIST_BACK, _SHORT_S), "T": _still(_MIDDLE_FRONT, _SHORT_S), "K": _still(_ELBOW_BACK, _SHORT_S),
    "B": _still(_WRIST_BACK, _SHORT_S, **_FAST), "D": _still(_MIDDLE_FRONT, _SHORT_S, **_FAST),
    "G": _still(_ELBOW_BACK, _SHORT_S, **_FAST),
    "F": _still(range(20, 24), _LONG_S), "V": _still(range(20, 24), _LONG_S, **_SLOW),
    "TH": _still(_MIDDLE_BACK, _LONG_S), "DH": _still(_MIDDLE_BACK, _LONG_S, **_SLOW),
    "S": _still(range(4), _LONG_S), "Z": _still(range(4), _LONG_S, **_SLOW),
    "SH": _still(_WRIST_FRONT, _LONG_S), "ZH": _still(_ELBOW_FRONT, _LONG_S, **_SLOW),
    "CH": _still(_ENDS, _LONG_S, transition_s=0.2), "J": _still(_ENDS, _LONG_S, modulation_hz=8.0, depth=_J_DEPTH),
    "H": _still(range(12, 20), _LONG_S, carrier_hz=LOW_HZ, transition_s=0.2),
    "M": _still(_WRIST_BACK, _LONG_S, **_NASAL), "N": _still(_MIDDLE_FRONT, _LONG_S, **_NASAL),
    "NG": _still(_ELBOW_BACK, _LONG_S, **_NASAL),
    "R": _still(_ELBOW_FRONT, _LONG_S, **_FAST), "L": _still(_WRIST_FRONT, _LONG_S, **_FAST),
    "W": _still(_SIDE, _LONG_S, **_NASAL), "Y": _still(_SIDE, _LONG_S, carrier_hz=LOW_HZ),
    "EE": _moving(_each(20, 16, 12, 8, 4, 0), (0.0, 0.0612, 0.1224, 0.1836, 0.2448, 0.3063), 0.09333),
    "IH": _moving(_each(0, 4, 8, 12), (0.0, 0.06, 0.12, 0.18), 0.06),
    "AY": _moving(_each(8, 12, 16, 20, 21, 17, 13, 9), _RUMBLE_S, 0.05, **_FAST),
    "EH": _moving([tuple(range(4)), tuple(range(12, 16))], (0.0, 0.14395), 0.09603),
    "AE": _moving(_each(*(8, 9, 5, 1, 0, 4) * 2), _TWINKLE_S, 0.03333),
    "AH": _moving(_pairs(0, 4, 8, 12, 16, 20), (0.0, 0.0666, 0.1332, 0.2, 0.2666, 0.3333), 0.06667, carrier_hz=LOW_HZ),
    "AW": _moving(_each(*(22, 23, 19, 15, 14, 18) * 2), _TWINKLE_S, 0.03333),
    "OE": _moving(
        [(8, 12), (9, 13), (10, 14), (11, 15), (8, 12)], (0.0, 0.07, 0.14, 0.21, 0.28), 0.12, transition_s=0.06
    ),
    "UU": _moving(_pairs(2, 6, 10, 14), (0.0, 0.06, 0.12, 0.18), 0.06, **_FAST),
    "OO": _moving(_pairs(22, 18, 14, 10, 6, 2), (0.0, 0.0666, 0.1333, 0.2, 0.2666, 0.3333), 0.0667, **_FAST),
    "UH": _moving([tuple(range(20, 24)), tuple(range(8, 12))], (0.0, 0.1439), 0.09604),
    "ER": _moving(_each(*(11, 10, 6, 2, 3, 7) * 2), _TWINKLE_S, 0.03333),
    "I": _moving(_pairs(2, 6, 10, 14, 12, 8, 4, 0), _RUMBLE_S, 0.05, **_FAST),
    "OW": _moving(_each(*(20,) * 3, *(12,) * 3, *(4,) * 3), _TAPS_S, 0.024),
    "OY": _moving(_each(*(6,) * 3, *(14,) * 3, *(22,) * 3), _TAPS_S, 0.024),
}  # fmt: skip
"""The 39 codes by their names in TAPS."""


def duration_s(name: str) -> float:
    """Return how long a phoneme's code takes."""
    return max(burst.start_s + burst.duration_s for burst in CODES[name])


def usual_layout(channels: int) -> tuple[int, ...]:
    """Return the channel of each tactor: its own where there are 24, or, for up to six channels, that of its column:
    a reduced code. Raises BadInput for another number, whose layout has to be given.
    """
    if channels >= TACTORS:
        return tuple(range(TACTORS))
    if channels > COLUMNS:
        raise BadInput(f"{channels} channels and no layout", f"{TACTORS}, up to {COLUMNS}, or a layout of one's own")
    return tuple(tactor * COLUMNS // TACTORS * channels // COLUMNS for tactor in range(TACTORS))


def alike(layout: Sequence[int]) -> tuple[tuple[str, ...], ...]:
    """Return the groups of phonemes whose codes are the same on a layout."""
    groups: dict[frozenset[Burst], list[str]] = {}
    for name, code in CODES.items():
        groups.setdefault(frozenset(_laid_out(code, layout)), []).append(name)
    return tuple(tuple(names) for names in groups.values() if len(names) > 1)


def _laid_out(code: Code, layout: Sequence[int]) -> list[Burst]:
    return [replace(burst, tactors=tuple(sorted({layout[tactor] for tactor in burst.tactors}))) for burst in code]


def read_layout(path: Path, channels: Sequence[str]) -> tuple[int, ...]:
    """Return the channel of each tactor, of a CSV file with the columns tactor (1 to 24) and channel (a name).

    Raises BadInput unless each of the 24 has one of the display's.
    """
    rows = list(csv.DictReader(read_text(path).splitlines()))
    try:
        named = {int(row["tactor"]): row["channel"].strip() for row in rows}
        layout = tuple(channels.index(named[tactor]) for tactor in range(1, TACTORS + 1))
        if len(rows) != len(layout):
            raise ValueError
    except (KeyError, ValueError, TypeError, AttributeError):
        allowed = f"columns tactor and channel, each tactor of 1 to {TACTORS} once, on {', '.join(channels)}"
        raise BadInput("a layout that is none", allowed, where=(str(path),)) from None
    return layout


@dataclass(frozen=True)
class Phoneme:
    """A phoneme, by its name in TAPS, and when it begins."""

    name: str
    start_s: float = 0.0


def taps_signal(
    phonemes: Sequence[Phoneme], controller: Controller, level_db_sl: float, layout: Sequence[int] | None = None
) -> Signal:
    """Return the codes of phonemes on a display, every burst at `level_db_sl` on its own channel.

    A phoneme begins at its own time, or a moment after the code before it where that is later. layout: the channel of
    each of the 24 tactors; None: the usual one. Carriers beyond the band that all channels have are moved into it.
    Raises BadInput for a level that is not below comfort, and a layout of channels that are not there.
    """
    check_level(level_db_sl)
    channels = controller.display.channels
    layout = usual_layout(len(channels)) if layout is None else layout
    if len(layout) != TACTORS or not all(0 <= channel < len(channels) for channel in layout):
        raise BadInput(f"a layout of {len(layout)} tactors onto {sorted(set(layout))}",
                       f"{TACTORS} tactors onto channels 0 to {len(channels) - 1}")  # fmt: skip
    placed, delayed_s = _placed(phonemes)
    lows, highs = zip(*(channel.threshold.band_hz for channel in channels), strict=True)
    rate_hz, band = controller.rate_hz, (max(lows), min(highs))
    asked = np.zeros((ceil(max(each.start_s + duration_s(each.name) for each in placed) * rate_hz) + 1, len(channels)))
    carriers = {burst.carrier_hz for each in placed for burst in CODES[each.name]}
    _, shift_jnd = moved_into(np.array(sorted(carriers)), band)
    for each in placed:
        for burst in _laid_out(CODES[each.name], layout):
            first, wave = burst.wave(rate_hz, float(np.clip(burst.carrier_hz, *band)), each.start_s)
            asked[first : first + wave.size, list(burst.tactors)] += wave[:, None]
    asked *= from_db(level_db_sl)
    about = {
        "duration_s": len(asked) / rate_hz, "phonemes": [vars(each) for each in placed], "layout": list(layout),
        "alike": alike(layout), "delayed_s": delayed_s,
    }  # fmt: skip
    notes = [*layout_notes(layout)]
    if delayed_s > 0.0:
        notes.append(f"codes wait for the one before by up to {delayed_s:.2f} s")
    loss = partial(loss_of, asked, rate_hz=rate_hz, shift_jnd=shift_jnd)
    return Signal(len(asked), iter([asked]), about, tuple(notes), loss)


def layout_notes(layout: Sequence[int]) -> tuple[str, ...]:
    """Return what a layout makes of the code: how few channels it has, and which phonemes are felt alike on them."""
    used, same = len(set(layout)), "; ".join(", ".join(names) for names in alike(layout))
    return (
        *([f"a reduced code: {TACTORS} tactors on {used} channels"] if used < TACTORS else []),
        *([f"these are felt alike: {same}"] if same else []),
    )


def _placed(phonemes: Sequence[Phoneme]) -> tuple[list[Phoneme], float]:
    """Return the phonemes with the time at which each code begins, and the longest wait of one."""
    placed: list[Phoneme] = []
    free_s, delayed_s = 0.0, 0.0
    for each in phonemes:
        start_s = max(each.start_s, free_s)
        delayed_s = max(delayed_s, start_s - each.start_s)
        placed.append(replace(each, start_s=start_s))
        free_s = start_s + duration_s(each.name) + _SPACING_S
    return placed, delayed_s
