"""Display files: TOML to `Display`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, ValidationError

from tactuator.errors import BadInput
from tactuator.io.curve import resolve_curve
from tactuator.io.display_schema import (
    SHARED_TABLES,
    ChannelOwnKeys,
    ConverterKeys,
    CurveTable,
    DisplayKeys,
    FeedbackKeys,
    ForceKeys,
    ModelKeys,
    ObjectivesKeys,
    PlantTable,
    PrefilterKeys,
    SoundKeys,
    ThresholdKeys,
    TouchKeys,
    WireKeys,
    require_travel_seen,
)
from tactuator.io.foreign_response import is_response, read_foreign_response
from tactuator.io.formats.environment import channel_environment, with_measured
from tactuator.io.formats.text import parse_toml, read_finite_json, read_text
from tactuator.io.model import FORMAT, parse_model
from tactuator.model.description import Channel, Converter, Display, Threshold
from tactuator.model.load import Load
from tactuator.model.requirements import FeedbackRequirements, Objectives, PrefilterRequirements
from tactuator.model.response_plant import ResponsePlant, plant_of_response
from tactuator.model.sound_card import SoundCard, Wires
from tactuator.model.touch import Touch
from tactuator.perception.curve import ThresholdCurve
from tactuator.signals.systems import ContinuousSystem

Document = Mapping[str, Any]
_Model = TypeVar("_Model", bound=BaseModel)


def read_display(path: str | Path) -> Display:
    """Read a display file (TOML).

    Raises BadInput, one line, for a file that cannot be read, a key that is not known, a figure out of its range.
    """
    path = Path(path)
    try:
        document = parse_toml(read_text(path))
    except BadInput as error:
        raise BadInput(f"display file {path}: {error}", "a TOML file that can be read") from None
    try:
        return parse_display(document, path.parent)
    except BadInput as error:
        raise error.within(f"display file {path}") from None


def parse_display(document: Document, beside: Path = Path()) -> Display:
    """Return the display of a document's tables; relative paths in it start at the folder `beside`."""
    allowed = {"display", "channel", "objectives", "sound", "touch", *SHARED_TABLES}
    for key in document:
        if key not in allowed:
            raise BadInput(f"table [{key}] is not known", f"{', '.join(sorted(allowed))}")
    head = _checked(DisplayKeys, _table(document, "display"), "[display]")
    channels = document.get("channel", [])
    if not isinstance(channels, list) or not all(isinstance(entry, Mapping) for entry in channels):
        raise BadInput("[[channel]] is not a list of tables", "one [[channel]] for each finger")
    objectives = _checked(ObjectivesKeys, _table(document, "objectives"), "[objectives]")
    return Display(
        head.name,
        head.rate_hz,
        head.delay_samples,
        tuple(_channel(document, entry, beside) for entry in channels),
        Objectives(**objectives.model_dump()),
        _sound_card(_table(document, "sound"), channels) if "sound" in document else None,
        Touch(**_checked(TouchKeys, _table(document, "touch"), "[touch]").model_dump()),
    )


def _sound_card(table: Document, channels: Sequence[Document]) -> SoundCard:
    """Return the wiring of the channels, each with its own keys before those of [sound]."""
    for key in table:
        if key not in SoundKeys.model_fields and key not in WireKeys.model_fields:
            allowed = ", ".join([*SoundKeys.model_fields, *WireKeys.model_fields])
            raise BadInput(f"[sound] has no key {key!r}", f"{allowed}")
    head = _checked(SoundKeys, {key: table[key] for key in SoundKeys.model_fields if key in table}, "[sound]")
    wires = []
    for place, entry in enumerate(channels, 1):
        own = {key: entry.get(key, table.get(key)) for key in WireKeys.model_fields}
        keys = _checked(WireKeys, own, f"[[channel]] {entry.get('name', '')!r}")
        if keys.output_full_scale_v is None:
            raise BadInput("[sound] lacks the key 'output_full_scale_v'", "what `sound calibrate` measures")
        given = {name: value for name, value in keys.model_dump().items() if value is not None}
        wires.append(Wires(**{"output": place, "input": place} | given))
    return SoundCard(tuple(wires), **head.model_dump())


def with_curve(display: Display, curve: ThresholdCurve) -> Display:
    """Return the display with `curve` in place of every channel's own."""
    channels = (replace(one, threshold=replace(one.threshold, curve=curve)) for one in display.channels)
    return replace(display, channels=tuple(channels))


def _table(document: Document, name: str) -> Mapping[str, Any]:
    table = document.get(name, {})
    if not isinstance(table, Mapping):
        raise BadInput(f"{name} is {table!r}", f"a table [{name}]")
    return table


def _checked(model: type[_Model], values: Mapping[str, Any], where: str) -> _Model:
    try:
        return model.model_validate(dict(values))
    except ValidationError as error:
        raise BadInput(_first_fault(model, error, where)) from None


def _first_fault(model: type[BaseModel], error: ValidationError, where: str) -> str:
    faults = error.errors(include_url=False)
    fault = next((one for one in faults if one["type"] == "extra_forbidden"), faults[0])
    key = ".".join(str(part) for part in fault["loc"])
    if fault["type"] == "extra_forbidden" and len(fault["loc"]) == 1:
        return f"{where} has no key {key!r}; allowed: {', '.join(model.model_fields)}"
    if fault["type"] == "missing":
        return f"{where} lacks the key {key!r}; allowed: a table that has it"
    message = fault["msg"][0].lower() + fault["msg"][1:]
    if fault["type"] == "bool_type":
        message = "true or false, without quotation marks"
    return f"{where} {key} is {fault['input']!r}; allowed: {message.removeprefix('input should be ')}"


def _channel(document: Document, entry: Mapping[str, Any], beside: Path) -> Channel:
    where = f"[[channel]] {entry.get('name', '')!r}"
    entry = _as_acceleration(entry, where)
    shared = {key for model in SHARED_TABLES.values() for key in model.model_fields}
    shared |= set(WireKeys.model_fields if "sound" in document else ())
    own = _checked(ChannelOwnKeys, {key: value for key, value in entry.items() if key not in shared}, where)
    tables = {name: _merged(model, document, entry, name, where) for name, model in SHARED_TABLES.items()}
    feedback = _feedback(tables["feedback"], where)
    found = _plant(own.plant, beside, where, feedback.structure != "none")
    scale, model = found.scale, found.model
    if own.loads and found.is_response:
        raise BadInput(
            f"{where} loads: what a load changes cannot be told from a response by itself",
            "none, or the model that `identify` makes of it",
        )
    require_travel_seen(own, tables["converter"].range_v, feedback.structure != "none", where)
    loads = (Load(one.name, one.mass / scale, one.damping / scale, one.stiffness / scale) for one in own.loads)
    family = tuple(system_of(member, f"{where} family") for member in own.family)
    return Channel(
        name=own.name,
        finger=own.finger or own.name,
        sensor_gain_v_per_mm=own.sensor_gain_v_per_mm,
        travel_mm=own.travel_mm,
        plant=found.system,
        threshold=_threshold(tables["threshold"], beside),
        quantity=own.quantity,
        loads=tuple(loads),
        converter=_converter(tables["converter"]),
        feedback=feedback,
        prefilter=_prefilter(tables["prefilter"]),
        environment=channel_environment(
            with_measured(tables["environment"], beside, own.name, where),
            None if model is None else model.get("friction") or {},
        ),
        family=family + found.family,
        covariance=_covariance(own.covariance or (model or {}).get("covariance", ()), found.system),
        valid_hz=own.valid_hz or found.valid_hz,
        model_error_db=found.error_db if own.model_error_db is None else own.model_error_db,
        model_error_hz=own.model_error_hz or (found.unsure_hz if own.model_error_db is None else None),
    )


def _as_acceleration(entry: Mapping[str, Any], where: str) -> Mapping[str, Any]:
    """Return the entry of a force sensor that moves a known mass as that of an accelerometer: 1 mm/s² is mass_kg mN."""
    if entry.get("quantity") != "force":
        return entry
    known = {key: entry[key] for key in ForceKeys.model_fields if key in entry}
    keys = _checked(ForceKeys, known, f"{where} quantity = 'force', which alone does not tell how far a finger moves,")
    if "sensor_gain_v_per_mm" in entry:
        raise BadInput(f"{where} sensor_gain_v_per_mm beside quantity = 'force'", "sensor_gain_v_per_n")
    rest = {key: value for key, value in entry.items() if key not in known}
    gain = 1e-3 * keys.mass_kg * keys.sensor_gain_v_per_n
    return rest | {"quantity": "acceleration", "sensor_gain_v_per_mm": gain}


def _covariance(rows: Sequence[Sequence[float]], plant: ContinuousSystem) -> tuple[tuple[float, ...], ...]:
    """Return the covariance of the plant's coefficients; none where it is of a model of another order."""
    fits = len(rows) == plant.zeros.size + plant.poles.size + 2
    return tuple(tuple(float(value) for value in row) for row in rows) if fits else ()


def _merged(model: type[BaseModel], document: Document, entry: Document, name: str, where: str) -> Any:
    table = _table(document, name)
    _checked(model, table, f"[{name}]")
    mine = {key: entry[key] for key in model.model_fields if key in entry}
    return _checked(model, {**table, **mine}, where if mine else f"[{name}]")


def _tuples(keys: BaseModel) -> dict[str, Any]:
    return {name: tuple(v) if isinstance(v, list) else v for name, v in keys.model_dump().items()}


def _converter(keys: ConverterKeys) -> Converter:
    return Converter(**keys.model_dump())


def _prefilter(keys: PrefilterKeys) -> PrefilterRequirements:
    return PrefilterRequirements(**keys.model_dump())


def _feedback(keys: FeedbackKeys, where: str) -> FeedbackRequirements:
    values = _tuples(keys)
    values["controller"] = None if keys.controller is None else system_of(keys.controller, f"{where} controller")
    return FeedbackRequirements(**values)


def _threshold(keys: ThresholdKeys, beside: Path) -> Threshold:
    if isinstance(keys.curve, CurveTable):
        table = keys.curve
        curve = ThresholdCurve(**table.model_dump())
    else:
        curve = resolve_curve(keys.curve, beside)
    return Threshold(curve, keys.band_hz)


_KEYS = ("num", "den", "delay_s")


@dataclass(frozen=True)
class _Plant:
    """A plant with what its file says of it.

    scale: the leading coefficient its file gave the denominator (loads are in its units). family: plants that
    identification cannot tell from it. model: the document of model.json, None where the plant is no such file.
    valid_hz: where it says something of the mechanism, None: not known. error_db: what its magnitude may be off there,
    most of all between the two frequencies unsure_hz. is_response: whether it was made of a response by itself.
    """

    system: ContinuousSystem
    scale: float = 1.0
    family: tuple[ContinuousSystem, ...] = ()
    model: Mapping[str, Any] | None = field(default=None, repr=False)
    valid_hz: tuple[float, float] | None = None
    error_db: float = 0.0
    unsure_hz: tuple[float, float] | None = None
    is_response: bool = False


def _plant(plant: PlantTable | str, beside: Path, where: str, looped: bool) -> _Plant:
    """Return the plant of a channel; a path starts at the folder `beside`.

    looped: whether a loop is to be closed, for which a response by itself is no plant. Raises BadInput.
    """
    if not isinstance(plant, str):
        return _Plant(system_of(plant, f"{where} plant"), _leading(plant))
    path = beside / plant
    if path.suffix.lower() != ".json" and is_response(path):
        return _of_response(path, where, looped)
    document = _model_document(path, where)
    table = _checked(PlantTable, {key: document[key] for key in _KEYS if key in document}, f"{where} plant")
    family = tuple(
        system_of(_checked(PlantTable, member, f"{where} family"), f"{where} family")
        for member in document.get("family", [])
    )
    return _Plant(system_of(table, f"{where} plant"), _leading(table), family, document, _valid_hz(document, where))


def _valid_hz(document: Mapping[str, Any], where: str) -> tuple[float, float] | None:
    values = document.get("valid_hz")
    if values is None:
        return None
    try:
        low, high = values
        return float(low), float(high)
    except (TypeError, ValueError):
        raise BadInput(f"{where} plant: valid_hz is {values!r}", "two frequencies") from None


def _of_response(path: Path, where: str, looped: bool) -> _Plant:
    if looped:
        raise BadInput(
            f"{where} plant {path}: a response, for which no loop can be designed",
            'structure = "none", or the model that `identify` makes of it',
        )
    try:
        found = _fitted(path, path.stat().st_mtime_ns)
    except BadInput as error:
        raise error.within(f"{where} plant {path}") from None
    return _Plant(
        found.system, valid_hz=found.valid_hz, error_db=found.error_db, unsure_hz=found.unsure_hz, is_response=True
    )


@lru_cache(maxsize=16)
def _fitted(path: Path, changed_ns: int) -> ResponsePlant:
    """Return the plant of a response file; one fit for all channels that name it."""
    return plant_of_response(read_foreign_response(path))


def _leading(table: PlantTable) -> float:
    return 1.0 if table.den is None else next((value for value in table.den if value != 0.0), 1.0)


def _model_document(path: Path, where: str) -> dict[str, Any]:
    try:
        document = read_finite_json(path)
    except BadInput as error:
        raise BadInput(f"{where} plant {path}: {error}", "a model or response file that can be read") from None
    if not isinstance(document, dict) or not {"num", "den"} <= set(document):
        raise BadInput(f"{where} plant {path}: num and den are not in it", "a file that `identify` wrote")
    try:
        if document.get("format") == FORMAT:
            parse_model(document)
    except BadInput as error:
        raise error.within(f"{where} plant {path}") from None
    _checked(ModelKeys, document, f"{where} plant {path}")
    return document


def system_of(table: PlantTable, where: str) -> ContinuousSystem:
    """Return the system of a {num, den} or {zeros, poles, gain} table. Raises BadInput where it is neither or not a
    system.
    """
    by_polynomials = table.num is not None and table.den is not None
    by_roots = table.poles is not None and table.gain is not None
    if by_polynomials == by_roots:
        raise BadInput(f"{where} is neither one nor the other", "{num, den} or {zeros, poles, gain}")
    try:
        if by_polynomials:
            return ContinuousSystem.from_polynomials(table.num or [], table.den or [], table.delay_s)
        zeros, poles = ([_complex(root) for root in roots or []] for roots in (table.zeros, table.poles))
        if table.gain == 0.0:
            raise BadInput("gain is zero", "any other number")
        return ContinuousSystem(np.array(zeros), np.array(poles), float(table.gain or 0.0), table.delay_s)
    except BadInput as error:
        raise error.within(f"{where}") from None


def _complex(root: float | tuple[float, float]) -> complex:
    return complex(*root) if isinstance(root, tuple) else complex(root)
