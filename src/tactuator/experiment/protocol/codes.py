"""What spreadsheets and statistics programs make of a code: 007 is their 7, SEP1 a date, NA a value that is missing."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

_MISSING = frozenset(["na", "n/a", "nan", "null", "none", "nil", "missing", "inf", "infinity"])
_LOGICAL = frozenset(["t", "f", "true", "false", "wahr", "falsch", "vrai", "faux"])
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?|0x[0-9a-f]+")
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
    """Return what other programs take a code for that they do not keep as it is written; "" where they keep it."""
    folded = text.strip().casefold()
    if folded in _MISSING:
        return "a missing value"
    if folded in _LOGICAL:
        return "true or false"
    if _NUMBER.fullmatch(folded):
        return "" if _PLAIN.fullmatch(folded) else f"the number {_value(folded):.15g}"
    return "a date or time" if _DATE.fullmatch(folded) else ""


def _value(number: str) -> float:
    return float(int(number, 16)) if number.startswith("0x") else float(number)


def doubts(code: str, others: Iterable[str]) -> Iterator[str]:
    """Yield what becomes of a code in other programs: what it is taken for, and which others it is mixed with."""
    taken = taken_for(code)
    if taken:
        yield f"{code!r} is {taken} to spreadsheets"
    alike = [other for other in others if other != code and _same(other) == _same(code)]
    if alike:
        yield f"{code!r} is mixed with {', '.join(map(repr, alike))} by other programs"


def _same(code: str) -> str:
    folded = code.strip().casefold()
    return f"{_value(folded):.15g}" if _NUMBER.fullmatch(folded) else folded
