"""Plants of a display file: a table, the model.json of `identify` or several of them, or a response by itself."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from tactuator.errors import BadInput, named_file, within
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
    file. is_response: whether the plant was made of a response by itself.
    """

    keys: Mapping[str, Any]
    leading: float = 1.0
    model: Mapping[str, Any] | None = field(default=None, repr=False)
    is_response: bool = False
    quantity: str = ""

    @property
    def systems(self) -> tuple[ContinuousSystem, ...]:
        """Return the plant and the others that fit its record."""
        return self.keys["plant"], *self.keys.get("family", ())


def given_plant(plant: Any, beside: Path, where: str, looped: bool) -> GivenPlant:
    """Return the plant of a channel; a path starts at the folder `beside`.

    looped: whether a loop is to be closed, for which a response by itself is no plant. Raises BadInput.
    """
    if plant is None:
        raise BadInput("missing", "a table, or the path of a file", where=(where,), key="plant")
    if isinstance(plant, list):
        return _of_several(plant, beside, where)
    columns = NO_NAMES
    if isinstance(plant, Mapping) and isinstance(plant.get("file"), str):
        columns = from_table(ResponseColumns, {key: plant[key] for key in plant if key != "file"}, where, "plant")
        plant = plant["file"]
    if not isinstance(plant, str):
        return GivenPlant({"plant": system_of(plant, where, "plant")}, _leading(plant))
    with named_file(beside / plant, "plant"):
        return _of_file(beside / plant, where, looped, columns)


def _of_file(path: Path, where: str, looped: bool, columns: ResponseColumns) -> GivenPlant:
    with within(where, "plant"):
        require_kind(path, "model", "response")
    response = None
    if path.suffix.lower() != ".json" and os.path.isfile(path):  # noqa: PTH113  (False for any text)
        with within(where, f"plant {path}"):
            response = _response(path, path.stat().st_mtime_ns, columns)
    return _of_model(path, where) if response is None else _of_response(response, path, where, looped)


def _of_model(path: Path, where: str) -> GivenPlant:
    document = _model_document(path, where)
    table: Mapping[str, Any] = {key: document[key] for key in ("num", "den", "delay_s") if key in document}
    system = system_of(table, where, f"plant {path}")
    covariance = document.get("covariance") or ()
    keys = {
        "plant": system,
        "family": tuple(system_of(member, where, "plant", "family") for member in document.get("family") or ()),
        "valid_hz": _valid_hz(document, where),
        "recorded": _recorded(document, where),
        # of a model of another order, by hand, it says nothing
        "covariance": covariance if len(covariance) == system.zeros.size + system.poles.size + 2 else (),
    }
    known = {key: value for key, value in keys.items() if value not in (None, ())}
    return GivenPlant(known, _leading(table), document, quantity=str(document.get("quantity", "")))


def _recorded(document: Mapping[str, Any], where: str) -> Recorded | None:
    record = document.get("record")
    record = record if isinstance(record, Mapping) else {}
    spans = {"command": "command_half_span", "position": "position_half_span", "rate_hz": "rate_hz"}
    units = document.get("units")
    said = {key: record[name] for key, name in spans.items() if name in record}
    if isinstance(units, Mapping):
        said["position_unit"] = units.get("position", "")
    checks = document.get("trust")
    if isinstance(checks, list):
        said["distrust"] = reasons(from_table(QualityCheck, row, where, "plant", "trust") for row in checks)
    return from_table(Recorded, said, where, "plant", "record") if said else None


def _of_several(paths: Sequence[Any], beside: Path, where: str) -> GivenPlant:
    """Return the first of several models with all others as its family, known where every one is. Raises BadInput for
    files of one name, and for models that are not of one kind.
    """
    names = [Path(path).stem if isinstance(path, str) else "" for path in paths]
    if not names or "" in names or len(set(names)) < len(names):
        raise BadInput(f"{paths!r}", "paths of model files, each name once", where=(where,), key="plant")
    plants = [given_plant(path, beside, where, looped=True) for path in paths]
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


def _of_response(response: FrequencyResponse, path: Path, where: str, looped: bool) -> GivenPlant:
    if looped:
        raise BadInput(
            "a response, for which no loop can be designed",
            'structure = "none", or the model that `identify` makes of it',
            where=(where, f"plant {path}"),
        )
    with within(where, f"plant {path}"):
        fit = _fitted(response)
    keys: dict[str, Any] = {
        "plant": fit.system,
        "valid_hz": fit.valid_hz,
        "model_error_db": fit.error_db,
        "model_error_hz": fit.unsure_hz,
        "recorded": Recorded(distrust=fit.doubts, remarks=response.remarks),
    }
    return GivenPlant(keys, is_response=True, quantity=response.about.get("quantity", ""))


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
