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
from tactuator.display.plant_model import Excess, PlantModel
from tactuator.errors import BadInput
from tactuator.files.atomic import write_text
from tactuator.signals.systems import ContinuousSystem

FORMAT = "tactuator-model/1"


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
    write_text(path, json.dumps(model_document(model, family), indent=1, allow_nan=False) + "\n")


def read_model(path: str | Path) -> PlantModel:
    """Read model.json; BadInput, one line, if it is not one."""
    path = Path(path)
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not JSON"
        raise BadInput(f"model {path}: {reason}; allowed: a file that `identify` wrote") from None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise BadInput(f"model {path}: format is not {FORMAT!r}; allowed: a file that `identify` wrote")
    try:
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
    except (KeyError, TypeError, ValueError) as error:
        raise BadInput(f"model {path}: {error} is amiss; allowed: a file that `identify` wrote") from None


def _excess(table: dict[str, Any] | None) -> Excess:
    if table is None:
        return Excess.none()
    columns = (np.asarray(table[name], dtype=np.float64) for name in ("frequency_hz", "magnitude", "phase_rad"))
    return Excess(*columns)


def _pair(values: Any) -> tuple[float, float] | None:
    return None if values is None else (float(values[0]), float(values[1]))
