"""Display files: TOML to `Display`, in one pass."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from tactuator.errors import BadInput, named_file, unknown, within
from tactuator.io.csv_tables import read_contours, resolve_curve
from tactuator.io.environment import channel_environment
from tactuator.io.kinds import require_kind
from tactuator.io.plant import GivenPlant, given_plant
from tactuator.io.text import parse_toml, read_text
from tactuator.model.description import (
    SHARED_TABLES,
    TABLES,
    Channel,
    Converter,
    Display,
    ForceSensor,
    Strength,
    Threshold,
    keys_of,
)
from tactuator.model.plant import DERIVATIVES, motor_gain
from tactuator.model.requirements import (
    FeedbackRequirements,
    Objectives,
    PrefilterRequirements,
    SoundCard,
    Touch,
    Wires,
)
from tactuator.parameters import from_table, parameters, require_known
from tactuator.perception.curve import Contact, ThresholdCurve

Document = Mapping[str, Any]


def read_display(path: str | Path) -> Display:
    """Read a display file (TOML).

    Raises BadInput, one line, for a file that cannot be read, a key that is not known, a figure out of its range.
    """
    path = Path(path)
    require_kind(path, "display")
    with within(f"display file {path}"):
        text = read_text(path)
        return parse_display(_with_unchanged(parse_toml(text), text), path.parent)


def _with_unchanged(document: Document, text: str) -> Document:
    """Return the document whose channels list their keys that still say CHANGE THIS."""
    channels = document.get("channel")
    tables = re.split(r"(?m)^[ \t]*+(?=\[++[ \t]*+[a-z_]++[ \t]*+\])", text)
    parts = [table for table in tables if re.match(r"\[\[[ \t]*channel[ \t]*\]\]", table)]
    if not isinstance(channels, list) or len(parts) != len(channels) or "CHANGE THIS" not in text:
        return document
    shared = _unchanged("".join(table for table in tables if table not in parts))
    own = [[*_unchanged(part), *shared] for part in parts]
    return {**document, "channel": [{"unchanged": keys, **entry} for entry, keys in zip(channels, own, strict=True)]}


def _unchanged(text: str) -> list[str]:
    return re.findall(r"(?m)^[ \t]*(\w++)[ \t]*=.*#[ \t]*CHANGE THIS", text)


def parse_display(document: Document, beside: Path = Path()) -> Display:
    """Return the display of a document's tables; relative paths in it start at the folder `beside`."""
    for key in document:
        if key not in TABLES:
            raise unknown("table", key, sorted(TABLES), where=(f"[{key}]",))
    tables = {name: _table(document, name) for name in TABLES if name != "channel"}
    channels = document.get("channel", [])
    if not isinstance(channels, list) or not all(isinstance(entry, Mapping) for entry in channels):
        raise BadInput("[[channel]] is not a list of tables", "one [[channel]] for each finger")
    require_known(tables["display"], keys_of("display"), "[display]")
    parts = {
        "objectives": from_table(Objectives, tables["objectives"], "[objectives]"),
        "touch": from_table(Touch, tables["touch"], "[touch]"),
        "channels": tuple(_channel(tables, entry, "sound" in document, beside) for entry in channels),
        "sound": _sound_card(tables["sound"], channels) if "sound" in document else None,
    }
    return from_table(Display, dict(tables["display"]) | parts, "[display]")


def _table(document: Document, name: str) -> Document:
    table = document.get(name, {})
    if not isinstance(table, Mapping):
        raise BadInput(f"{name} is {table!r}", f"a table [{name}]")
    return table


def _sound_card(table: Document, channels: list[Document]) -> SoundCard:
    """Return the wiring of the channels, each with its own keys before those of [sound]."""
    require_known(table, keys_of("sound"), "[sound]")
    wires = []
    for place, entry in enumerate(channels, 1):
        shared, mine = ({key: keys[key] for key in parameters(Wires) if key in keys} for keys in (table, entry))
        where = where_of(entry) if mine else "[sound]"
        wires.append(from_table(Wires, {"output": place, "input": place} | shared | mine, where))
    card = {key: value for key, value in table.items() if key in parameters(SoundCard)}
    return from_table(SoundCard, card | {"wires": tuple(wires)}, "[sound]")


def with_curve(display: Display, curve: ThresholdCurve) -> Display:
    """Return the display with `curve` in place of every channel's own. Raises BadInput for one of bounds alone."""
    curve.require_measured()
    channels = (replace(channel, threshold=replace(channel.threshold, curve=curve)) for channel in display.channels)
    return replace(display, channels=tuple(channels))


def where_of(entry: Document) -> str:
    """Return how a refusal names the table of a channel."""
    return f"[[channel]] {entry.get('name', '')!r}"


def _channel(tables: Mapping[str, Document], entry: Document, wired: bool, beside: Path) -> Channel:
    where = where_of(entry)
    entry = _as_acceleration(entry, where)
    elsewhere = {key for name in SHARED_TABLES for key in keys_of(name)} | set(parameters(Wires) if wired else ())
    mine = {key: value for key, value in entry.items() if key not in elsewhere}
    require_known(mine, parameters(Channel), where)
    given = {name: _merged(tables[name], entry, name, where) for name in SHARED_TABLES}
    feedback = from_table(FeedbackRequirements, *given["feedback"])
    plant = given_plant(
        mine.pop("plant", None), beside, where, feedback.structure != "none", mine.get("sensor_gain_v_per_mm")
    )
    if mine.get("loads") and plant.is_response:
        raise BadInput(
            "a list, while a response alone does not show what a load changes",
            "none, or the model that `identify` makes of it",
            where=(where,),
            key="loads",
        )
    stated = mine.get("quantity", Channel.quantity)
    known = plant.by_unit or (plant.quantity if DERIVATIVES.get(plant.quantity, 0) else "")
    if known and known != stated:
        asked = f'quantity = "{known}"'
        raise BadInput(f"{stated!r}, and the plant is of {known}", asked, where=(where,), key="quantity")
    friction = None if plant.model is None else plant.model.get("friction") or {}
    resolved: dict[str, Any] = {
        "threshold": _threshold(*given["threshold"], beside),
        "converter": from_table(Converter, *given["converter"]),
        "feedback": feedback,
        "prefilter": from_table(PrefilterRequirements, *given["prefilter"]),
        "strength": _strength(*given["strength"], beside),
        "contact": from_table(Contact, *given["contact"]),
        "environment": channel_environment(*given["environment"], beside, str(mine.get("name")), friction),
    }
    channel = from_table(Channel, _with_plant(mine, plant) | resolved, where)
    _require_travel_seen(channel, where)
    with within(where):
        _require_scale(channel, plant.leading)
        for load in channel.loads:
            for member in (channel.plant, *channel.family):
                channel.under(load, member)
    return channel


def _with_plant(mine: Document, plant: GivenPlant) -> dict[str, Any]:
    """Return the keys of a channel with those of its plant, which the channel's own override."""
    keys = {**plant.keys, **mine}
    if "model_error_db" in mine and "model_error_hz" not in mine:
        keys.pop("model_error_hz", None)
    if isinstance(mine.get("family"), list | tuple):
        keys["family"] = [*mine["family"], *plant.keys.get("family", ())]
    return keys


def _require_scale(channel: Channel, leading: float) -> None:
    """Raise BadInput for a load without `per` on a motor whose denominator, as it is written, does not begin with one:
    it may be in the units of that denominator or relative to the moving mass.
    """
    gain = motor_gain(channel.plant, channel.quantity)
    unclear = [load.name for load in channel.loads if load.per is None]
    if leading != 1.0 and gain is not None and unclear:
        raise BadInput(
            f"not stated for load {unclear[0]!r}, and the plant's den begins with {leading:g}",
            f"{abs(gain * leading):g}, which adds the load to den as it is written, or {abs(gain):g} for a load "
            "relative to the moving mass",
            key="per",
        )


def _require_travel_seen(channel: Channel, where: str) -> None:
    """Raise BadInput for a loop's sensor whose reading ends before the travel does: a gain or a travel in another unit,
    or a limit that the guard could not see.
    """
    farthest_v = channel.travel_mm * channel.sensor_gain_v_per_mm
    has_loop = channel.feedback.structure != "none"
    if has_loop and channel.quantity == "displacement" and farthest_v > channel.converter.range_v:
        raise BadInput(
            f"{channel.sensor_gain_v_per_mm:g}, so the sensor puts out {farthest_v:.4g} V at the end of travel_mm "
            f"{channel.travel_mm:g}, and the converter reads up to range_v {channel.converter.range_v:g}",
            f"{channel.converter.range_v / channel.travel_mm:.4g} or less, or range_v {farthest_v:.4g} or more",
            where=(where,),
            key="sensor_gain_v_per_mm",
        )


def _as_acceleration(entry: Document, where: str) -> Document:
    """Return the entry of a force sensor that moves a known mass as that of an accelerometer: 1 mm/s² is mass_kg mN."""
    mine = {key: entry[key] for key in parameters(ForceSensor) if key in entry}
    if entry.get("quantity") != "force":
        if key := next(iter(mine), ""):
            raise BadInput(f"{mine[key]!r}", 'left out, or beside quantity = "force"', where=(where,), key=key)
        return entry
    sensor = from_table(
        ForceSensor, mine, where, "quantity = 'force', which alone does not show how far a finger moves"
    )
    if "sensor_gain_v_per_mm" in entry:
        raise BadInput(
            "given beside quantity = 'force'", "sensor_gain_v_per_n", where=(where,), key="sensor_gain_v_per_mm"
        )
    rest = {key: value for key, value in entry.items() if key not in mine}
    gain = 1e-3 * sensor.mass_kg * sensor.sensor_gain_v_per_n
    return rest | {"quantity": "acceleration", "sensor_gain_v_per_mm": gain}


def _merged(table: Document, entry: Document, name: str, where: str) -> tuple[dict[str, Any], str]:
    """Return the keys of a shared table with those of the channel, which win, and how a refusal names the table."""
    require_known(table, keys_of(name), f"[{name}]")
    mine = {key: entry[key] for key in keys_of(name) if key in entry}
    return {**table, **mine}, where if mine else f"[{name}]"


def _threshold(keys: dict[str, Any], where: str, beside: Path) -> Threshold:
    name = keys.get("curve")
    if isinstance(name, str):
        with within(where, "curve"), named_file(beside / name, "threshold curve"):
            keys["curve"] = resolve_curve(name, beside)
    return from_table(Threshold, keys, where)


def _strength(keys: dict[str, Any], where: str, beside: Path) -> Strength:
    contours = keys.get("contours")
    with within(where, "contours"), named_file(beside / f"{contours}", "contours"):
        resolved = read_contours(beside / contours) if isinstance(contours, str) else contours
    return from_table(Strength, keys | {"contours": resolved}, where)
