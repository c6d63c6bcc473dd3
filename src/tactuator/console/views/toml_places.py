"""Places in the text of a TOML file: the line that a refusal speaks of, and the value of a key, changed in place."""

from __future__ import annotations

import re
from collections.abc import Iterator

from tactuator.errors import BadInput
from tactuator.io.text import parse_toml

_HEADER = re.compile(r"^\s*(\[\[?)\s*([\w.]+)\s*\]\]?\s*(?:#.*)?$")
_KEY = re.compile(r"^(\s*(\w+)\s*=\s*)(.*)$")


def line_of(text: str, told: str) -> int | None:
    """Return the line, counted from 1, that a refusal of the display's reader speaks of, or None.

    The place is what the message names: a line, else a key of a table or channel, else the table itself.
    """
    said = re.search(r"\(at line (\d+)", told) or re.search(r"\(at (end of document)\)", told)
    if said is not None:
        return int(said[1]) if said[1].isdigit() else max(1, len(text.splitlines()))
    table = re.search(r"\[\[?(\w+)\]\]?", told)
    channel = re.search(r"channel\]?\]? '([^']*)'", told)
    words = set(re.findall(r"\w+", told))
    lines = list(_lines(text))
    inside = [one for one in lines if _belongs(text, one, table and table[1], channel and channel[1])] or lines
    for _, _, number, key in inside:
        if key in words and key != "name":
            return number
    heads = [number for _, _, number, key in inside if key is None]
    if heads and inside is not lines:
        return heads[0]
    quoted = re.search(r"'([^']+)'", told)
    naming = [number for number, line in enumerate(text.splitlines(), 1) if quoted and f'"{quoted[1]}"' in line]
    return naming[-1] if naming else None


def literal(text: str, table: str, place: int, key: str) -> str | None:
    """Return the literal that a key has in its table (of several of one name, that of `place`), or None."""
    for name, index, number, found in _lines(text):
        if (name, index, found) == (table, place, key):
            return _parted(text.splitlines()[number - 1])[1]
    return None


def with_literal(text: str, table: str, place: int, key: str, value: str) -> str:
    """Return the text with another value of a key, its comment kept; a key or table that is not there is added.

    Raises BadInput for a value that is no TOML, or one that goes over several lines: those are changed in the text.
    """
    try:
        one = list(parse_toml(f"{key} = {value}")) == [key] and "\n" not in value
    except BadInput:
        one = False
    if not one:
        raise BadInput(f"{key}: {value!r} is no value", "a number, a text in quotes, or a list in brackets")
    lines = text.splitlines()
    last = None
    for name, index, number, found in _lines(text):
        if (name, index) != (table, place):
            continue
        last = number
        if found != key:
            continue
        head, old, comment = _parted(lines[number - 1])
        try:
            parse_toml(f"x = {old}")
        except BadInput:
            raise BadInput(f"{key} goes over several lines; allowed here: one line. Change it in the text") from None
        lines[number - 1] = f"{head}{value}{comment}"
        return "\n".join(lines) + "\n"
    added = [f"{key} = {value}"] if last is not None else ["", f"[{table}]", f"{key} = {value}"]
    at = len(lines) if last is None else last
    return "\n".join([*lines[:at], *added, *lines[at:]]) + "\n"


def _lines(text: str) -> Iterator[tuple[str, int, int, str | None]]:
    """Yield for every header and key: table, which of that name, line from 1, and the key (None: a header)."""
    table, count = "", {"": 0}
    for number, line in enumerate(text.splitlines(), 1):
        header, key = _HEADER.match(line), _KEY.match(line)
        if header is not None:
            table = header[2]
            count[table] = count.get(table, -1) + 1
            yield table, count[table], number, None
        elif key is not None:
            yield table, count[table], number, key[2]


def _parted(line: str) -> tuple[str, str, str]:
    """Return a line's key with its equals sign, its literal, and its comment with the spaces before it."""
    found = _KEY.match(line)
    assert found is not None
    rest, quoted = found[3], False
    for place, letter in enumerate(rest):
        if letter == '"':
            quoted = not quoted
        elif letter == "#" and not quoted:
            value = rest[:place].rstrip()
            return found[1], value, rest[len(value) :]
    return found[1], rest.rstrip(), ""


def _belongs(text: str, one: tuple[str, int, int, str | None], table: str | None, channel: str | None) -> bool:
    name, index, _, _ = one
    if channel is not None:
        return name == "channel" and literal(text, "channel", index, "name") == f'"{channel}"'
    return table is not None and name == table
