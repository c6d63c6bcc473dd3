"""TAPS, the phonemic code for 24 tactors on a forearm (Reed et al., IEEE Trans. Haptics 12:2, 2019).

Tactors are counted from 0: columns of four from the elbow to the wrist, in each the first two dorsal, the last two
volar. The codes' parameters are those of google/audio-to-tactile's rebuild, extras/references/taps (facts, not code). A
burst there has one digital gain for both carriers; here each has its level in dB SL, the same for all.

Phonemes are read from a string, a text file, a table with times, or a TextGrid of Praat.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import ceil
from pathlib import Path

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.reference import ReferenceHead, curves_of
from tactuator.io.text import read_text
from tactuator.measure.error import ChannelPrediction
from tactuator.model.controller import Controller
from tactuator.patterns.rendering import ClipWave, Loss, loss_of
from tactuator.perception.curve import check_level
from tactuator.signals.decibels import db, from_db
from tactuator.speech.limiter import Limiter
from tactuator.table import brief

TACTORS, COLUMNS = 24, 6
HIGH_HZ, LOW_HZ = 300.0, 60.0
SPACING_S = 0.05
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


@dataclass(frozen=True, eq=False)
class CodedPhonemes:
    """Phonemes as a reference. reference: (n, channels), threshold units. spoken: each phoneme when its code begins.

    delayed_s: how long a code waited for the one before, at most. alike: phonemes that feel the same on this layout.
    moved: carriers that were moved into the band of every channel.
    """

    spoken: tuple[SpokenPhoneme, ...]
    head: ReferenceHead
    reference: FloatArray = field(repr=False)
    loss: Loss
    delayed_s: float
    alike: tuple[tuple[str, ...], ...]
    moved: tuple[float, ...]

    __repr__ = brief


def code_phonemes(
    spoken: Sequence[SpokenPhoneme],
    controller: Controller,
    level_db_sl: float,
    layout: Sequence[int] | None = None,
    spacing_s: float = SPACING_S,
) -> CodedPhonemes:
    """Return the codes of phonemes (by TAPS's names) on a controller's display, every burst at `level_db_sl`.

    A phoneme begins at its own time, or `spacing_s` after the code before it where that is later; without times, one
    comes after the other. layout: the channel of each of the 24 tactors. Raises BadInput for a level that is not below
    comfort, a layout of channels that are not there, and no phonemes at all.
    """
    check_level(level_db_sl)
    channels = controller.display.channels
    layout = usual_layout(len(channels)) if layout is None else layout
    if len(layout) != TACTORS or not all(0 <= channel < len(channels) for channel in layout):
        raise BadInput(f"a layout of {len(layout)} tactors onto {sorted(set(layout))}",
                       f"{TACTORS} tactors onto channels 0 to {len(channels) - 1}")  # fmt: skip
    if not spoken:
        raise BadInput("no phoneme", "one or more")
    placed, delayed_s = _placed(spoken, spacing_s)
    lows, highs = zip(*(channel.threshold.band_hz for channel in channels), strict=True)
    rate_hz, band = controller.rate_hz, (max(lows), min(highs))
    last = max((each.start_s or 0.0) + duration_s(each.name) for each in placed)
    asked = np.zeros((ceil(last * rate_hz) + 1, len(channels)))
    for each in placed:
        for burst in _laid_out(CODES[each.name], layout):
            first, wave = burst.wave(rate_hz, float(np.clip(burst.carrier_hz, *band)), each.start_s or 0.0)
            asked[first : first + wave.size, list(burst.tactors)] += wave[:, None]
    asked *= 10.0 ** (level_db_sl / 20.0)
    delivered = np.concatenate([block.copy() for block in Limiter(controller).process(iter([asked]))])[: len(asked)]
    provenance = {"coding": "taps", "level_db_sl": level_db_sl, "layout": list(layout),
                  "phonemes": [each.name for each in placed]}  # fmt: skip
    names = tuple(channel.name for channel in channels)
    head = ReferenceHead(rate_hz, names, curves_of(channels), (min(lows), max(highs)), provenance=provenance)
    moved = tuple(hertz for hertz in (LOW_HZ, HIGH_HZ) if not band[0] <= hertz <= band[1])
    wave = asked.max(axis=1)
    loss = loss_of(asked, delivered, controller, ClipWave(wave, wave, (), 0.0))
    return CodedPhonemes(tuple(placed), head, delivered, loss, delayed_s, alike(layout), moved)


def _placed(spoken: Sequence[SpokenPhoneme], spacing_s: float) -> tuple[list[SpokenPhoneme], float]:
    """Return the phonemes with the time at which each code begins, and the longest wait of one."""
    placed: list[SpokenPhoneme] = []
    free_s, delayed_s = 0.0, 0.0
    for each in spoken:
        if each.name not in CODES:
            raise BadInput(f"phoneme {each.name!r}", ", ".join(sorted(CODES)))
        wanted_s = free_s if each.start_s is None else each.start_s
        start_s = max(wanted_s, free_s)
        delayed_s = max(delayed_s, start_s - wanted_s)
        placed.append(replace(each, start_s=start_s))
        free_s = start_s + duration_s(each.name) + spacing_s
    return placed, delayed_s


def felt_levels_db(controller: Controller, level_db_sl: float, layout: Sequence[int]) -> dict[str, tuple[float, float]]:
    """Return the level at which each of the 39 is felt, dB SL by the display's model: by one digital gain for both
    carriers and all tactors, whose mean over the phonemes is `level_db_sl`, and by the controller.

    A phoneme's level is that of its mean power over bursts, tactors and their time; the limiter is not in it.
    """
    carriers = np.array([LOW_HZ, HIGH_HZ])
    driven, designed = [], []
    for channel in controller.display.channels:
        volts = np.abs(channel.plant.response(carriers))
        driven.append(db(volts / channel.threshold_voltage(carriers)))
        designed.append(level_db_sl + db(np.abs(ChannelPrediction.of(controller, channel.name).felt(carriers))))
    means = [_means_db(np.array(levels), layout) for levels in (driven, designed)]
    shift = level_db_sl - float(np.mean(list(means[0].values())))
    return {name: (means[0][name] + shift, means[1][name]) for name in CODES}


def _means_db(levels_db: FloatArray, layout: Sequence[int]) -> dict[str, float]:
    """Return the level of each phoneme's mean power, from those of channels and carriers, (channels, 2)."""
    means = {}
    for name, code in CODES.items():
        bursts = [
            (burst.duration_s, from_db(levels_db[channel, int(burst.carrier_hz == HIGH_HZ)]) ** 2)
            for burst in _laid_out(code, layout)
            for channel in burst.tactors
        ]
        time, power = np.array(bursts).T
        means[name] = float(0.5 * db(np.sum(time * power) / np.sum(time)))
    return means


NOTATIONS = "arpabet", "taps"
MOST_PHONEMES = 10_000
_OF_ARPABET = {
    "IY": "EE", "EY": "AY", "AY": "I", "AA": "AH", "AO": "AW", "OW": "OE", "UW": "OO", "HH": "H", "JH": "J",
    "AW": "OW", "AH": "UH", "UH": "UU",
}  # fmt: skip
"""Where TAPS has another name. The word lists of its rebuild have all but the last three (bee, bake, lie, lot, bore,
bow, due); those are what is left of both sets of 39."""
_ARPABET = frozenset(
    [
        "AA",
        "AE",
        "AH",
        "AO",
        "AW",
        "AY",
        "B",
        "CH",
        "D",
        "DH",
        "EH",
        "ER",
        "EY",
        "F",
        "G",
        "HH",
        "IH",
        "IY",
        "JH",
        "K",
        "L",
        "M",
        "N",
        "NG",
        "OW",
        "OY",
        "P",
        "R",
        "S",
        "SH",
        "T",
        "TH",
        "UH",
        "UW",
        "V",
        "W",
        "Y",
        "Z",
        "ZH",
    ]
)
_SILENCES = frozenset(("", "SIL", "SP", "SPN", "PAU", "#", "<EPS>", "_"))
_TOKEN = re.compile(r'"((?:[^"]|"")*)"|(?<![\w.\[])(-?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)(?![\w\]])')


@dataclass(frozen=True)
class SpokenPhoneme:
    """A phoneme, by its name in TAPS. start_s: when it begins; None: after the one before."""

    name: str
    start_s: float | None = None


def phonemes_of(text_or_path: str, notation: str = "arpabet") -> tuple[SpokenPhoneme, ...]:
    """Return the phonemes of a file (.TextGrid; .csv with phoneme and start_s; .txt), or of a string such as
    "HH AH L OW". Stress marks and silences are passed over.

    Raises BadInput for a phoneme that is not one of the 39, another notation,
    times that go back, or a file that holds no phonemes.
    """
    if notation not in NOTATIONS:
        raise BadInput(f"notation {notation!r}", " or ".join(NOTATIONS))
    path = Path(text_or_path)
    readers: dict[str, Callable[[str], Iterator[tuple[str, float | None]]]] = {
        ".textgrid": _of_textgrid, ".csv": _of_csv, ".txt": _of_text
    }  # fmt: skip
    reader = readers.get(path.suffix.lower())
    try:
        rows = reader(read_text(path)) if reader else _of_text(text_or_path)
        spoken = tuple(SpokenPhoneme(name, start_s) for label, start_s in rows if (name := _name(label, notation)))
        if not 0 < len(spoken) <= MOST_PHONEMES:
            raise BadInput(f"{len(spoken)} phonemes", f"1 to {MOST_PHONEMES}")
        times = [each.start_s for each in spoken if each.start_s is not None]
        if any(time < 0.0 for time in times) or times != sorted(times):
            raise BadInput("times that go back, or below 0", "phonemes in their order")
    except BadInput as error:
        raise (error.within(text_or_path) if reader else error) from None
    return spoken


def _name(label: str, notation: str) -> str:
    spelt = label.strip().upper()
    if spelt in _SILENCES:
        return ""
    if notation == "taps":
        return spelt
    plain = spelt.rstrip("012")
    if plain not in _ARPABET:
        raise BadInput(f"phoneme {label!r}", f"ARPAbet: {', '.join(sorted(_ARPABET))}")
    return _OF_ARPABET.get(plain, plain)


def _of_text(text: str) -> Iterator[tuple[str, float | None]]:
    yield from ((label, None) for label in re.split(r"[\s,]+", text.strip()))


def _of_csv(text: str) -> Iterator[tuple[str, float | None]]:
    rows = csv.DictReader(text.splitlines())
    if not {"phoneme", "start_s"} <= set(rows.fieldnames or ()):
        raise BadInput(f"columns {', '.join(rows.fieldnames or ('none',))}", "phoneme and start_s")
    for row in rows:
        try:
            yield row["phoneme"] or "", float(row["start_s"])
        except (TypeError, ValueError):
            raise BadInput(f"start_s {row['start_s']!r}", "a number of seconds") from None


def _of_textgrid(text: str) -> Iterator[tuple[str, float | None]]:
    """Yield the intervals of the tier of phones, in Praat's long or short text form: the order is the same."""
    tokens = [(words.replace('""', '"'), number) for words, number in _TOKEN.findall(text.partition('TextGrid"')[2])]
    tiers: dict[str, list[tuple[str, float | None]]] = {}
    at = 0
    try:
        while at < len(tokens):
            if tokens[at][0] not in ("IntervalTier", "TextTier"):
                at += 1
                continue
            kind, name, count = tokens[at][0], tokens[at + 1][0], int(tokens[at + 4][1])
            step = 3 if kind == "IntervalTier" else 2
            rows = [tokens[at + 5 + step * n : at + 5 + step * (n + 1)] for n in range(min(count, MOST_PHONEMES + 1))]
            if kind == "IntervalTier":
                tiers[name] = [(row[2][0], float(row[0][1])) for row in rows]
            at += 5 + step * len(rows)
    except (IndexError, ValueError):
        raise BadInput("a TextGrid that is cut off or damaged", "one that Praat has written as text") from None
    named = [name for name in tiers if "phon" in name.lower()] or list(tiers)
    if len(named) != 1:
        raise BadInput(f"tiers {', '.join(tiers) or 'none'}", "one interval tier, or one whose name has 'phon' in it")
    yield from tiers[named[0]]
