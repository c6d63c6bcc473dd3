"""What a name says: the words, unit and quantity of a column, the rate or the change of values that is stated."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from tactuator.errors import BadInput

_KINDS: Mapping[str, Mapping[str, float]] = {
    "frequency": {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6, "GHz": 1e9, "mHz": 1e-3, "hertz": 1.0, "rpm": 1.0 / 60.0,
                  "cpm": 1.0 / 60.0},
    "angular": {"rad/s": 0.5 / math.pi, "rad/sec": 0.5 / math.pi},
    "time": {"s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "usec": 1e-6,
             "ns": 1e-9, "nsec": 1e-9, "millisecond": 1e-3, "milliseconds": 1e-3, "microsecond": 1e-6,
             "microseconds": 1e-6, "min": 60.0, "hour": 3600.0, "hours": 3600.0},
    "angle": {**dict.fromkeys(("deg", "degree", "degrees", "\u00b0"), math.pi / 180.0),
              **dict.fromkeys(("rad", "radian", "radians"), 1.0), "mrad": 1e-3, "pi rad": math.pi,
              "gon": math.pi / 200.0,
              **dict.fromkeys(("cycle", "cycles", "turn", "turns"), 2.0 * math.pi)},
    "level": {"dB": 1.0, "decibel": 1.0, "decibels": 1.0, "mdB": 1e-3, "Np": 20.0 / math.log(10.0)},
    "displacement": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, **{
        f"{part}{metre}": factor for part, factor in (("", 1.0), ("milli", 1e-3), ("micro", 1e-6))
        for metre in ("meter", "meters", "metre", "metres")}},
    "velocity": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "um/s": 1e-6},
    "acceleration": {"m/s2": 1.0, "mm/s2": 1e-3, "g": 9.80665, "mg": 9.80665e-3},
    "voltage": {"V": 1.0, "mV": 1e-3, "uV": 1e-6, "kV": 1e3, "volt": 1.0, "volts": 1.0},
    "current": {"A": 1.0, "mA": 1e-3, "uA": 1e-6, "amp": 1.0, "amps": 1.0, "ampere": 1.0, "amperes": 1.0},
    "force": {"N": 1.0, "mN": 1e-3, "kN": 1e3},
    "share": {"%": 0.01, "percent": 0.01, "ppm": 1e-6},
    "torque": {"Nm": 1.0, "N m": 1.0, "mNm": 1e-3},
    "impedance": {"ohm": 1.0, "ohms": 1.0, "\u03c9": 1.0},
}  # fmt: skip
"""Units by kind, each with its factor to the kind's own: Hz, s, rad, dB, m, m/s, m/s², V, A, N, ohm."""
QUANTITIES = ("displacement", "velocity", "acceleration")
_WORDS = {
    "displacement": "displ|posit|deflec|excurs|stroke|travel|(pos|disp)$",
    "velocity": "veloc|speed|vel$",
    "acceleration": "accel|acc$",
    "force": "force|torque|mass|weight",
}
_CANONICAL = {
    f"{part}{metre}": unit for part, unit in (("", "m"), ("milli", "mm"), ("micro", "um"))
    for metre in ("meter", "meters", "metre", "metres")
} | {"volt": "V", "volts": "V", "amp": "A", "amps": "A", "ampere": "A", "amperes": "A"}  # fmt: skip
_SPELLINGS = (
    ("\u00b5", "u"), ("\u03bc", "u"), ("\u00b2", "2"), ("^", ""), ("*", ""), ("\u00b7", ""), ("_", "/"), (" per ", "/"),
    ("/per/", "/"), ("/s/2", "/s2"), ("/s/s", "/s2"), (" s-1", "/s"), (" s-2", "/s2"), ("\u03c0 rad", "pi rad"),
)  # fmt: skip
_LONGEST_UNIT = 200
_ONE_LETTER = "vsm"
"""Units of one letter that a name may end in as a small one: `command_v`; `_a` and `_n` are numbers of channels."""


@dataclass(frozen=True)
class Unit:
    """A unit. text: as models name it; kind: of quantity, "" for one that is not known; factor: to the kind's own."""

    text: str = ""
    kind: str = ""
    factor: float = 1.0


NO_UNIT = Unit()
_UNITS = {
    text: Unit(_CANONICAL.get(text, text), kind, factor)
    for kind, units in _KINDS.items()
    for text, factor in units.items()
}
_ALIKE = {name.casefold(): [unit for other, unit in _UNITS.items() if other.casefold() == name.casefold()]
          for name in _UNITS}  # fmt: skip


def unit_of(text: str) -> Unit | None:
    """Return the unit that a text names; None for another text. Raises BadInput for one that two units are."""
    plain = text.strip(" .[](){}")
    if len(plain) > _LONGEST_UNIT:
        return None
    for other, usual in _SPELLINGS:
        plain = plain.replace(other, usual)
    plain = plain.removeprefix("in ")
    if plain in _UNITS:
        return _UNITS[plain]
    if re.match(r"(?i)db(?:20|v|u|m|spl|fs)?\b(?!\s*[/x*]\s*\d)", plain):
        return Unit("dB", "level")
    if ratio := re.fullmatch(r"\(?(.+?)\)?/\(?(?:[mk]?V|[mu]?A|[mk]?N)\)?", plain):
        return unit_of(ratio[1])
    if plain.casefold() == "grad":
        raise BadInput(f"the unit {text!r} may be degrees or gradians", "deg or gon, as NAME=UNIT")
    alike = _ALIKE.get(plain.casefold(), [])
    if len(alike) > 1:
        raise BadInput(
            f"the unit {text!r} may be {' or '.join(unit.text for unit in alike)}",
            "one spelt as these are, as NAME=UNIT",
        )
    one_letter = len(plain) == 1 and plain.casefold() not in _ONE_LETTER
    return alike[0] if alike and not one_letter else None


@dataclass(frozen=True)
class ColumnName:
    """The name of a column. text: as the file has it; base: without its unit; is_stated: another place has its unit;
    guessed: the unit that its ending may be, where another is stated; is_bracketed: the unit is in brackets; unknown:
    what its brackets have where that is no unit, or a unit with a factor beside it.
    """

    text: str
    base: str
    unit: Unit = NO_UNIT
    is_stated: bool = False
    unknown: str = ""
    is_bracketed: bool = False
    guessed: str = ""

    @property
    def words(self) -> frozenset[str]:
        """Return the words of the name, without its unit, in small letters."""
        parted = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", self.base)
        return frozenset(word.casefold() for word in re.findall(r"[^\W_]+|[\u00b0\u2220]", parted))

    def has(self, *starts: str) -> bool:
        """Return whether one of its words begins so."""
        return any(word.startswith(starts) for word in self.words)

    @property
    def is_unknown(self) -> bool:
        """Return whether a unit is stated, and none that is known."""
        return bool(self.unknown) and not self.unit.text

    @property
    def quantity(self) -> str:
        """Return the quantity by name and unit, "" where neither says it. Raises BadInput where they contradict and the
        unit is not stated.
        """
        spoken = (kind for kind, starts in _WORDS.items() if any(re.match(starts, word) for word in self.words))
        by_word = next(spoken, "")
        kind = self.unit.kind if self.unit.kind in QUANTITIES else ""
        if self.unit.text in ("g", "mg") and by_word != kind and not self.is_stated:
            allowed = f"acceleration in its name, or for acceleration {self.text + '=' + self.unit.text!r}"
            raise BadInput(f"{self.text!r} may be in grams or in {self.unit.text} of acceleration", allowed)
        kind = kind or (self.unit.kind if by_word and self.unit.kind in ("time", "frequency") else "")
        if kind and by_word and kind != by_word and not self.is_stated:
            raise BadInput(f"{self.text!r} says {by_word} by its name and {kind} by its unit", "one of them")
        return kind or (by_word if by_word in QUANTITIES else "")


def column_name(text: str, stated: str = "") -> ColumnName:
    """Return what a name says. stated: its unit, by the user or elsewhere in the file.

    A unit may be in any brackets, behind `_`, `/`, a comma or a blank, amid other words, or a whole name; beside a
    factor it is not known. One that is not in brackets may be a part of the name, and a stated one wins. Raises
    BadInput for one in brackets that is not the one stated.
    """
    unit = unit_of(stated) if stated else None
    try:
        named = _split(text)
    except BadInput:
        if unit is None:
            raise
        named = ColumnName(text, text)
    if named.has("torque", "moment") and named.unit.text == "nm":
        named = replace(named, unit=_UNITS["Nm"])  # no nanometres
    if named.unit.kind and _FACTOR.search(named.base):
        named = replace(named, unit=NO_UNIT, unknown=text)
    if named.is_bracketed:
        others = filter(None, map(unit_of, re.findall(r"[\[({]([^\[\](){}]+)[\])}]", named.base)))
        if any((other.kind, other.factor) != (named.unit.kind, named.unit.factor) for other in others):
            raise BadInput(f"{text!r} has two units", "one of them, as NAME=UNIT")
    if unit is None:
        return replace(named, unknown=stated) if re.search(r"[^\W\d]", stated) and not named.unit.kind else named
    is_other = named.unit.kind != "" and (named.unit.kind, named.unit.factor) != (unit.kind, unit.factor)
    if named.is_bracketed and is_other:
        got = f"{text!r} is in {named.unit.text} by its name and in {unit.text} otherwise"
        raise BadInput(got, "one unit, or another name in the file")
    return replace(named, unit=unit, is_stated=True, guessed=named.unit.text if is_other else "")


def _split(text: str) -> ColumnName:
    plain = text.strip()
    outer, inner = re.search(r"[\[({]", plain), max(plain.rfind(mark, 0, -1) for mark in "[](){}")
    if outer is None or not plain.endswith(("]", ")", "}")):
        named = _unbracketed(text, plain)
        return named if named.unit.kind else _amid(text, plain)
    for start in (outer.start(), inner):
        within = plain[start + 1 : -1]
        if plain[start] in "[({" and (unit := unit_of(within) or unit_of(within.partition(",")[0])):
            return ColumnName(text, plain[:start], unit, is_bracketed=True)
    if plain[inner] not in "[({":
        return _unbracketed(text, plain)
    # a unit within the brackets may be a part of another one: 10 ms, log Hz; f(x) has none there
    named = _unbracketed(text, plain[:inner].strip())
    unknown = plain[inner + 1 : -1].strip() if re.search(r"[\s_]\(|[\[{]", plain) else ""
    return replace(named, base=f"{named.base} {plain[inner:]}", unknown=unknown)


def _unbracketed(text: str, plain: str) -> ColumnName:
    if whole := unit_of(plain) if len(plain) > 1 or plain == "\u00b0" else None:
        return ColumnName(text, "", whole)
    parts = list(re.finditer(r"[\s_/,.:\-]+", plain))
    for mark in parts[-3:]:
        ending = plain[mark.end() :]
        unit = unit_of(ending) if len(ending) > 1 or mark[0].strip() else None
        if unit is None and ending in ("a", "A") and "curr" in plain.casefold():
            unit = _UNITS["A"]
        if unit:
            return ColumnName(text, plain[: mark.start()], unit)
    if attached := re.search(r"(?<=[a-z])(?:dB|DB|Hz|Deg|Rad)$", plain):
        return ColumnName(text, plain[: attached.start()], unit_of(attached[0]) or NO_UNIT)
    return ColumnName(text, plain)


_FACTOR = re.compile(
    r"[*\u00d7]\s*\d|\d\s*[*\u00d7]|[\s_)\]}(]x\s?10+(?!\w)|(?<![^\W_])10+\s?x(?![^\W_])|/\s?10+(?!\w)"
    r"|(?<![\w.])(?:\d*\.?\d+[eE][-+]?\d+|(?:10+|0?\.\d+)\s*$)"
)
"""A factor beside a unit: `x100`, `* 10`, `/ 10`, `1e-3`, a power of ten before it."""
_AMID = re.compile(r"[\[({]([^\[\](){}]+)[\])}]|(?<![^\W_])(?:[^\W\d_]{2}|deg|rad|mrad|[^\W\d_]+/s2?)(?![^\W_])")
"""What may be a unit between other words: in brackets, or a word of two letters and the like."""
_OF_SIGNALS = ("time", "angle", *QUANTITIES, "voltage", "current", "force", "torque")


def _amid(text: str, plain: str) -> ColumnName:
    """Return a name with the one unit that other words follow: `pos [um] filtered`, `pos mm raw`; a number beside it
    makes it one that is not known.
    """
    found = [
        (match, _UNITS.get((match[1] or match[0]).strip().replace("\u00b5", "u"))) for match in _AMID.finditer(plain)
    ]
    units = [(match, unit) for match, unit in found if unit is not None and unit.kind in _OF_SIGNALS]
    if len(units) != 1:
        return ColumnName(text, plain, unknown=" ".join(match[0] for match, _ in units))
    (match, unit), *_ = units
    before, behind = plain[: match.start()], plain[match.end() :]
    base = f"{before} {behind}"
    is_known = match[1] or not (re.search(r"\d[\s_]*$", before) or re.match(r"[\s_]*\d", behind))
    named = ColumnName(text, base, unit, is_bracketed=bool(match[1]))
    return named if is_known else ColumnName(text, plain, unknown=unit.text)


_RATES = re.compile(r"fs|fsample|srate|samplespersecond|(?:sampl(?:e|ing)|scan)?rate|sampl(?:e|ing)freq(?:uency)?")
_STEPS = re.compile(r"ts|dt|deltat|timestep|wfincrement|xinc(?:rement)?|sampl(?:e|ing)(?:time|interval|period|step)")
_CHANGES = re.compile(
    "(?i)scal|factor|gain|calib|sensitiv|multipl|slope|conversion|coeff|attenuat|unsigned|lsb|counts?_per|per_(?:count|bit|code|volt|mm|um)|(offset|intercept|bias|zero)"
)
"""Words of statements that change what numbers mean; in the group those that add."""
_ASIDE = re.compile("(?i)date|time|serial|certificate|class|name|label|type|dimension")
_VALUE = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\d\s].*)?")


def rate_said(name: str, value: Any) -> dict[str, float]:
    """Return the sampling rate, hertz, that a variable or an attribute states, by its name with its unit; else
    nothing.
    """
    found = _VALUE.fullmatch(str(value).strip("[] "))
    if found is None or float(found[1]) <= 0.0:
        return {}
    with suppress(BadInput):
        said = f"{name} ({found[2].strip()})" if found[2] else name
        named = column_name(said)
        size, plain = (
            float(found[1]) * named.unit.factor,
            re.sub(r"[\W_]", "", named.base.rpartition(".")[2]).casefold(),
        )
        if _RATES.fullmatch(plain) and named.unit.kind in ("", "frequency") and not named.unknown:
            return {said: size}
        if _STEPS.fullmatch(plain) and named.unit.kind in ("", "time") and not named.unknown:
            return {said: 1.0 / size}
    return {}


def changes_values(name: str, value: Any) -> bool:
    """Return whether an attribute, or a variable beside a column, says that the numbers of it are not the values: a
    scale other than 1, an offset other than 0.
    """
    kind = _CHANGES.search(name)
    if kind is None or _ASIDE.search(name):
        return False
    text = str(value).strip("[]() ").casefold()
    if re.match(r"\d{4}-\d\d|\d+[./]\d+[./]", text):  # a date
        return False
    found = _VALUE.fullmatch(text)
    if found is None:
        return bool(re.search(r"\d", text)) or text == "true"
    neutral = 0.0 if kind[1] or "db" in f"{name} {text}".casefold() else 1.0
    return float(found[1]) != neutral or (neutral == 1.0 and bool(found[2]))


def is_units(cells: Iterable[str]) -> bool:
    """Return whether a row of cells has nothing but units."""
    given = [cell.strip() for cell in cells if cell.strip(" -")]
    return bool(given) and all(cell in ("1", "[]", "()") or unit_of(cell) is not None for cell in given)
