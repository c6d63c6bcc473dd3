"""The file model.json: an identified plant with its uncertainty, as `identify` writes it and a display file
names it.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tactuator import __version__
from tactuator.errors import BadInput
from tactuator.io.atomic import write_text
from tactuator.io.text import read_finite_json
from tactuator.model.plant_model import Excess, PlantModel
from tactuator.signals.systems import ContinuousSystem

FORMAT = "tactuator-model/1"
_FAMILY = 8
_SMALLEST = 1e-100
"""Smallest magnitude of a coefficient that is not zero: beyond it products overflow."""


def model_document(model: PlantModel, family: Sequence[ContinuousSystem] = ()) -> dict[str, Any]:
    """Return the document of model.json; `family`: other plants that the record cannot tell from the model."""
    return {
        "format": FORMAT,
        "tool": __version__,
        "num": model.num.tolist(),
        "den": model.den.tolist(),
        "delay_s": model.delay_s,
        "quantity": model.quantity,
        "units": {"command": model.command_unit, "position": model.position_unit},
        "covariance": model.covariance.tolist(),
        "band_hz": list(model.band_hz),
        "method": model.method,
        "friction": dict(model.friction),
        "family": [_family_member(one) for one in family],
        "valid_hz": None if model.valid_hz is None else list(model.valid_hz),
        "excess": {
            "frequency_hz": model.excess.frequency_hz.tolist(),
            "magnitude": model.excess.magnitude.tolist(),
            "phase_rad": model.excess.phase.tolist(),
        },
        "record": dict(model.record),
        "calibration": dict(model.calibration),
    }


def _family_member(system: ContinuousSystem) -> dict[str, Any]:
    num, den = system.polynomials()
    return {"num": num.tolist(), "den": den.tolist(), "delay_s": system.delay_s}


def write_model(path: str | Path, model: PlantModel, family: Sequence[ContinuousSystem] = ()) -> None:
    """Write model.json, whole or not at all."""
    write_text(path, _text(model, family))


def identified_text(model: PlantModel) -> str:
    """Return the text of model.json for a model with the plants that its record cannot tell from it."""
    return _text(model, model.family(_FAMILY, np.random.default_rng(0)))


def write_identified(path: str | Path, model: PlantModel) -> None:
    """Write model.json with the plants that the record cannot tell from the model, whole or not at all."""
    write_text(path, identified_text(model))


def _text(model: PlantModel, family: Sequence[ContinuousSystem]) -> str:
    return json.dumps(model_document(model, family), indent=1, allow_nan=False) + "\n"


def read_model(path: str | Path) -> PlantModel:
    """Read model.json; BadInput, one line, if it is not one."""
    path = Path(path)
    try:
        document = read_finite_json(path)
    except BadInput as error:
        raise BadInput(f"model {path}: {error}", "a file that `identify` wrote") from None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise BadInput(f"model {path}: format is not {FORMAT!r}", "a file that `identify` wrote")
    try:
        return parse_model(document)
    except BadInput as error:
        raise error.within(f"model {path}") from None


def parse_model(document: dict[str, Any]) -> PlantModel:
    """Return the model of a document. Raises BadInput for what is not one, or no record can lead to."""
    try:
        return _sound(_model(document))
    except BadInput:
        raise
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise BadInput(f"{error} is amiss", "a file that `identify` wrote") from None


def _model(document: dict[str, Any]) -> PlantModel:
    low, high = document["band_hz"]
    return PlantModel(
        num=np.asarray(document["num"], dtype=np.float64),
        den=np.asarray(document["den"], dtype=np.float64),
        delay_s=float(document["delay_s"]),
        covariance=np.asarray(document["covariance"], dtype=np.float64),
        band_hz=(float(low), float(high)),
        quantity=str(document["quantity"]),
        command_unit=str(document["units"]["command"]),
        position_unit=str(document["units"]["position"]),
        method=str(document["method"]),
        record=document["record"],
        calibration=document["calibration"],
        friction=document["friction"],
        excess=_excess(document.get("excess")),
        valid_hz=_pair(document.get("valid_hz")),
    )


def _sound(model: PlantModel) -> PlantModel:
    """Return the model. Raises BadInput for one that no record can lead to."""
    flat = model.num.ndim == model.den.ndim == 1
    if not flat or not model.num.any() or not model.den.any() or model.den[0] == 0.0:
        raise BadInput("num or den is zero, begins with one, or is no list", "coefficients, the highest first")
    for name, values in (("num", model.num), ("den", model.den), ("covariance", model.covariance)):
        size = np.abs(values[values != 0.0])
        if size.size and not (np.min(size) > _SMALLEST and np.max(size) < 1.0 / _SMALLEST):
            raise BadInput(f"{name} has a number of size {np.max(size):g}", f"{_SMALLEST:g} to {1 / _SMALLEST:g}")
    for name, band in (("band_hz", model.band_hz), ("valid_hz", model.valid_hz or (0.0, 1.0))):
        if not 0.0 <= band[0] < band[1]:
            raise BadInput(f"{name} is {band[0]:g} to {band[1]:g}", "from a lower frequency to a higher")
    if not model.delay_s >= 0.0:
        raise BadInput(f"delay_s is {model.delay_s:g}", "zero or more")
    if np.any(np.diag(model.covariance) < 0.0):
        raise BadInput("covariance has a variance below zero", "zero or more")
    excess = (model.excess.frequency_hz, model.excess.magnitude, model.excess.phase)
    if {one.shape for one in excess} != {(excess[0].size,)} or not excess[0].size:
        raise BadInput("excess has columns of unequal length", "as many of each, one or more")
    if np.any(excess[0] <= 0.0) or np.any(np.diff(excess[0]) < 0.0):
        raise BadInput("excess has frequencies that do not ascend", "ascending, above zero")
    for name in ("record", "calibration", "friction"):
        if not isinstance(getattr(model, name), dict):
            raise BadInput(f"{name} is {getattr(model, name)!r}", "a table")
    return model


def _excess(table: dict[str, Any] | None) -> Excess:
    if table is None:
        return Excess.none()
    columns = (np.asarray(table[name], dtype=np.float64) for name in ("frequency_hz", "magnitude", "phase_rad"))
    return Excess(*columns)


def _pair(values: Any) -> tuple[float, float] | None:
    return None if values is None else (float(values[0]), float(values[1]))
