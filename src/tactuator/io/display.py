"""Display files: TOML to `Display`, with the measured environment that one may name (environment.json)."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from tactuator import __version__
from tactuator.errors import BadInput, within
from tactuator.io.atomic import write_text
from tactuator.io.csv_tables import read_contours, resolve_curve
from tactuator.io.kinds import require_kind
from tactuator.io.model import FORMAT, parse_model
from tactuator.io.record import is_response, read_foreign_response
from tactuator.io.text import parse_toml, read_finite_json, read_text
from tactuator.model.description import (
    DISTURBANCES,
    SHARED_TABLES,
    TABLES,
    Channel,
    Converter,
    Display,
    Environment,
    ForceSensor,
    MeasuredEnvironment,
    Recorded,
    Strength,
    Threshold,
    keys_of,
)
from tactuator.model.plant import Load, system_of
from tactuator.model.plant_model import Weighed, reasons
from tactuator.model.requirements import (
    FeedbackRequirements,
    Objectives,
    PrefilterRequirements,
    SoundCard,
    Touch,
    Wires,
)
from tactuator.model.response_plant import ResponsePlant, plant_of_response
from tactuator.parameters import Number, allowed, from_table, in_file, parameters, require_known
from tactuator.perception.curve import Contact, ThresholdCurve
from tactuator.signals.systems import ContinuousSystem

ENVIRONMENT_FORMAT = "tactuator-environment/1"


_MEASURED = ("hum_hz", "hum_v_peak", "noise_v_rms")


def write_environment(path: str | Path, channels: Mapping[str, Mapping[str, Any]]) -> None:
    """Write the keys of [environment] that were found of every channel, by its name, whole or not at all."""
    found_of = {name: dict(keys) for name, keys in channels.items()}
    document = {"format": ENVIRONMENT_FORMAT, "tool": __version__, "channels": found_of}
    write_text(path, json.dumps(document, indent=1, allow_nan=False) + "\n")


def read_environment(path: str | Path, channel: str) -> dict[str, Any]:
    """Return the keys of [environment] that the file tells of `channel`.

    Raises BadInput for a file that cannot be read, another format, a channel that is not in it, a figure out of range.
    """
    require_kind(Path(path), "environment")
    document = read_finite_json(Path(path))
    if not isinstance(document, dict) or document.get("format") != ENVIRONMENT_FORMAT:
        raise BadInput(f"format is not {ENVIRONMENT_FORMAT!r}", "a file that `noise --write` wrote")
    channels = document.get("channels")
    if not isinstance(channels, dict) or channel not in channels:
        known = ", ".join(channels) if isinstance(channels, dict) else "none"
        raise BadInput(f"channel {channel!r} is not in it", f"{known}")
    values = channels[channel]
    where = f"channel {channel!r}"
    if not isinstance(values, dict):
        raise BadInput(f"{where} is {values!r}", "a table")
    require_known(values, dict.fromkeys(_MEASURED), where)
    for key in _MEASURED:
        if key not in values:
            raise BadInput("missing", allowed(parameters(Environment)[key]), where=(where,), key=key)
    from_table(Environment, values, where)
    return values


def channel_environment(
    keys: dict[str, Any], where: str, beside: Path, channel: str, friction: Mapping[str, float] | None
) -> Environment:
    """Return the environment of a file's keys, with the figures of the file that `measured` names, if it names one.

    friction: that of an identified model, for a file that states none; None where the plant is no such model.
    """
    file = from_table(MeasuredEnvironment, {key: keys[key] for key in ("measured",) if key in keys}, where)
    values = {key: value for key, value in keys.items() if key != "measured"}
    if file.measured is not None:
        stated = sorted(set(values) & set(_MEASURED))
        if stated:
            raise BadInput(f"environment: both measured and {stated[0]} are given", "one of them", where=(where,))
        path = beside / file.measured
        with within(where, f"measured {path}"):
            values |= read_environment(path, channel)
    known = {_STATES[key] for key in values if key in _STATES}
    if friction is not None and "friction" not in known:
        known.add("friction")
        values["friction_v"] = float(friction.get("coulomb", 0.0))
        if friction.get("presliding"):
            values["presliding_v"] = float(friction["presliding"])
    if "presliding_v" in values or not ("friction" in known and values["friction_v"]):
        known.add("presliding")  # nothing rests on it without friction; where friction is assumed, that is told
    values.setdefault("assumed", tuple(what for what in DISTURBANCES if what not in known))
    return from_table(Environment, values, where)


_STATES = {"hum_v_peak": "hum", "hum_hz": "hum", "noise_v_rms": "noise", "friction_v": "friction"}
"""Keys of [environment], and the disturbance that each states."""


Document = Mapping[str, Any]


def read_display(path: str | Path) -> Display:
    """Read a display file (TOML).

    Raises BadInput, one line, for a file that cannot be read, a key that is not known, a figure out of its range.
    """
    path = Path(path)
    require_kind(path, "display")
    try:
        text = read_text(path)
        document = parse_toml(text)
    except BadInput as error:
        raise BadInput(f"display file {path}: {error}", "a TOML file that can be read") from None
    with within(f"display file {path}"):
        return parse_display(_with_unchanged(document, text), path.parent)


def _with_unchanged(document: Document, text: str) -> Document:
    """Return the document whose channels tell which of their keys still say that they are to be changed."""
    channels = document.get("channel")
    parts = re.split(r"(?m)^\s*\[\[\s*channel\s*\]\]", text)[1:]
    if not isinstance(channels, list) or len(parts) != len(channels) or "CHANGE THIS" not in text:
        return document
    keys = [re.findall(r"(?m)^\s*(\w+)\s*=.*#\s*CHANGE THIS", part) for part in parts]
    return {**document, "channel": [{"unchanged": mine, **entry} for entry, mine in zip(channels, keys, strict=True)]}


def parse_display(document: Document, beside: Path = Path()) -> Display:
    """Return the display of a document's tables; relative paths in it start at the folder `beside`."""
    for key in document:
        if key not in TABLES:
            raise BadInput("not a table that is known", ", ".join(sorted(TABLES)), where=(f"[{key}]",))
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
    return from_table(Display, in_file(Display) | dict(tables["display"]) | parts, "[display]")


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
    """Return the display with `curve` in place of every channel's own."""
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
    converter = from_table(Converter, *given["converter"])
    plant = _plant(mine.get("plant"), beside, where, feedback.structure != "none")
    if mine.get("loads") and plant.is_response:
        raise BadInput(
            "a list, while what a load changes cannot be told from a response by itself",
            "none, or the model that `identify` makes of it",
            where=(where,),
            key="loads",
        )
    friction = None if plant.model is None else plant.model.get("friction") or {}
    resolved: dict[str, Any] = {
        "plant": plant.system,
        "threshold": _threshold(*given["threshold"], beside),
        "converter": converter,
        "feedback": feedback,
        "prefilter": from_table(PrefilterRequirements, *given["prefilter"]),
        "strength": _strength(*given["strength"], beside),
        "contact": from_table(Contact, *given["contact"]),
        "environment": channel_environment(*given["environment"], beside, str(mine.get("name")), friction),
    }
    channel = from_table(Channel, in_file(Channel) | mine | resolved, where)
    covariance = channel.covariance or _covariance((plant.model or {}).get("covariance", ()), plant.system)
    finished = replace(
        channel,
        finger=channel.finger or channel.name,
        loads=tuple(_scaled(load, plant.scale) for load in channel.loads),
        family=channel.family + plant.family,
        models=channel.models or plant.models,
        covariance=covariance,
        valid_hz=channel.valid_hz or plant.valid_hz,
        model_error_db=channel.model_error_db if "model_error_db" in mine else plant.error_db,
        model_error_hz=channel.model_error_hz or (None if "model_error_db" in mine else plant.unsure_hz),
        recorded=channel.recorded or plant.recorded,
    )
    _require_travel_seen(finished, where)
    return finished


def _scaled(load: Load, scale: float) -> Load:
    """Return the load of a plant whose denominator does not begin with one, in units of one that does."""
    return Load(load.name, load.mass / scale, load.damping / scale, load.stiffness / scale)


def _require_travel_seen(channel: Channel, where: str) -> None:
    """Raise BadInput for a loop's sensor whose reading ends before the travel does: a gain or a travel in another unit,
    or a limit that the guard could not see.
    """
    farthest_v = channel.travel_mm * channel.sensor_gain_v_per_mm
    has_loop = channel.feedback.structure != "none"
    if has_loop and channel.quantity == "displacement" and farthest_v > channel.converter.range_v:
        raise BadInput(
            f"{channel.sensor_gain_v_per_mm:g} V/mm, which make {farthest_v:.4g} V of travel_mm {channel.travel_mm:g}",
            f"up to range_v {channel.converter.range_v:g} V, beyond which nothing is read",
            where=(where,),
            key="sensor_gain_v_per_mm",
        )


def _as_acceleration(entry: Document, where: str) -> Document:
    """Return the entry of a force sensor that moves a known mass as that of an accelerometer: 1 mm/s² is mass_kg mN."""
    if entry.get("quantity") != "force":
        return entry
    mine = {key: entry[key] for key in parameters(ForceSensor) if key in entry}
    sensor = from_table(
        ForceSensor, mine, where, "quantity = 'force', which alone does not tell how far a finger moves"
    )
    if "sensor_gain_v_per_mm" in entry:
        raise BadInput(
            "given beside quantity = 'force'", "sensor_gain_v_per_n", where=(where,), key="sensor_gain_v_per_mm"
        )
    rest = {key: value for key, value in entry.items() if key not in mine}
    gain = 1e-3 * sensor.mass_kg * sensor.sensor_gain_v_per_n
    return rest | {"quantity": "acceleration", "sensor_gain_v_per_mm": gain}


def _covariance(rows: Any, plant: ContinuousSystem) -> tuple[tuple[float, ...], ...]:
    """Return the covariance of the plant's coefficients; none where it is of a model of another order."""
    fits = len(rows) == plant.zeros.size + plant.poles.size + 2
    return tuple(tuple(float(value) for value in row) for row in rows) if fits else ()


def _merged(table: Document, entry: Document, name: str, where: str) -> tuple[dict[str, Any], str]:
    """Return the keys of a shared table with those of the channel, which win, and how a refusal names the table."""
    require_known(table, keys_of(name), f"[{name}]")
    mine = {key: entry[key] for key in keys_of(name) if key in entry}
    return {**table, **mine}, where if mine else f"[{name}]"


def _threshold(keys: dict[str, Any], where: str, beside: Path) -> Threshold:
    curve = (in_file(Threshold) | keys)["curve"]
    with within(where, "curve"):
        resolved = resolve_curve(curve, beside) if isinstance(curve, str) else curve
    return from_table(Threshold, keys | {"curve": resolved}, where)


def _strength(keys: dict[str, Any], where: str, beside: Path) -> Strength:
    contours = keys.get("contours")
    with within(where, "contours"):
        resolved = read_contours(beside / contours) if isinstance(contours, str) else contours
    return from_table(Strength, keys | {"contours": resolved}, where)


@dataclass(frozen=True)
class _Plant:
    """A plant with what its file says of it.

    scale: the leading coefficient its file gave the denominator (loads are in its units). family: plants that
    identification cannot tell from it, and of a list of files all others; models: whose each is then. model: the
    document of model.json, None where the plant is no such file. valid_hz: where it says something of the mechanism,
    None: not known. error_db: what its magnitude may be off there, most of all between the two frequencies unsure_hz.
    recorded: what it came from. is_response: whether it was made of a response by itself.
    """

    system: ContinuousSystem
    scale: float = 1.0
    family: tuple[ContinuousSystem, ...] = ()
    model: Mapping[str, Any] | None = field(default=None, repr=False)
    valid_hz: tuple[float, float] | None = None
    error_db: float = 0.0
    unsure_hz: tuple[float, float] | None = None
    recorded: Recorded | None = None
    is_response: bool = False
    models: tuple[str, ...] = ()

    @property
    def systems(self) -> tuple[ContinuousSystem, ...]:
        return self.system, *self.family


def _plant(plant: Any, beside: Path, where: str, looped: bool) -> _Plant:
    """Return the plant of a channel; a path starts at the folder `beside`.

    looped: whether a loop is to be closed, for which a response by itself is no plant. Raises BadInput.
    """
    if plant is None:
        raise BadInput("missing", "a table, or the path of a file", where=(where,), key="plant")
    if isinstance(plant, list):
        return _of_several(plant, beside, where)
    if not isinstance(plant, str):
        return _Plant(system_of(plant, where, "plant"), _leading(plant))
    path = beside / plant
    with within(where, "plant"):
        require_kind(path, "model", "response")
    if path.suffix.lower() != ".json" and is_response(path):
        return _of_response(path, where, looped)
    document = _model_document(path, where)
    table: Document = {key: document[key] for key in ("num", "den", "delay_s") if key in document}
    family = tuple(system_of(member, where, "plant", "family") for member in document.get("family") or ())
    system = system_of(table, where, f"plant {path}")
    recorded = _recorded(document, where)
    return _Plant(system, _leading(table), family, document, _valid_hz(document, where), recorded=recorded)


def _recorded(document: Mapping[str, Any], where: str) -> Recorded | None:
    record = document.get("record")
    record = record if isinstance(record, Mapping) else {}
    spans = {"command": "command_half_span", "position": "position_half_span", "rate_hz": "rate_hz"}
    units = document.get("units")
    said = {key: record[name] for key, name in spans.items() if name in record}
    if isinstance(units, Mapping):
        said["position_unit"] = units.get("position", "")
    weighed = document.get("trust")
    if isinstance(weighed, list):
        said["distrust"] = reasons(from_table(Weighed, row, where, "plant", "trust") for row in weighed)
    return from_table(Recorded, said, where, "plant", "record") if said else None


def _of_several(paths: Sequence[Any], beside: Path, where: str) -> _Plant:
    """Return the first of several models with all others as its family, known where every one is. Raises BadInput for
    files of one name, and for models that are not of one kind.
    """
    names = [Path(path).stem if isinstance(path, str) else "" for path in paths]
    if not names or "" in names or len(set(names)) < len(names):
        raise BadInput(f"{paths!r}", "paths of model files, each name once", where=(where,), key="plant")
    plants = [_plant(path, beside, where, looped=True) for path in paths]
    kinds = [_kind(plant.model or {}) for plant in plants]
    for name, kind in zip(names, kinds, strict=True):
        for what, value in kind.items():
            if value != kinds[0][what]:
                allowed = f"that of {names[0]}, {kinds[0][what]!r}, for every model of a list"
                raise BadInput(f"{value!r}", allowed, where=(where, f"plant {name}"), key=what)
    ranges = [plant.valid_hz for plant in plants if plant.valid_hz]
    low, high = max((low for low, _ in ranges), default=0.0), min((high for _, high in ranges), default=float("inf"))
    if low >= high:
        got = f"{', '.join(names)} are valid at no frequency in common"
        raise BadInput(got, "models of one band", where=(where,), key="plant")
    systems = [(name, system) for name, plant in zip(names, plants, strict=True) for system in plant.systems]
    return replace(
        plants[0],
        family=tuple(system for _, system in systems[1:]),
        models=tuple(name for name, _ in systems),
        valid_hz=(low, high) if ranges else None,
    )


def _kind(model: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the models of one display have in common."""
    record = model.get("record")
    rate_hz = record.get("rate_hz") if isinstance(record, dict) else None
    return {"quantity": model.get("quantity"), "units": model.get("units"), "rate_hz": rate_hz}


def _valid_hz(document: Mapping[str, Any], where: str) -> tuple[float, float] | None:
    values = document.get("valid_hz")
    if values is None:
        return None
    try:
        low, high = values
        return float(low), float(high)
    except (TypeError, ValueError):
        raise BadInput(f"{values!r}", "two frequencies", where=(where, "plant"), key="valid_hz") from None


def _of_response(path: Path, where: str, looped: bool) -> _Plant:
    if looped:
        raise BadInput(
            "a response, for which no loop can be designed",
            'structure = "none", or the model that `identify` makes of it',
            where=(where, f"plant {path}"),
        )
    with within(where, f"plant {path}"):
        fit = _fitted(path, path.stat().st_mtime_ns)
    recorded = Recorded(distrust=fit.doubts) if fit.doubts else None
    return _Plant(
        fit.system,
        valid_hz=fit.valid_hz,
        error_db=fit.error_db,
        unsure_hz=fit.unsure_hz,
        recorded=recorded,
        is_response=True,
    )


@lru_cache(maxsize=16)
def _fitted(path: Path, changed_ns: int) -> ResponsePlant:
    """Return the plant of a response file; one fit for all channels that name it."""
    return plant_of_response(read_foreign_response(path))


def _leading(table: Mapping[str, Any]) -> float:
    return next((value for value in table.get("den") or () if value != 0.0), 1.0)


_FRICTION: TypeAdapter[Any] = TypeAdapter(dict[str, Number])
_COVARIANCE: TypeAdapter[Any] = TypeAdapter(list[list[Number]])


def _model_document(path: Path, where: str) -> dict[str, Any]:
    """Return the document of a model file. Raises BadInput for what is none."""
    try:
        document = read_finite_json(path)
    except BadInput as error:
        raise BadInput(
            f"{error}", "a model or response file that can be read", where=(where, f"plant {path}")
        ) from None
    with within(where, f"plant {path}"):
        if not isinstance(document, dict) or not {"num", "den"} <= set(document):
            raise BadInput("num and den are not in it", "a file that `identify` wrote")
        if document.get("format") == FORMAT:
            parse_model(document)
        for key, kind in (("friction", _FRICTION), ("covariance", _COVARIANCE)):
            _require_kind(document, key, kind)
    return document


def _require_kind(document: dict[str, Any], key: str, kind: TypeAdapter[Any]) -> None:
    try:
        if document.get(key) is not None:
            kind.validate_python(document[key])
    except ValueError:
        raise BadInput("no table of numbers", "as `identify` wrote it", key=key) from None
