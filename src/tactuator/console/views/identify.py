"""The view Identify: a record that was dropped, its columns, a model of it, and the file that `identify` writes."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactuator.arrays import FloatArray
from tactuator.console.asked import Answer, Finite, Name, ViewRequest
from tactuator.console.workshop import Workshop
from tactuator.errors import BadInput
from tactuator.identification.asked import Asked
from tactuator.identification.by_response import identify_response
from tactuator.identification.identify import identify
from tactuator.identification.result import Identification
from tactuator.identification.validation import validated
from tactuator.io.columns import read_columns
from tactuator.io.model import identified_text
from tactuator.io.record import is_response, read_foreign_response, read_record
from tactuator.model.plant_model import PlantModel
from tactuator.report.tables import identification_rows, response_rows
from tactuator.signals.record import Record
from tactuator.signals.spectra import power_spectrum

_MOST_LINES, _SPECTRUM_LINES = 400, 700
_LEAST = 1e-300


class _OfRecord(ViewRequest):
    record: Name
    input: Name | None = None
    output: Name | None = None
    rate_hz: Annotated[Finite, Field(gt=0.0)] | None = None

    def read(self, path: Path) -> Record:
        """Return the record of a file, by the columns that were chosen or, without a choice, the usual ones."""
        return read_record(path, input_name=self.input, output_name=self.output, rate_hz=self.rate_hz)


class IdentifyLook(_OfRecord):
    """Request for the columns of a record, and which of them are taken for command and position."""

    do: Literal["identify.look"]

    def answer(self, workshop: Workshop) -> Answer:
        """Return the columns; where they cannot be guessed, the reason instead of a guess."""
        path = workshop.drawer.path(self.record)
        if is_response(path):
            names = list(read_columns(path).values)
            points = read_foreign_response(path).magnitude.size
            return {"name": path.name, "columns": names, "said": None, "points": points}
        columns = list(read_columns(path).values)
        told: Answer = {"name": path.name, "columns": columns, "said": None}
        try:
            record = self.read(path)
        except BadInput as error:
            return told | {"said": str(error)}
        return told | {
            "input": record.about["input"],
            "output": record.about["output"],
            "units": [record.command_unit, record.position_unit],
            "rate_hz": record.rate_hz,
            "duration_s": record.duration_s,
            "remarks": list(record.remarks),
        }


class IdentifyModel(_OfRecord):
    """Request for the model of a record, and how it stands on others that its fit does not see."""

    do: Literal["identify.model"]
    order: Annotated[int, Field(ge=1, le=8)] | None = None
    zeros: Annotated[int, Field(ge=0, le=8)] | None = None
    hold: Literal["auto", "zero-order", "first-order", "band-limited"] = "auto"
    validate_on: Annotated[tuple[Name, ...], Field(max_length=8)] = ()

    def answer(self, workshop: Workshop) -> Answer:
        """Return the model, its curves and tables, the text of model.json, and the command that does the same."""
        path = workshop.drawer.path(self.record)
        if is_response(path):
            return self._of_response(path)
        unseen = [workshop.drawer.path(key) for key in self.validate_on]
        record = self.read(path)
        found = identify(record, **vars(Asked(order=self.order, zeros=self.zeros, hold=self.hold)))
        found = validated(found, [(one.name, self.read(one)) for one in unseen])
        return {
            "rows": [list(row) for row in identification_rows(found, record.about)],
            "trusted": not found.distrust,
            "distrust": list(found.distrust),
            "remarks": list(found.remarks),
            "order": found.order,
            "zeros": found.model.num.size - 1,
            "hold": found.between.hold,
            "response": _response(found),
            "residual": _residual(found, record.rate_hz),
            "tried": [_candidate(found, one) for one in found.tried],
            "text": identified_text(found.model),
            "command": self.command(path, unseen),
        }

    def _of_response(self, path: Path) -> Answer:
        """Return the model of a frequency response, and how far it departs from each point."""
        if self.validate_on:
            raise BadInput("a frequency response beside other files", "one response by itself")
        given = read_foreign_response(path)
        found = identify_response(given, Asked(order=self.order, zeros=self.zeros, hold=self.hold))
        model, value = found.model, given.value()
        curve_hz = np.geomspace(*model.band_hz, _MOST_LINES)
        phase = np.degrees(_near(model, curve_hz, given.frequency_hz, value))
        own = {
            "frequency_hz": _digits(given.frequency_hz),
            "magnitude_db": _digits(20.0 * np.log10(given.magnitude)),
            "phase_deg": [] if given.phase_rad is None else _digits(phase),
        }
        departure = 20.0 * np.log10(given.magnitude / np.abs(model.response(given.frequency_hz)))
        return {
            "rows": [[*row, ""] for row in response_rows(found)],
            "trusted": not found.distrust,
            "distrust": list(found.distrust),
            "remarks": list(found.remarks),
            "order": found.order,
            "zeros": model.num.size - 1,
            "hold": "",
            "response": _curves(model, curve_hz) | {"own": own},
            "departure": {"frequency_hz": own["frequency_hz"], "db": _digits(departure)},
            "tried": [],
            "text": identified_text(model),
            "command": self.command(path, []),
        }

    def command(self, path: Path, unseen: list[Path]) -> str:
        """Return the command line that writes the same model."""
        given: dict[str, Any] = {
            "--input": self.input,
            "--output": self.output,
            "--rate-hz": None if self.rate_hz is None else f"{self.rate_hz:g}",
            "--order": self.order,
            "--zeros": self.zeros,
            "--hold": None if self.hold == "auto" else self.hold,
        }
        words = ["tactuator", "identify", path.name]
        words += [part for name, value in given.items() if value is not None for part in (name, str(value))]
        words += [part for one in unseen for part in ("--validate", one.name)]
        return shlex.join([*words, "--out", "model.json"])


IdentifyRequest = IdentifyLook | IdentifyModel


def _response(found: Identification) -> Answer:
    frequency = found.frequency_hz(_MOST_LINES)
    model = found.model
    own = found.empirical.trusted()
    own_hz, points = own.frequency_hz, own.value
    if found.distortion is not None:
        own_hz, points = found.distortion.frequency_hz, found.distortion.value
    inside = (own_hz >= frequency[0]) & (own_hz <= frequency[-1])
    own_hz, points = own_hz[inside], points[inside]
    every = max(1, -(-own_hz.size // _SPECTRUM_LINES))
    turned = _near(model, frequency, own_hz[::every], points[::every])
    return _curves(model, frequency) | {
        "own": {
            "frequency_hz": _digits(own_hz[::every]),
            "magnitude_db": _digits(20.0 * np.log10(np.abs(points[::every]) + _LEAST)),
            "phase_deg": _digits(np.degrees(turned)),
        },
    }


def _near(model: PlantModel, curve_hz: FloatArray, at_hz: FloatArray, value: NDArray[np.complex128]) -> FloatArray:
    """Return the phase of points, radians, by the turn that lies nearest to the model's curve at curve_hz."""
    at = np.interp(np.log(at_hz), np.log(curve_hz), np.unwrap(np.angle(model.response(curve_hz))))
    return np.asarray(at + np.angle(value * np.exp(-1j * at)))


def _curves(model: PlantModel, frequency_hz: FloatArray) -> Answer:
    """Return magnitude and phase of a model over frequency, with their bands, and where it is valid."""
    value = model.response(frequency_hz)
    return {
        "frequency_hz": _digits(frequency_hz),
        "magnitude_db": _digits(20.0 * np.log10(np.abs(value))),
        "phase_deg": _digits(np.degrees(np.unwrap(np.angle(value)))),
        "band_db": _digits(model.band_db(frequency_hz)),
        "band_deg": _digits(np.degrees(model.band_rad(frequency_hz))),
        "valid_hz": model.valid_hz,
    }


def _residual(found: Identification, rate_hz: float) -> Answer:
    resolution = max(1.0, 8.0 * rate_hz / found.measured.size, rate_hz / (2.0 * _SPECTRUM_LINES))
    measured = power_spectrum(found.measured, rate_hz, resolution)
    left = power_spectrum(found.measured - found.simulated, rate_hz, resolution)
    return {
        "frequency_hz": _digits(measured.frequency_hz[1:]),
        "position_db": _digits(10.0 * np.log10(measured.density[1:] + _LEAST)),
        "residual_db": _digits(10.0 * np.log10(left.density[1:] + _LEAST)),
        "white": found.tests.white,
        "free": found.tests.uncorrelated_with_input,
    }


def _candidate(found: Identification, one: Any) -> Answer:
    taken = (found.order, found.model.num.size - 1, found.between.hold, found.model.delay_s > 0.0)
    number = {name: getattr(one, name) for name in ("cost", "uncorrelated_p", "behind")}
    return {
        "poles": one.poles,
        "zeros": one.zeros,
        "dead_time": one.dead_time,
        "hold": one.hold,
        "taken": (one.poles, one.zeros, one.hold, one.dead_time) == taken,
    } | {name: f"{value:.3g}" if np.isfinite(value) else "—" for name, value in number.items()}


def _digits(values: FloatArray) -> list[float]:
    """Return numbers to the six digits that a drawing needs."""
    return [float(f"{value:.6g}") for value in values.tolist()]
