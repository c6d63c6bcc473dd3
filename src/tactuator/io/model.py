"""The file model.json: an identified plant with its uncertainty. `identify` writes it, a display file names it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tactuator import __version__
from tactuator.errors import BadInput, within
from tactuator.io.atomic import write_text
from tactuator.io.kinds import read_document
from tactuator.model.plant_model import Excess, PlantModel
from tactuator.parameters import from_table
from tactuator.plain import plain
from tactuator.signals.systems import ContinuousSystem

FORMAT = "tactuator-model/1"
_FAMILY = 8
_UNITS = ("command", "position")


def model_document(model: PlantModel, family: Sequence[ContinuousSystem] = ()) -> dict[str, Any]:
    """Return the document of model.json; `family`: other plants that fit the record."""
    tables = plain(model)
    units = {what: tables.pop(f"{what}_unit") for what in _UNITS}
    members = [dict(zip(("num", "den"), map(plain, system.polynomials()), strict=True)) for system in family]
    delays = ({"delay_s": system.delay_s} for system in family)
    both = [member | delay for member, delay in zip(members, delays, strict=True)]
    return {"format": FORMAT, "tool": __version__, **tables, "units": units, "family": both}


def write_model(path: str | Path, model: PlantModel, family: Sequence[ContinuousSystem] = ()) -> None:
    """Write model.json, whole or not at all."""
    write_text(path, _text(model, family), "model")


def identified_text(model: PlantModel) -> str:
    """Return the text of model.json for a model, with the other plants that fit its record."""
    return _text(model, model.family(_FAMILY, np.random.default_rng(0)))


def _text(model: PlantModel, family: Sequence[ContinuousSystem]) -> str:
    return json.dumps(model_document(model, family), indent=1, allow_nan=False) + "\n"


def read_model(path: str | Path) -> PlantModel:
    """Read model.json; BadInput, one line, if it is not one."""
    path = Path(path)
    document = read_document(path, "model", FORMAT)
    with within(f"model {path}"):
        return parse_model(document)


def parse_model(document: dict[str, Any]) -> PlantModel:
    """Return the model of a document. Raises BadInput for what is not one, or no record can lead to."""
    known = {key: value for key, value in document.items() if key in PlantModel.__dataclass_fields__}
    units = document.get("units")
    if not isinstance(units, dict) or not set(_UNITS) <= set(units):
        raise BadInput(f"{units!r}", "the units of command and position", key="units")
    excess = {"excess": Excess.none()} if known.get("excess") is None else {}
    return _sound(from_table(PlantModel, known | excess | {f"{what}_unit": units[what] for what in _UNITS}))


def _sound(model: PlantModel) -> PlantModel:
    """Return the model. Raises BadInput for one that no record can lead to."""
    flat = model.num.ndim == model.den.ndim == 1
    if not flat or not model.num.any() or not model.den.any() or model.den[0] == 0.0:
        raise BadInput("num or den is zero, begins with one, or is no list", "coefficients, the highest first")
    for name, band in (("band_hz", model.band_hz), ("valid_hz", model.valid_hz or (0.0, 1.0))):
        if not 0.0 <= band[0] < band[1]:
            raise BadInput(f"{name} is {band[0]:g} to {band[1]:g}", "from a lower frequency to a higher")
    if not model.delay_s >= 0.0:
        raise BadInput(f"delay_s is {model.delay_s:g}", "zero or more")
    if np.any(np.diag(model.covariance) < 0.0):
        raise BadInput("covariance has a variance below zero", "zero or more")
    excess = (model.excess.frequency_hz, model.excess.magnitude, model.excess.phase_rad)
    if {column.shape for column in excess} != {(excess[0].size,)} or not excess[0].size:
        raise BadInput("excess has columns of unequal length", "as many of each, one or more")
    if np.any(excess[0] <= 0.0) or np.any(np.diff(excess[0]) < 0.0):
        raise BadInput("excess has frequencies that do not ascend", "ascending, above zero")
    return model
