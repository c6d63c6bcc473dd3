"""The view Identify: a record that was uploaded, its columns, a model of it, and the file that `identify` writes."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactuator.api.model import identify
from tactuator.arrays import FloatArray
from tactuator.console.fields import Finite, Name
from tactuator.console.requests import Answer, View, command_line, digits
from tactuator.console.state import ConsoleState
from tactuator.errors import BadInput
from tactuator.identification.by_response import ResponseFit
from tactuator.identification.options import IdentifyOptions
from tactuator.identification.result import Identification
from tactuator.io.model import identified_text
from tactuator.io.record import measured_columns, measured_of
from tactuator.model.plant_model import PlantModel
from tactuator.plain import picked
from tactuator.signals.record import FrequencyResponse, Record
from tactuator.signals.spectra import power_spectrum

_SPECTRUM_LINES = 700
_LEAST = 1e-300


RateHz = Annotated[Finite, Field(gt=0.0)]


def look(
    state: ConsoleState,
    record: Name,
    input: Name | None = None,
    output: Name | None = None,
    time: Name | None = None,
    rate_hz: RateHz | None = None,
) -> Answer:
    """Return the columns of a record and which of them are taken for command and position; where they cannot be
    guessed, the reason instead of a guess.
    """
    path = state.uploads.path(record)
    read = measured_columns(path)
    columns: Answer = {"name": path.name, "columns": list(read.values), "said": None}
    try:
        measured = measured_of(path, read, input=input, output=output, time=time, rate_hz=rate_hz)
    except BadInput as error:
        return columns | {"said": state.uploads.plain(str(error))}
    if isinstance(measured, FrequencyResponse):
        return columns | {"points": measured.magnitude.size}
    if input is None and output is None:  # the page's fields show what is taken: nothing is to be said of it
        taken = str(measured.about["input"]), str(measured.about["output"])
        measured = measured_of(path, read, input=taken[0], output=taken[1], time=time, rate_hz=rate_hz)
        assert not isinstance(measured, FrequencyResponse)
    return columns | {
        "input": measured.about["input"],
        "output": measured.about["output"],
        "units": [measured.command_unit, measured.position_unit],
        "rate_hz": measured.rate_hz,
        "duration_s": measured.duration_s,
        "remarks": list(measured.remarks),
    }


def model(
    state: ConsoleState,
    record: Name,
    input: Name | None = None,
    output: Name | None = None,
    time: Name | None = None,
    rate_hz: RateHz | None = None,
    order: int | None = IdentifyOptions.order,
    zeros: int | None = IdentifyOptions.zeros,
    hold: Name = IdentifyOptions.hold,
    validate_on: Annotated[tuple[Name, ...], Field(max_length=8)] = (),
) -> Answer:
    """Return the model of a record, its curves and tables, its test on other records, the text of model.json, and the
    command that does the same.
    """
    path, unseen = state.uploads.path(record), [state.uploads.path(key) for key in validate_on]
    names: dict[str, Any] = {"input": input, "output": output, "time": time, "rate_hz": rate_hz}
    measured = measured_of(path, measured_columns(path), **names)
    options: dict[str, Any] = {"rate_hz": rate_hz, "order": order, "zeros": zeros, "hold": hold}
    fit = identify(measured, input, output, time=time, validate=unseen, **options)
    table, trust = fit.tables()
    command = command_line(
        "identify",
        path.name,
        input=input,
        output=output,
        time=time,
        **options | {"hold": None if hold == IdentifyOptions.hold else hold},
        validate=[other.name for other in unseen],
        out="model.json",
    )
    return {
        "rows": [[state.uploads.plain(cell) for cell in (*row, "")[:3]] for row in table.rows],
        "trust": [[state.uploads.plain(cell) for cell in row] for row in trust.rows],
        "trusted": not fit.distrust,
        "distrust": list(fit.distrust),
        "remarks": list(fit.remarks),
        "order": fit.order,
        "zeros": fit.model.num.size - 1,
        "text": identified_text(fit.model),
        "command": command,
        **_told(fit, measured),
    }


VIEW = View("identify", "Identify", {"look": look, "model": model})


def _told(fit: Identification | ResponseFit, measured: Record | FrequencyResponse) -> Answer:
    if isinstance(measured, FrequencyResponse):
        assert isinstance(fit, ResponseFit)
        return _of_response(fit, measured)
    assert isinstance(fit, Identification)
    return _of_record(fit, measured)


def _of_response(fit: ResponseFit, response: FrequencyResponse) -> Answer:
    points = _points(fit, response.frequency_hz, response.value())
    if response.phase_rad is None:
        points["phase_deg"] = []
    departure = 20.0 * np.log10(response.magnitude / np.abs(fit.model.response(response.frequency_hz)))
    return {
        "hold": "",
        "tried": [],
        "response": _curves(fit) | {"own": points},
        "departure": {"frequency_hz": points["frequency_hz"], "db": digits(departure)},
    }


def _of_record(fit: Identification, record: Record) -> Answer:
    """Return the curves of a model of a record, what it leaves of the position, and what else was tried."""
    measured, (low, high) = fit.distortion or fit.empirical.trusted(), fit.model.band_hz
    inside = (measured.frequency_hz >= low) & (measured.frequency_hz <= high)
    every = max(1, -(-int(inside.sum()) // _SPECTRUM_LINES))
    points = _points(fit, measured.frequency_hz[inside][::every], measured.value[inside][::every])
    rate_hz = record.rate_hz
    resolution = max(1.0, 8.0 * rate_hz / fit.measured.size, rate_hz / (2.0 * _SPECTRUM_LINES))
    position = power_spectrum(fit.measured, rate_hz, resolution)
    residual = power_spectrum(fit.measured - fit.simulated, rate_hz, resolution)
    return {
        "hold": fit.between.hold,
        "tried": [_candidate(fit, candidate) for candidate in fit.tried],
        "response": _curves(fit) | {"own": points},
        "residual": {
            "frequency_hz": digits(position.frequency_hz[1:]),
            "position_db": digits(10.0 * np.log10(position.density[1:] + _LEAST)),
            "residual_db": digits(10.0 * np.log10(residual.density[1:] + _LEAST)),
            "white": fit.tests.white,
            "free": fit.tests.uncorrelated_with_input,
        },
    }


def _curves(fit: Identification | ResponseFit) -> Answer:
    return {name: digits(values) for name, values in fit.columns().items()} | {"valid_hz": fit.model.valid_hz}


def _points(fit: Identification | ResponseFit, at_hz: FloatArray, value: NDArray[np.complex128]) -> dict[str, Any]:
    """Return measured points, their phase by the turn that lies nearest to the model's curve."""
    model: PlantModel = fit.model
    curve_hz = fit.frequency_hz()
    near = np.interp(np.log(at_hz), np.log(curve_hz), np.unwrap(np.angle(model.response(curve_hz))))
    return {
        "frequency_hz": digits(at_hz),
        "magnitude_db": digits(20.0 * np.log10(np.abs(value) + _LEAST)),
        "phase_deg": digits(np.degrees(near + np.angle(value * np.exp(-1j * near)))),
    }


def _candidate(fit: Identification, candidate: Any) -> Answer:
    taken = (fit.order, fit.model.num.size - 1, fit.between.hold, fit.model.delay_s > 0.0)
    form, number = picked(candidate, "poles", "zeros", "hold", "dead_time"), picked(candidate, "cost", "behind")
    shown = {name: f"{value:.3g}" if np.isfinite(value) else "—" for name, value in number.items()}
    return {**form, "taken": tuple(form.values()) == taken, **shown}
