"""JSON5 texts (json5.org): JSON with comments, names without quotes, single quotes, and a comma after the last."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

from tactuator.errors import BadInput
from tactuator.io.text import parse_finite_json

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
    """Return the content of a JSON5 text without NaN and infinities. Raises BadInput, with the reason alone, for other
    text.
    """
    if len(text) > _LARGEST:
        raise BadInput(f"it has more than {_LARGEST >> 20} MB")
    return parse_finite_json(" ".join(_json(text)))


def _json(text: str) -> Iterator[str]:
    """Yield the tokens of a JSON5 text as those of JSON."""
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
    """Yield kind and JSON's spelling of every token but space."""
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
    """Return a name as a key, or as the word of JSON that it is."""
    while (space := _TOKEN.match(text, at)) is not None and space.lastgroup == "space":
        at = space.end()
    if text[at : at + 1] != ":" and token in ("true", "false", "null"):
        return token
    return json.dumps(token) if text[at : at + 1] == ":" else f"<{token[:40]}>"  # which JSON refuses
