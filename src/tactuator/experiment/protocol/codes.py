"""What spreadsheets and statistics programs make of a code: 007 is their 7, SEP1 a date, NA a value that is missing."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from tactuator.experiment.words import Words

_MISSING = frozenset(["na", "n/a", "nan", "null", "none", "nil", "missing", "inf", "infinity"])
_LOGICAL = frozenset(["t", "f", "true", "false", "wahr", "falsch", "vrai", "faux"])
_NUMBER = re.compile(r"[+-]?(\d++\.?\d*+|\.\d++)(e[+-]?\d++)?|0x[0-9a-f]+")
_PLAIN = re.compile(r"-?(0|[1-9]\d{0,14})")
"""Numbers that are written as they were read."""
_MONTH = (
    r"(jan(uary|uar|v|vier)?|feb(ruary|ruar)?|fevr?(ier)?|mar(ch|s)?|mrz|maerz|apr(il)?|avr(il)?|ma[iy]|june?|juni|juin|july?"
    r"|juli|juil(let)?|aug(ust)?|aout|sept?(ember|embre)?|o[ck]t(ober|obre)?|nov(ember|embre)?|de[cz](ember|embre)?)"
)
_GAP, _DAY = r"[-. /]?", r"\d{1,4}"
_DATE = re.compile(
    rf"{_MONTH}{_GAP}{_DAY}|{_DAY}{_GAP}{_MONTH}({_GAP}{_DAY})?|{_DAY}[-./]{_DAY}([-./]{_DAY})?|\d{{1,2}} ?[ap]m?"
)


def taken_for(text: str) -> str:
    """Return what other programs take a code for that they do not keep as it is written; "" where they keep it.

    It is a key of the words: missing, logical, number, date.
    """
    folded = text.strip().casefold()
    if folded in _MISSING:
        return "missing"
    if folded in _LOGICAL:
        return "logical"
    if _NUMBER.fullmatch(folded):
        return "" if _PLAIN.fullmatch(folded) else "number"
    return "date" if _DATE.fullmatch(folded) else ""


def doubts(code: str, others: Iterable[str], words: Words) -> Iterator[str]:
    """Yield what becomes of a code in other programs: what it is taken for, and which others it is mixed with."""
    taken = taken_for(code)
    if taken:
        yield words(f"codes.{taken}", code=code, value=_read(code))
    alike = [other for other in others if other != code and _read(other) == _read(code)]
    if alike:
        yield words("codes.mixed", code=code, others=", ".join(alike))


def _read(code: str) -> str:
    """Return a code as programs read it that know numbers, and no case of letters."""
    folded = code.strip().casefold()
    if not _NUMBER.fullmatch(folded):
        return folded
    return f"{float(int(folded, 16)) if folded.startswith('0x') else float(folded):.15g}"
