"""Phonemes of an utterance: from a string, a text file, a table with times, or a TextGrid of Praat."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from tactuator.errors import BadInput
from tactuator.io.text import read_text

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
    """Return a phoneme's name in TAPS, "" for a silence."""
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
    """Yield the intervals of the tier of phones, in Praat's long or short text form: both have the same values in the
    same order.
    """
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
