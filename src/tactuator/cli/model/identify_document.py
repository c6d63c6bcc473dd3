"""The JSON that `tactuator identify` prints."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactuator.identification.by_response import ResponseFit
from tactuator.identification.evidence.distortion import Distortion
from tactuator.identification.fixed.standing import FixedAgainstOwn
from tactuator.identification.result import Identification, Validation, resonances
from tactuator.model.plant_model import PlantModel

DELAY_SAYS = (
    "delay_s is everything between the command and the position as recorded, the laboratory's converters and filters "
    "included; the display's delay_samples is its own computing delay and comes on top"
)


def document(found: Identification) -> dict[str, Any]:
    """Return the answer that `--json` prints."""
    model, excitation, tests = found.model, found.excitation, found.tests
    return _of_model(model) | {
        "poles_hz": found.poles_hz,
        "hold": {
            "taken": found.between.hold,
            "source": found.between.source,
            "certain": found.between.certain,
            "advantage": found.between.advantage,
            "other": None if found.other is None else _coefficients(found.other),
        },
        "trusted": not found.distrust,
        "distrust": list(found.distrust),
        "frf": _response(model, found.frequency_hz()),
        "order": found.order,
        "excitation": {
            "order": excitation.order,
            "needed": excitation.needed,
            "condition": excitation.condition,
            "band_hz": [excitation.low_hz, excitation.high_hz],
            "sufficient": excitation.sufficient,
        },
        "residuals": {
            "white": tests.white,
            "white_p": tests.white_p,
            "uncorrelated_with_input": tests.uncorrelated_with_input,
            "uncorrelated_p": tests.uncorrelated_p,
            "unexplained": tests.unexplained,
            "closed_loop": tests.feedback,
        },
        "fit_percent": found.fit_percent,
        "validation": [_validation(one) for one in found.validations],
        "friction": _friction(found),
        "distortion": None if found.distortion is None else _distortion(found.distortion),
        "tried": [vars(candidate) for candidate in found.tried],
        "remarks": list(found.remarks),
        "fixed": [_fixed(one) for one in found.fixed],
    }


def _fixed(one: FixedAgainstOwn) -> dict[str, Any]:
    """Return a value that was fixed, beside what the record shows without it (null: it shows no such thing)."""
    value, confidence = one.own or (None, None)
    q = {"q": one.fixed.q} if one.fixed.q else {}
    return {"name": one.fixed.name, "value": one.fixed.value} | q | {"own": value, "own_confidence": confidence}


def _distortion(seen: Distortion) -> dict[str, Any]:
    with np.errstate(divide="ignore"):
        levels = {
            f"{name}_db": 20.0 * np.log10(getattr(seen, name))
            for name in ("noise", "total", "distortion", "even", "odd")
        }
    return (
        {"frequency_hz": seen.frequency_hz, "response_db": 20.0 * np.log10(np.abs(seen.value))}
        | levels
        | {"realisations": seen.realisations}
    )


def _validation(one: Validation) -> dict[str, Any]:
    return {
        "record": one.name,
        "holds": not one.failures,
        "failures": list(one.failures),
        "fit_percent": one.fit_percent,
        "inside_band": one.inside,
        "points": one.points,
        "residuals": {
            "white_p": one.tests.white_p,
            "uncorrelated_p": one.tests.uncorrelated_p,
            "unexplained": one.tests.unexplained,
        },
    }


def response_document(found: ResponseFit) -> dict[str, Any]:
    """Return the answer for a model of a frequency response."""
    frequency = np.geomspace(*found.model.band_hz, 500)
    return _of_model(found.model) | {
        "poles_hz": np.sort(np.abs(np.roots(found.model.den))) / (2.0 * np.pi),
        "order": found.order,
        "departure": found.departure,
        "largest_db": found.largest_db,
        "trusted": not found.distrust,
        "distrust": list(found.distrust),
        "frf": _response(found.model, frequency),
        "remarks": list(found.remarks),
        "fixed": [_fixed(one) for one in found.fixed],
    }


def _of_model(model: PlantModel) -> dict[str, Any]:
    confidence = model.confidence()
    n, m = model.den.size - 1, model.num.size - 1
    return {
        "model": _coefficients(model),
        "damping": [vars(one) for one in resonances(model.den)],
        "confidence": {
            "gain": confidence["gain"],
            "num": [confidence[f"num_s{m - k}"] for k in range(m + 1)],
            "den": [0.0, *(confidence[f"den_s{n - 1 - k}"] for k in range(n))],
            "delay_s": confidence["delay_s"],
        },
        "zeros": m,
        "method": model.method,
        "valid_hz": model.valid_hz,
        "delay": DELAY_SAYS,
        "units": {"command": model.command_unit, "position": model.position_unit},
    }


def _response(model: PlantModel, frequency: Any) -> dict[str, Any]:
    return {
        "frequency_hz": frequency,
        "magnitude_db": 20.0 * np.log10(np.abs(model.response(frequency))),
        "phase_deg": np.degrees(np.unwrap(np.angle(model.response(frequency)))),
        "band_db": model.band_db(frequency),
        "band_deg": np.degrees(model.band_rad(frequency)),
    }


def _friction(found: Identification) -> dict[str, Any]:
    friction = found.friction
    if friction is None:
        return {"coulomb": 0.0, "confidence": None, "presliding": None, "offset": None, "command_for_1_db": None}
    return {
        "coulomb": friction.coulomb,
        "confidence": friction.confidence,
        "presliding": friction.presliding,
        "offset": friction.offset,
        "offset_confidence": friction.offset_confidence,
        "command_for_1_db": friction.small_command,
    }


def _coefficients(model: PlantModel) -> dict[str, Any]:
    return {"num": model.num, "den": model.den, "delay_s": model.delay_s}
