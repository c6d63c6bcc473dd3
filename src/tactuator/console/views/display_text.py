"""The view Display: a display file as text and as a form, judged as it is written, and the channels to be drawn."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field, StringConstraints
from pydantic.fields import FieldInfo

from tactuator.console.asked import Answer, Name, ViewRequest
from tactuator.console.views.toml_places import line_of, literal, with_literal
from tactuator.console.workshop import Workshop
from tactuator.errors import BadInput, TactuatorError
from tactuator.io.shipped import display_template
from tactuator.io.text import parse_toml, read_text
from tactuator.model.description import SHARED_TABLES, Channel, Display, keys_of
from tactuator.parameters import choices, default, parameters

Text = Annotated[str, StringConstraints(max_length=60_000)]
_CHANNELS_SHOWN = 64
_TABLES = ("display", *SHARED_TABLES, "objectives")


class DisplayRead(ViewRequest):
    """Request for the text of a display, or of a file that was dropped."""

    do: Literal["display.read"]
    display: Name | None = None
    file: Name | None = None

    def answer(self, workshop: Workshop) -> Answer:
        """Return the text; without a display or a file that of a display to begin with."""
        if self.file is not None:
            return {"text": read_text(workshop.drawer.path(self.file))}
        if self.display is not None:
            return {"text": workshop.text(self.display)}
        return {"text": display_template("tactuator")}


class DisplayJudge(ViewRequest):
    """Request to judge a text; display: the one whose folder its relative paths start at."""

    do: Literal["display.judge"]
    text: Text
    display: Name | None = None

    def answer(self, workshop: Workshop) -> Answer:
        """Return the form, with a sketch and the key of the display, or with the refusal and its line."""
        told: Answer = {"form": _form(self.text), "fault": None, "line": None}
        try:
            key = workshop.take_text(self.text, self.display)
        except TactuatorError as error:
            return told | {"fault": str(error), "line": line_of(self.text, str(error))}
        return told | {"key": key, "sketch": _sketch(workshop.display(key))}


class DisplaySet(ViewRequest):
    """Request to change one value in a text; place: which of several tables of that name."""

    do: Literal["display.set"]
    text: Text
    table: Name
    place: Annotated[int, Field(ge=0, le=1000)]
    key: Annotated[str, StringConstraints(pattern=r"^\w{1,60}$")]
    value: Annotated[str, StringConstraints(max_length=4000, pattern=r"^[^\n\r]+$")]

    def answer(self, workshop: Workshop) -> Answer:
        """Return the text with the value."""
        return {"text": with_literal(self.text, self.table, self.place, self.key, self.value)}


DisplayTextRequest = DisplayRead | DisplayJudge | DisplaySet


def _form(text: str) -> list[Answer]:
    """Return the tables of the form: title, name, place, and the fields with what the text says of each."""
    try:
        channels = parse_toml(text).get("channel", [])
    except BadInput:
        return []
    made = [_table(text, name, 0, f"[{name}]", keys_of(name)) for name in _TABLES]
    count = min(len(channels), _CHANNELS_SHOWN) if isinstance(channels, list) else 0
    for place in range(count):
        name = (literal(text, "channel", place, "name") or "").strip('"')
        made.append(_table(text, "channel", place, f"channel {name}", parameters(Channel)))
    return made


def _table(text: str, name: str, place: int, title: str, keys: Mapping[str, FieldInfo]) -> Answer:
    fields = [
        {
            "key": key,
            "given": literal(text, name, place, key),
            "usual": default(about),
            "choices": choices(about),
            "help": about.description,
        }
        for key, about in keys.items()
    ]
    return {"table": name, "place": place, "title": title, "fields": fields}


def _sketch(display: Display) -> Answer:
    return {
        "name": display.name,
        "rate_hz": display.rate_hz,
        "delay_samples": display.delay_samples,
        "channels": [_channel(one) for one in display.channels],
    }


def _channel(one: Channel) -> Answer:
    low, high = one.threshold.band_hz
    return {
        "name": one.name,
        "finger": one.finger,
        "loop": one.feedback.structure != "none",
        "converter": f"{one.converter.bits} bits, ±{one.converter.range_v:g} V",
        "plant": f"{one.plant.poles.size} poles, {one.plant.zeros.size} zeros",
        "quantity": one.quantity,
        "travel": f"±{one.travel_mm:g} mm",
        "sensor": f"{one.sensor_gain_v_per_mm:g} V/mm",
        "curve": one.threshold.curve.name,
        "band": f"{low:g} to {high:g} Hz",
        "prefilter": f"{one.prefilter.poles} poles",
        "loads": [load.name for load in one.loads],
    }
