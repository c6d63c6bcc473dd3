"""The view Identify: a record that was dropped, its columns, a model of it, and the file that `identify` writes."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactuator.arrays import FloatArray
from tactuator.console.requests import Answer, Finite, Name, ViewRequest, digits
from tactuator.console.state import ConsoleState
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


@dataclass(frozen=True)
class _OfRecord(ViewRequest):
    record: Name
    input: Name | None = None
    output: Name | None = None
    rate_hz: Annotated[Finite, Field(gt=0.0)] | None = None

    def read(self, path: Path) -> Record:
        """Return the record of a file, by the columns that were chosen or, without a choice, the usual ones."""
        return read_record(path, input_name=self.input, output_name=self.output, rate_hz=self.rate_hz)


@dataclass(frozen=True)
class IdentifyLook(_OfRecord):
    """Request for the columns of a record, and which of them are taken for command and position."""

    def answer(self, state: ConsoleState) -> Answer:
        """Return the columns; where they cannot be guessed, the reason instead of a guess."""
        path = state.uploads.path(self.record)
        if is_response(path):
            names = list(read_columns(path).values)
            points = read_foreign_response(path).magnitude.size
            return {"name": path.name, "columns": names, "said": None, "points": points}
        columns = list(read_columns(path).values)
        columns_only: Answer = {"name": path.name, "columns": columns, "said": None}
        try:
            record = self.read(path)
        except BadInput as error:
            return columns_only | {"said": str(error)}
        return columns_only | {
            "input": record.about["input"],
            "output": record.about["output"],
            "units": [record.command_unit, record.position_unit],
            "rate_hz": record.rate_hz,
            "duration_s": record.duration_s,
            "remarks": list(record.remarks),
        }


@dataclass(frozen=True)
class IdentifyModel(_OfRecord):
    """Request for the model of a record, and how it stands on others that its fit does not see."""

    order: int | None = Asked.order
    zeros: int | None = Asked.zeros
    hold: Name = Asked.hold
    validate_on: Annotated[tuple[Name, ...], Field(max_length=8)] = ()

    def answer(self, state: ConsoleState) -> Answer:
        """Return the model, its curves and tables, the text of model.json, and the command that does the same."""
        path = state.uploads.path(self.record)
        wishes: dict[str, Any] = {"order": self.order, "zeros": self.zeros, "hold": self.hold}
        if is_response(path):
            return self._of_response(path, Asked(**wishes))
        unseen = [state.uploads.path(key) for key in self.validate_on]
        record = self.read(path)
        fit = identify(record, **wishes)
        fit = validated(fit, [(other.name, self.read(other)) for other in unseen])
        return {
            "rows": [list(row) for row in identification_rows(fit, record.about)],
            **_trust(fit, fit.model),
            "order": fit.order,
            "hold": fit.between.hold,
            "response": _response(fit),
            "residual": _residual(fit, record.rate_hz),
            "tried": [_candidate(fit, candidate) for candidate in fit.tried],
            "command": self.command(path, unseen),
        }

    def _of_response(self, path: Path, asked: Asked) -> Answer:
        """Return the model of a frequency response, and how far it departs from each point."""
        if self.validate_on:
            raise BadInput("a frequency response beside other files", "one response by itself")
        response = read_foreign_response(path)
        fit = identify_response(response, asked)
        model = fit.model
        curve_hz = np.geomspace(*model.band_hz, _MOST_LINES)
        phase = np.degrees(_near(model, curve_hz, response.frequency_hz, response.value()))
        points = {
            "frequency_hz": digits(response.frequency_hz),
            "magnitude_db": digits(20.0 * np.log10(response.magnitude)),
            "phase_deg": [] if response.phase_rad is None else digits(phase),
        }
        departure = 20.0 * np.log10(response.magnitude / np.abs(model.response(response.frequency_hz)))
        return {
            "rows": [[*row, ""] for row in response_rows(fit)],
            **_trust(fit, model),
            "order": fit.order,
            "hold": "",
            "response": _curves(model, curve_hz) | {"own": points},
            "departure": {"frequency_hz": points["frequency_hz"], "db": digits(departure)},
            "tried": [],
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
            "--hold": None if self.hold == Asked.hold else self.hold,
        }
        words = ["tactuator", "identify", path.name]
        words += [part for name, value in given.items() if value is not None for part in (name, str(value))]
        words += [part for other in unseen for part in ("--validate", other.name)]
        return shlex.join([*words, "--out", "model.json"])


REQUESTS = {"identify.look": IdentifyLook, "identify.model": IdentifyModel}


def _trust(fit: Any, model: PlantModel) -> Answer:
    """Return what a reader has to know of any fit, and the text of its model's file."""
    return {
        "trusted": not fit.distrust,
        "distrust": list(fit.distrust),
        "remarks": list(fit.remarks),
        "zeros": model.num.size - 1,
        "text": identified_text(model),
    }


def _response(fit: Identification) -> Answer:
    curve_hz = fit.frequency_hz(_MOST_LINES)
    measured = fit.distortion or fit.empirical.trusted()
    inside = (measured.frequency_hz >= curve_hz[0]) & (measured.frequency_hz <= curve_hz[-1])
    every = max(1, -(-int(inside.sum()) // _SPECTRUM_LINES))
    points_hz, points = measured.frequency_hz[inside][::every], measured.value[inside][::every]
    return _curves(fit.model, curve_hz) | {
        "own": {
            "frequency_hz": digits(points_hz),
            "magnitude_db": digits(20.0 * np.log10(np.abs(points) + _LEAST)),
            "phase_deg": digits(np.degrees(_near(fit.model, curve_hz, points_hz, points))),
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
        "frequency_hz": digits(frequency_hz),
        "magnitude_db": digits(20.0 * np.log10(np.abs(value))),
        "phase_deg": digits(np.degrees(np.unwrap(np.angle(value)))),
        "band_db": digits(model.band_db(frequency_hz)),
        "band_deg": digits(np.degrees(model.band_rad(frequency_hz))),
        "valid_hz": model.valid_hz,
    }


def _residual(fit: Identification, rate_hz: float) -> Answer:
    resolution = max(1.0, 8.0 * rate_hz / fit.measured.size, rate_hz / (2.0 * _SPECTRUM_LINES))
    measured = power_spectrum(fit.measured, rate_hz, resolution)
    residual = power_spectrum(fit.measured - fit.simulated, rate_hz, resolution)
    return {
        "frequency_hz": digits(measured.frequency_hz[1:]),
        "position_db": digits(10.0 * np.log10(measured.density[1:] + _LEAST)),
        "residual_db": digits(10.0 * np.log10(residual.density[1:] + _LEAST)),
        "white": fit.tests.white,
        "free": fit.tests.uncorrelated_with_input,
    }


def _candidate(fit: Identification, candidate: Any) -> Answer:
    taken = (fit.order, fit.model.num.size - 1, fit.between.hold, fit.model.delay_s > 0.0)
    number = {name: getattr(candidate, name) for name in ("cost", "uncorrelated_p", "behind")}
    return {
        "poles": candidate.poles,
        "zeros": candidate.zeros,
        "dead_time": candidate.dead_time,
        "hold": candidate.hold,
        "taken": (candidate.poles, candidate.zeros, candidate.hold, candidate.dead_time) == taken,
    } | {name: f"{value:.3g}" if np.isfinite(value) else "—" for name, value in number.items()}
