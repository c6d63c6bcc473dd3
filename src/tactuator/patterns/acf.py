"""Actuator configuration files (ACF, Meta Haptics SDK): how a device renders `.haptic`, as a map of its numbers.

A file is JSON5. `emphasis_ducking` is what the continuous signal is multiplied by during an emphasis, and
`fade_out_percent` how much of an emphasis is gone at its end (template.acf and the renderer; a page of the same SDK
says the contrary of the first).
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tactuator.errors import BadInput, within
from tactuator.io.text import parse_finite_json, read_text
from tactuator.patterns.clip import number_of, part_of
from tactuator.patterns.rendering import SHAPES, PatternMap

_MOST_HZ, _MOST_MS = 20_000.0, 10_000.0
_LEAST = 1e-3


def read_acf(path: str | Path) -> PatternMap:
    """Return the map that an ACF states. Raises BadInput with the rule that it breaks, within its file."""
    with within(str(path)):
        return _parse_acf(read_text(Path(path)))


def _parse_acf(text: str) -> PatternMap:
    document = parse_json5(text)
    continuous, emphasis = part_of(document, "continuous"), part_of(document, "emphasis")
    band_hz = _ends(continuous, ("", ""), _MOST_HZ, "continuous")
    if band_hz[0] > band_hz[1]:
        raise BadInput(f"{band_hz[1]:g}", f"{band_hz[0]:g} or more", where=("continuous",), key="frequency_max")
    tap_hz = _ends(emphasis, ("output_frequency",) * 2, _MOST_HZ, "emphasis")
    if tap_hz[0] > tap_hz[1]:
        where = ("emphasis", "frequency_max")
        raise BadInput(f"{tap_hz[1]:g}", f"{tap_hz[0]:g} or more", where=where, key="output_frequency")
    first_ms, last_ms = _ends(emphasis, ("duration_ms",) * 2, _MOST_MS, "emphasis")
    shapes = []
    for end in ("frequency_min", "frequency_max"):
        shape = part_of(emphasis, end, "shape")
        if shape not in SHAPES:
            raise BadInput(repr(shape)[:60], ", ".join(SHAPES), where=("emphasis", end), key="shape")
        shapes.append(shape)
    return PatternMap(
        band_hz=band_hz,
        gain=number_of(continuous, "gain", 0.0, 1.0, "continuous"),
        ducking=1.0 - number_of(continuous, "emphasis_ducking", 0.0, 1.0, "continuous"),
        tap_hz=tap_hz,
        tap_s=(1e-3 * first_ms, 1e-3 * last_ms),
        tap_gain=number_of(emphasis, "gain", 0.0, 1.0, "emphasis"),
        tap_fade=0.01 * number_of(emphasis, "fade_out_percent", 0.0, 100.0, "emphasis"),
        tap_shape=(shapes[0], shapes[1]),
    )


def _ends(table: Any, keys: tuple[str, str], most: float, where: str) -> tuple[float, float]:
    """Return a number at both ends of the pitches; "" stands for the number itself."""
    values = []
    for end, key in zip(("frequency_min", "frequency_max"), keys, strict=True):
        inner = part_of(table, end) if key else table
        if not isinstance(inner, dict):
            raise BadInput(repr(inner)[:60], "a table", where=(where,), key=end)
        values.append(number_of(inner, key or end, _LEAST, most, *((where, end) if key else (where,))))
    return values[0], values[1]


def acf_text(mapping: PatternMap, device: str, date: str) -> str:
    """Return a map as the text of an ACF, which is JSON. date: as YYYY-MM-DD."""
    ends = [
        {"output_frequency": hertz, "duration_ms": round(1e3 * seconds, 4), "shape": shape}
        for hertz, seconds, shape in zip(mapping.tap_hz, mapping.tap_s, mapping.tap_shape, strict=True)
    ]
    document = {
        "metadata": {"version": "1.0.0", "device": device, "date": date, "author": "tactuator"},
        "continuous": {
            "gain": mapping.gain, "emphasis_ducking": 1.0 - mapping.ducking,
            "frequency_min": mapping.band_hz[0], "frequency_max": mapping.band_hz[1],
        },
        "emphasis": {
            "gain": mapping.tap_gain, "fade_out_percent": 100.0 * mapping.tap_fade,
            "frequency_min": ends[0], "frequency_max": ends[1],
        },
    }  # fmt: skip
    return json.dumps(document, indent=2, allow_nan=False) + "\n"


_TOKEN = re.compile(
    r"""(?P<space>[\s\ufeff]+|//[^\n\u2028\u2029]*|/\*(?:[^*]|\*(?!/))*\*/)
    |(?P<text>"(?:[^"\\\n]|\\[\s\S])*"|'(?:[^'\\\n]|\\[\s\S])*')
    |(?P<number>[-+]?(?:Infinity|NaN|0[xX][0-9a-fA-F]{1,16}(?!\w)|(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?))(?![\w$])
    |(?P<name>[^\W\d][\w$]*|\$[\w$]*)
    |(?P<mark>[][{}:,])""",
    re.VERBOSE,
)
_LARGEST = 1 << 20
_ESCAPE = re.compile(r"\\(?:x([0-9a-fA-F]{2})|u([0-9a-fA-F]{4})|([\s\S]))")
_ESCAPED = {"b": "\b", "f": "\f", "n": "\n", "r": "\r", "t": "\t", "v": "\v", "0": "\0", "\n": ""}


def parse_json5(text: str) -> Any:
    """Return the content of a JSON5 text without NaN or infinities. Raises BadInput, the reason alone, otherwise."""
    if len(text) > _LARGEST:
        raise BadInput(f"it has more than {_LARGEST >> 20} MB")
    return parse_finite_json(" ".join(_json(text)))


def _json(text: str) -> Iterator[str]:
    comma, before = "", ""
    for kind, token in _tokens(text):
        if comma and not (token in "]}" and before not in ("", "[", "{", ":", ",")):
            yield comma
        if comma:
            before = before if token in "]}" else ","
        comma = ""
        if token == "," and kind == "mark":
            comma = ","
            continue
        yield token
        before = token
    yield comma


def _tokens(text: str) -> Iterator[tuple[str, str]]:
    at = 0
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            line = text.count("\n", 0, at) + 1
            raise BadInput("it is not JSON5", where=(f"line {line}",))
        at, kind, token = match.end(), str(match.lastgroup), match[0]
        if kind == "text":
            token = json.dumps(_ESCAPE.sub(_unescaped, token[1:-1]))
        elif kind == "number":
            token = _number(token)
        elif kind == "name":
            token = _name(token, text, at)
        if kind != "space":
            yield kind, token


def _unescaped(match: re.Match[str]) -> str:
    code = match[1] or match[2]
    return chr(int(code, 16)) if code else _ESCAPED.get(match[3], match[3])


def _number(token: str) -> str:
    sign, digits = ("-" if token[0] == "-" else ""), token.lstrip("+-")
    if digits[:2] in ("0x", "0X"):
        return f"{sign}{int(digits, 16)}"
    if digits in ("Infinity", "NaN"):
        return digits
    whole, point, rest = digits.partition(".")
    if not point:
        return sign + digits
    return f"{sign}{whole or 0}.{rest if rest[:1].isdigit() else '0' + rest}"


def _name(token: str, text: str, at: int) -> str:
    while (space := _TOKEN.match(text, at)) is not None and space.lastgroup == "space":
        at = space.end()
    if text[at : at + 1] != ":" and token in ("true", "false", "null"):
        return token
    return json.dumps(token) if text[at : at + 1] == ":" else f"<{token[:40]}>"  # which JSON refuses
