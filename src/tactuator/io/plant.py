"""Plants of a display file: a table, the model.json of `identify` or several of them, or a response by itself."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from tactuator.errors import BadInput, named_file, within
from tactuator.io.column_name import NO_UNIT, QUANTITIES, unit_of
from tactuator.io.columns import read_columns
from tactuator.io.kinds import require_kind
from tactuator.io.model import FORMAT, parse_model
from tactuator.io.response_table import NO_NAMES, ResponseColumns, are_of_response, response_of
from tactuator.io.text import read_finite_json
from tactuator.model.description import Recorded
from tactuator.model.plant import system_of
from tactuator.model.plant_model import QualityCheck, reasons
from tactuator.model.response_plant import plant_of_response
from tactuator.parameters import Coefficient, Number, from_table
from tactuator.signals.record import FrequencyResponse
from tactuator.signals.systems import ContinuousSystem


@dataclass(frozen=True)
class GivenPlant:
    """A plant of a display file.

    keys: those of a channel that the plant's file states, among them `plant`; the channel's own win. leading: first
    coefficient of the denominator as it is written. model: the document of model.json, None where the plant is no such
    file. is_response: whether the plant was made of a response by itself. by_unit: the quantity that its unit shows.
    """

    keys: Mapping[str, Any]
    leading: float = 1.0
    model: Mapping[str, Any] | None = field(default=None, repr=False)
    is_response: bool = False
    quantity: str = ""
    by_unit: str = ""

    @property
    def systems(self) -> tuple[ContinuousSystem, ...]:
        """Return the plant and the others that fit its record."""
        return self.keys["plant"], *self.keys.get("family", ())


def given_plant(plant: Any, beside: Path, where: str, looped: bool, sensor_gain: Any = 1.0) -> GivenPlant:
    """Return the plant of a channel, in volts of its sensor; a path starts at the folder `beside`.

    looped: whether a loop is to be closed, for which a response by itself is no plant. sensor_gain: of the channel, in
    V per mm, mm/s or mm/s², for files in units of motion; what is no number is refused elsewhere. Raises BadInput.
    """
    sensor_gain = sensor_gain if isinstance(sensor_gain, float | int) else 1.0
    if plant is None:
        raise BadInput("missing", "a table, or the path of a file", where=(where,), key="plant")
    if isinstance(plant, list):
        return _of_several(plant, beside, where, sensor_gain)
    columns = NO_NAMES
    if isinstance(plant, Mapping) and isinstance(plant.get("file"), str):
        columns = from_table(ResponseColumns, {key: plant[key] for key in plant if key != "file"}, where, "plant")
        plant = plant["file"]
    if not isinstance(plant, str):
        return GivenPlant({"plant": system_of(plant, where, "plant")}, _leading(plant))
    with named_file(beside / plant, "plant"):
        return _of_file(beside / plant, where, looped, columns, sensor_gain)


def _of_file(path: Path, where: str, looped: bool, columns: ResponseColumns, sensor_gain: float) -> GivenPlant:
    with within(where, "plant"):
        require_kind(path, "model", "response")
    response = None
    if path.suffix.lower() != ".json" and os.path.isfile(path):  # noqa: PTH113  (False for any text)
        with within(where, f"plant {path}"):
            response = _response(path, path.stat().st_mtime_ns, columns)
    if response is None:
        return _of_model(path, where, sensor_gain)
    return _of_response(response, path, where, looped, sensor_gain)


def _moved(unit: str) -> str:
    """Return the quantity of motion that a unit is of, "" for another."""
    kind = (unit_of(unit) or NO_UNIT).kind
    return kind if kind in QUANTITIES else ""


def _volts(unit: str, sensor_gain: float) -> float:
    """Return the volts that one unit of a record is: of motion, the sensor's; 1 for a unit that is not known."""
    known = unit_of(unit) or NO_UNIT
    return {"voltage": 1.0, **dict.fromkeys(QUANTITIES, 1e3 * sensor_gain)}.get(known.kind, 1.0) * known.factor


def _of_model(path: Path, where: str, sensor_gain: float) -> GivenPlant:
    document = _model_document(path, where)
    units = document.get("units")
    units = units if isinstance(units, Mapping) else {}
    command, position = (_volts(str(units.get(what, "")), sensor_gain) for what in ("command", "position"))
    table: Mapping[str, Any] = {key: document[key] for key in ("num", "den", "delay_s") if key in document}
    system, *others = (
        replace(each, gain=each.gain * position / command)
        for each in (
            system_of(table, where, f"plant {path}"),
            *(system_of(member, where, "plant", "family") for member in document.get("family") or ()),
        )
    )
    covariance = np.asarray(document.get("covariance") or np.zeros((0, 0)), dtype=np.float64)
    of_row = np.where(np.arange(len(covariance)) <= system.zeros.size, position / command, 1.0)
    keys = {
        "plant": system,
        "family": tuple(others),
        "valid_hz": _valid_hz(document, where),
        "recorded": _recorded(document, where, command, position),
        # of a model of another order, by hand, it says nothing
        "covariance": (of_row[:, None] * covariance * of_row).tolist()
        if len(covariance) == system.zeros.size + system.poles.size + 2
        else (),
    }
    known = {key: value for key, value in keys.items() if value not in (None, ())}
    volts = {"coulomb": command, "presliding": position}
    friction = {name: value * volts.get(name, 1.0) for name, value in (document.get("friction") or {}).items()}
    model = document | {"friction": friction}
    by_unit = _moved(str(units.get("position", "")))
    return GivenPlant(known, _leading(table), model, quantity=str(document.get("quantity", "")), by_unit=by_unit)


def _recorded(document: Mapping[str, Any], where: str, command: float, position: float) -> Recorded | None:
    """Return what is known of a model's record, its amplitudes in volts; command, position: volts in their units."""
    record = document.get("record")
    record = record if isinstance(record, Mapping) else {}
    spans = {"command": "command_half_span", "position": "position_half_span", "rate_hz": "rate_hz"}
    said = {key: record[name] for key, name in spans.items() if name in record}
    if isinstance(units := document.get("units"), Mapping):
        said["position_unit"] = units.get("position", "")
    checks = document.get("trust")
    if isinstance(checks, list):
        said["distrust"] = reasons(from_table(QualityCheck, row, where, "plant", "trust") for row in checks)
    if not said:
        return None
    read = from_table(Recorded, said, where, "plant", "record")
    spans_v = {"command": command, "position": position}
    return replace(read, **{key: volts * value for key, volts in spans_v.items() if (value := getattr(read, key))})


def _of_several(paths: Sequence[Any], beside: Path, where: str, sensor_gain: float) -> GivenPlant:
    """Return the first of several models with all others as its family, known where every one is. Raises BadInput for
    files of one name, and for models that are not of one kind.
    """
    names = [Path(path).stem if isinstance(path, str) else "" for path in paths]
    if not names or "" in names or len(set(names)) < len(names):
        raise BadInput(f"{paths!r}", "paths of model files, each name once", where=(where,), key="plant")
    plants = [given_plant(path, beside, where, True, sensor_gain) for path in paths]
    kinds = [_kind(plant.model or {}) for plant in plants]
    for name, kind in zip(names, kinds, strict=True):
        for what, value in kind.items():
            if value != kinds[0][what]:
                allowed = f"that of {names[0]}, {kinds[0][what]!r}, for every model of a list"
                raise BadInput(f"{value!r}", allowed, where=(where, f"plant {name}"), key=what)
    ranges = [plant.keys["valid_hz"] for plant in plants if "valid_hz" in plant.keys]
    low, high = max((low for low, _ in ranges), default=0.0), min((high for _, high in ranges), default=float("inf"))
    if low >= high:
        got = f"{', '.join(names)} are valid at no frequency in common"
        raise BadInput(got, "models of one band", where=(where,), key="plant")
    systems = [(name, system) for name, plant in zip(names, plants, strict=True) for system in plant.systems]
    together = {"family": tuple(system for _, system in systems[1:]), "models": tuple(name for name, _ in systems)}
    valid = {"valid_hz": (low, high)} if ranges else {}
    reasons_of = {
        name: plant.keys["recorded"].distrust
        for name, plant in zip(names, plants, strict=True)
        if "recorded" in plant.keys
    }
    distrust = tuple(f"{name}: {reason}" for name, each in reasons_of.items() for reason in each)
    first = plants[0].keys.get("recorded", Recorded())
    recorded = {"recorded": replace(first, distrust=distrust)} if reasons_of else {}
    return replace(plants[0], keys={**plants[0].keys, **together, **valid, **recorded})


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


def _of_response(response: FrequencyResponse, path: Path, where: str, looped: bool, sensor_gain: float) -> GivenPlant:
    if looped:
        raise BadInput(
            "a response, for which no loop can be designed",
            'structure = "none", or the model that `identify` makes of it',
            where=(where, f"plant {path}"),
        )
    with within(where, f"plant {path}"):
        fit = _fitted(response)
    keys: dict[str, Any] = {
        "plant": replace(fit.system, gain=fit.system.gain * _volts(response.about.get("unit", ""), sensor_gain)),
        "valid_hz": fit.valid_hz,
        "model_error_db": fit.error_db,
        "model_error_hz": fit.unsure_hz,
        "recorded": Recorded(distrust=fit.doubts, remarks=response.remarks),
    }
    by_unit = _moved(response.about.get("unit", ""))
    return GivenPlant(keys, is_response=True, quantity=response.about.get("quantity", ""), by_unit=by_unit)


@lru_cache(maxsize=16)
def _response(path: Path, changed_ns: int, names: ResponseColumns) -> FrequencyResponse | None:
    """Return the response of a file, one for all channels that name it; None for another file."""
    with path.open("rb") as file:
        if file.read(64).lstrip().startswith(b"{"):
            return None
    columns = read_columns(path)
    try:
        return response_of(path, columns, names) if are_of_response(columns, names) else None
    except BadInput as error:  # an option of `identify` is here a key
        error.allowed += "; in a display: plant = { file = ..., phase = ... }"
        raise


_fitted = lru_cache(maxsize=16)(plant_of_response)


def _leading(table: Mapping[str, Any]) -> float:
    return next((value for value in table.get("den") or () if value != 0.0), 1.0)


_FRICTION: TypeAdapter[Any] = TypeAdapter(dict[str, Number])
_COVARIANCE: TypeAdapter[Any] = TypeAdapter(list[list[Coefficient]])


def _model_document(path: Path, where: str) -> dict[str, Any]:
    """Return the document of a model file. Raises BadInput for what is none."""
    with within(where, f"plant {path}"):
        document: dict[str, Any] = read_finite_json(path)
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
