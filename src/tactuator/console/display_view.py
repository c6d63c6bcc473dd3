"""The view Display: a display file as text and as a form, judged as it is written, and the channels to be drawn."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated

from pydantic import Field, StringConstraints
from pydantic.fields import FieldInfo

from tactuator.console.fields import Name
from tactuator.console.requests import Answer, View
from tactuator.console.state import ConsoleState
from tactuator.errors import BadInput, TactuatorError
from tactuator.io.display import where_of
from tactuator.io.model import read_model
from tactuator.io.shipped import display_template, with_model
from tactuator.io.text import parse_toml, read_text
from tactuator.model.description import SHARED_TABLES, Channel, keys_of
from tactuator.model.plausibility import channel_reasons
from tactuator.parameters import choices, default, parameters
from tactuator.plain import picked

_HEADER = re.compile(r"^\s*(\[\[?)\s*([\w.]+)\s*\]\]?\s*(?:#.*)?$")
_KEY = re.compile(r"^(\s*(\w+)\s*=\s*)(.*)$")
_CHANNELS_SHOWN = 64
Text = Annotated[str, StringConstraints(max_length=60_000)]
_TABLES = ("display", *SHARED_TABLES, "objectives")


def line_of(text: str, error: TactuatorError) -> int | None:
    """Return the line, counted from 1, at which a refusal of the display's reader lies, or None.

    It is the line that the error names, else that of its key in its table, else the table's own.
    """
    for part in error.where:
        if part.startswith("line "):
            return int(part.removeprefix("line ").partition(",")[0])
        if part == "end of document":
            return max(1, len(text.splitlines()))
    keys = {error.key, *(part.partition(" ")[0] for part in error.where)}
    lines, rows = list(_lines(text)), text.splitlines()
    named = {index: number for table, index, number, key in lines if (table, key) == ("channel", "name")}
    inside = [
        (number, key)
        for table, index, number, key in lines
        if f"[{table}]" in error.where or (table == "channel" and _channel_where(rows, named.get(index)) in error.where)
    ]
    keyed = [number for number, key in inside if key in keys]
    return next((number for number in [*keyed, *(number for number, _ in inside)]), None)


def _channel_where(rows: Sequence[str], number: int | None) -> str:
    """Return how a refusal names the channel whose name is on that line."""
    try:
        return "" if number is None else where_of(parse_toml(rows[number - 1]))
    except BadInput:
        return ""


def literal(text: str, table: str, place: int, key: str) -> str | None:
    """Return the literal that a key has in its table (of several of one name, that of `place`), or None."""
    for name, index, number, line_key in _lines(text):
        if (name, index, line_key) == (table, place, key):
            return _parted(text.splitlines()[number - 1])[1]
    return None


def with_literal(text: str, table: str, place: int, key: str, value: str) -> str:
    """Return the text with another value of a key, its comment kept; a key or table that is not there is added.

    Raises BadInput for a value that is no TOML, or one that goes over several lines: those are changed in the text.
    """
    try:
        is_literal = list(parse_toml(f"{key} = {value}")) == [key] and "\n" not in value
    except BadInput:
        is_literal = False
    if not is_literal:
        raise BadInput(f"{value!r}, which is no value", "a number, a text in quotes, or a list in brackets", key=key)
    lines = text.splitlines()
    last = None
    for name, index, number, line_key in _lines(text):
        if (name, index) != (table, place):
            continue
        last = number
        if line_key != key:
            continue
        head, old, comment = _parted(lines[number - 1])
        try:
            parse_toml(f"x = {old}")
        except BadInput:
            raise BadInput("a value of several lines", "one line here; change it in the text", key=key) from None
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
    parts = _KEY.match(line)
    assert parts is not None
    rest, quoted = parts[3], False
    for place, letter in enumerate(rest):
        if letter == '"':
            quoted = not quoted
        elif letter == "#" and not quoted:
            value = rest[:place].rstrip()
            return parts[1], value, rest[len(value) :]
    return parts[1], rest.rstrip(), ""


def read(
    state: ConsoleState, display: Name | None = None, file: Name | None = None, model: Name | None = None
) -> Answer:
    """Return the text of a display, or of a file that was dropped; without either that of a display to begin with, as
    `init` writes it, with the model that was dropped if there is one.
    """
    if model is not None:
        path = state.uploads.path(model)
        return {"text": with_model(display_template("tactuator"), read_model(path), path.name)}
    if file is not None:
        return {"text": read_text(state.uploads.path(file))}
    return {"text": display_template("tactuator") if display is None else state.text(display)}


def judge(state: ConsoleState, text: Text, display: Name | None = None, model: Name | None = None) -> Answer:
    """Return the form of a text, with a sketch and the key of the display, or with the refusal and its line.

    display, model: the one whose folder its relative paths start at.
    """
    judged: Answer = {"form": _form(text), "fault": None, "line": None, "doubts": []}
    try:
        beside = None if model is None else state.uploads.path(model).parent
        key = state.take_text(text, display if beside is None else beside)
    except TactuatorError as error:
        return judged | {"fault": str(error), "line": line_of(text, error)}
    described = state.display(key)
    sketch = {
        **picked(described, "name", "rate_hz", "delay_samples"),
        "channels": [_channel(channel) for channel in described.channels],
    }
    reasons = {channel.name: channel_reasons(channel, described.rate_hz) for channel in described.channels}
    doubts = [f"{name}: {reason}" for name, said in reasons.items() for reason in said]
    return judged | {"key": key, "sketch": sketch, "doubts": doubts}


def set_value(
    state: ConsoleState,
    text: Text,
    table: Name,
    place: Annotated[int, Field(ge=0, le=1000)],
    key: Annotated[str, StringConstraints(pattern=r"^\w{1,60}$")],
    value: Annotated[str, StringConstraints(max_length=4000, pattern=r"^[^\n\r]+$")],
    words: bool = False,
) -> Answer:
    """Return a text with another value of a key in the `place`-th table of that name; words are put in quotes, unless
    they are a list or a table.
    """
    written = json.dumps(value, ensure_ascii=False) if words and value[0] not in "[{" else value
    return {"text": with_literal(text, table, place, key, written)}


VIEW = View("display", "Display", {"read": read, "judge": judge, "set": set_value})


def _form(text: str) -> list[Answer]:
    """Return the tables of the form: title, name, place, and the fields with what the text says of each."""
    try:
        channels = parse_toml(text).get("channel", [])
    except BadInput:
        return []
    tables = [_table(text, name, 0, f"[{name}]", keys_of(name)) for name in _TABLES]
    count = min(len(channels), _CHANNELS_SHOWN) if isinstance(channels, list) else 0
    for place in range(count):
        name = (literal(text, "channel", place, "name") or "").strip('"')
        tables.append(_table(text, "channel", place, f"channel {name}", parameters(Channel)))
    return tables


def _table(text: str, name: str, place: int, title: str, keys: Mapping[str, FieldInfo]) -> Answer:
    fields = [_field(key, about, literal(text, name, place, key)) for key, about in keys.items()]
    return {"table": name, "place": place, "title": title, "fields": fields}


def _field(key: str, about: FieldInfo, given: str | None) -> Answer:
    """Return a field of the form: words without their quotes, everything else as the file has it."""
    usual = default(about)
    field = {"key": key, "given": given, "usual": usual, "choices": choices(about), "help": about.description}
    if field["choices"] or not (given or usual or "").startswith('"'):
        return field | {"words": False}
    return field | {"given": given and _words(given), "usual": usual and _words(usual), "words": True}


def _words(quoted: str) -> str:
    try:
        return str(parse_toml(f"x = {quoted}")["x"])
    except BadInput:
        return quoted


def _channel(channel: Channel) -> Answer:
    low, high = channel.threshold.band_hz
    return {
        **picked(channel, "name", "finger", "quantity", curve="threshold.curve.name"),
        "loop": channel.feedback.structure != "none",
        "converter": f"{channel.converter.bits} bits, ±{channel.converter.range_v:g} V",
        "plant": f"{channel.plant.poles.size} poles, {channel.plant.zeros.size} zeros",
        "travel": f"±{channel.travel_mm:g} mm",
        "sensor": f"{channel.sensor_gain_v_per_mm:g} V/mm",
        "band": f"{low:g} to {high:g} Hz",
        "prefilter": f"{channel.prefilter.poles} poles",
        "loads": [load.name for load in channel.loads],
    }
