"""Phonemes with their times, of a TextGrid of Praat as aligners write it: ARPAbet, stress marks and silences passed
over.
"""

from __future__ import annotations

import re
from math import inf
from pathlib import Path

from tactuator.errors import BadInput, within
from tactuator.io.text import read_content, text_of
from tactuator.speech.taps import Phoneme

MOST_PHONEMES, LONGEST_S = 10_000, 3600.0
_ROUNDED_S, _CUT_S = 0.001, 0.01
"""Times may overlap by the first, as rounding leaves them, and exceed their tier's or file's end by the second."""
_OF_ARPABET = {
    "IY": "EE", "EY": "AY", "AY": "I", "AA": "AH", "AO": "AW", "OW": "OE", "UW": "OO", "HH": "H", "JH": "J",
    "AW": "OW", "AH": "UH", "UH": "UU",
}  # fmt: skip
"""Where TAPS has another name. The word lists of its rebuild have all but the last three (bee, bake, lie, lot, bore,
bow, due); those are what is left of both sets of 39."""
_ARPABET = frozenset((
    "AA", "AE", "AH", "AO", "AW", "AY", "B", "CH", "D", "DH", "EH", "ER", "EY", "F", "G", "HH", "IH", "IY", "JH", "K",
    "L", "M", "N", "NG", "OW", "OY", "P", "R", "S", "SH", "T", "TH", "UH", "UW", "V", "W", "Y", "Z", "ZH",
))  # fmt: skip
_SILENCES = frozenset(("", "SIL", "SP", "SPN", "PAU", "#", "<EPS>", "_"))
_TIMIT = frozenset((
    "AX", "AXR", "AX-H", "IX", "UX", "DX", "NX", "EL", "EM", "EN", "ENG", "HV", "Q", "BCL", "DCL", "GCL", "PCL", "TCL",
    "KCL", "EPI",
))  # fmt: skip
_TOKEN = re.compile(r'"((?:[^"]|"")*)"|(?<![\w.\[])(-?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)(?![\w\]])')


def read_textgrid(path: Path) -> tuple[Phoneme, ...]:
    """Return the phonemes of a TextGrid, by their names in TAPS.

    Raises BadInput for a phoneme that is not one of the 39, times that go back, or a file that holds no phonemes.
    """
    with within(str(path)):
        content = read_content(path)
        _require_plain_text(content[:100])
        spoken = [Phoneme(name, start_s) for label, start_s in _intervals(text_of(content)) if (name := _name(label))]
        if not 0 < len(spoken) <= MOST_PHONEMES:
            raise BadInput(f"{len(spoken)} phonemes", f"1 to {MOST_PHONEMES}")
        times = [each.start_s for each in spoken]
        if times[0] < 0.0 or times[-1] > LONGEST_S or times != sorted(times):
            raise BadInput(f"times that go back, or beyond 0 to {LONGEST_S:g} s", "phonemes in their order")
    return tuple(spoken)


def _require_plain_text(head: bytes) -> None:
    """Raise BadInput for Praat's other two forms of a TextGrid, by name."""
    for mark, form in ((b"ooBinaryFile", "binary"), (b"Praat chronological", "chronological")):
        if mark in head:
            raise BadInput(
                f"a TextGrid in Praat's {form} form", "text (in Praat: Save as text file, or as short text file)"
            )


def _phone_set(label: str, plain: str) -> str:
    """Return the name of the set of phones that a label is of, as far as it shows."""
    if not label.isascii():
        return " of the IPA"
    return " of TIMIT" if plain in _TIMIT or plain.startswith("H#") else ""


def _name(label: str) -> str:
    plain = label.strip().upper().rstrip("012")
    if plain in _SILENCES:
        return ""
    if plain not in _ARPABET:
        arpabet = f"ARPAbet, as of MFA's english_us_arpa: {', '.join(sorted(_ARPABET))}"
        raise BadInput(f"phoneme {label!r}{_phone_set(label, plain)}", arpabet)
    return _OF_ARPABET.get(plain, plain)


def _intervals(text: str) -> list[tuple[str, float]]:
    """Return the intervals of the tier of phones, in Praat's long or short text form: the order is the same."""
    tokens = [(words.replace('""', '"'), number) for words, number in _TOKEN.findall(text.partition('TextGrid"')[2])]
    tiers: dict[str, list[tuple[str, float, float]]] = {}
    ends: dict[str, float] = {}
    at, twice, begun, stated = 0, None, 0, ""
    try:
        while at < len(tokens):
            if tokens[at][0] not in ("IntervalTier", "TextTier"):
                at += 1
                continue
            stated, begun = stated if begun or not at else tokens[at - 1][1], begun + 1
            kind, name, count = tokens[at][0], tokens[at + 1][0], int(tokens[at + 4][1])
            step = 3 if kind == "IntervalTier" else 2
            rows = [tokens[at + 5 + step * n : at + 5 + step * (n + 1)] for n in range(min(count, MOST_PHONEMES + 1))]
            after = at + 5 + step * len(rows)
            is_last = after >= len(tokens) or tokens[after][0] in ("IntervalTier", "TextTier")
            if after > len(tokens) or (len(rows) == count and not is_last):  # the count does not hold
                raise ValueError
            if kind == "IntervalTier":
                twice = name if name in tiers else twice
                ends[name] = min(float(tokens[at + 3][1]), float(tokens[1][1]) if tokens[0][1] else inf)
                tiers[name] = [(row[2][0], float(row[0][1]), float(row[1][1])) for row in rows]
            at = after
        if stated not in ("", str(begun)):
            raise ValueError
    except (IndexError, ValueError):
        raise BadInput("a TextGrid that is cut off or damaged", "one that Praat has written as text") from None
    if twice is not None:
        raise BadInput(f"two tiers named {twice!r}", "a name for one tier")
    named = [name for name in tiers if "phon" in name.lower()] or list(tiers)
    if len(named) != 1:
        raise BadInput(f"tiers {', '.join(tiers) or 'none'}", "one interval tier, or one whose name has 'phon' in it")
    free_s, last_s = 0.0, ends[named[0]]
    for label, begin_s, end_s in tiers[named[0]]:
        if begin_s < free_s - _ROUNDED_S or end_s < begin_s:
            got = f"times that go back, or intervals that overlap, at {label!r}"
            raise BadInput(got, "one after another from 0 s on")
        if end_s == begin_s and _name(label):
            raise BadInput(f"{label!r} at {begin_s:g} s has no length", "intervals that last")
        if end_s > last_s + _CUT_S:
            got = f"{label!r} from {begin_s:g} to {end_s:g} s, and its tier or file ends at {last_s:g} s"
            raise BadInput(got, "intervals within their tier and file")
        free_s = end_s
    return [(label, begin_s) for label, begin_s, _ in tiers[named[0]]]
