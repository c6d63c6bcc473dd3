"""A model on a record that its fit never saw: fit, residual, and how much of that record's response is in the band."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.identification.check import check_record
from tactuator.identification.data import spectra_read_late
from tactuator.identification.friction import dahl_state
from tactuator.identification.hold import HOLDS, Hold
from tactuator.identification.likelihood import SpectralFit
from tactuator.identification.lines import HIGHEST, LocalResponse, local_response, spectrum
from tactuator.identification.options import solvable
from tactuator.identification.residual import (
    Residual,
    check_record_residual,
    fit_percent,
    residuals_of_model,
)
from tactuator.identification.residual_tests import CHANCE, ResidualTests
from tactuator.identification.result import Identification, Validation
from tactuator.identification.trust import UNSEEN_EXPLAINED, UNSEEN_FOLLOWING, UNSEEN_INSIDE
from tactuator.identification.uncertainty import fit_of_model, response_of_rows
from tactuator.model.plant_model import DB, Z95, PlantModel
from tactuator.processors import single_threaded
from tactuator.signals.record import Record

_FEWEST = 10
"""Points of the record's own response below which their share in the band is not judged."""
_SHARP = 0.12
"""Relative error of such a point, 1 dB, beyond which it says nothing."""
_TRIFLE, _SILENT = 1e-6, 1e-5
"""Share of the position's power below which nothing follows the command; power of the command's lines, over the
strongest, below which they show nothing (50 dB)."""
_SHORT = 1e-3
"""Presliding distance, of the size of the motion, where the model does not give one."""


def validated(result: Identification, records: Sequence[tuple[str, Record]]) -> Identification:
    """Return the identification with its standing on each named record; what fails speaks against trusting it."""
    with single_threaded(scipys=False), solvable():
        validations = tuple(validate(result, record, name) for name, record in records)
    rows = (row for validation in validations for row in validation.checks)
    remarks = (*result.remarks, *(remark for validation in validations for remark in validation.remarks))
    return replace(result, model=result.model.with_checks(*rows), validations=validations, remarks=remarks)


@np.errstate(all="ignore")
def validate(result: Identification, record: Record, name: str = "") -> Validation:
    """Return the test of the model on another record of the same mechanism. Raises BadInput where the record
    cannot be used, or is in other units.
    """
    model, called = result.model, (name or record.about.get("file", "the other record")).rpartition("/")[2]
    units = (record.command_unit, record.position_unit)
    if units != (model.command_unit, model.position_unit):
        units_of_model = _units(model.command_unit, model.position_unit)
        raise BadInput(f"{called} is in {_units(*units)}, the model in {units_of_model}", "the same units")
    check_record(record)
    scale = (float(np.std(record.command)), float(np.std(record.position)))
    fit = fit_of_model(model, record.rate_hz, _hold(result, record), scale[1] / scale[0])
    command, position = (record.command - record.command.mean()) / scale[0], record.position / scale[1]
    position = position - position.mean()

    def left_of(moving: FloatArray) -> Residual:
        spectra = spectra_read_late([(moving, position)], record.rate_hz, fit.delay_s)
        return residuals_of_model(fit, spectra, HIGHEST * record.rate_hz)[0]

    moving, residual, path = command, left_of(command), position
    for _ in range(2 if model.friction else 0):
        pull = dahl_state(path * scale[1], model.friction.get("presliding", _SHORT * scale[1]))
        pulled = np.concatenate([pull, np.full(command.size - pull.size, pull[-1])])
        moving = command - pulled * model.friction["coulomb"] / scale[0]
        residual = left_of(moving)
        path = residual.simulated
    local = local_response(spectrum(moving, position, record.rate_hz), 0.45 * record.rate_hz)
    return _judged(
        result, called, fit, check_record_residual(moving, residual, fit, fitted=False), residual, local, record.remarks
    )


def _units(command: str, position: str) -> str:
    return f"{command or 'no unit'} and {position or 'no unit'}"


def _hold(result: Identification, record: Record) -> Hold:
    said = record.about.get("hold", result.between.hold)
    return next((hold for hold in HOLDS if hold == said), "zero-order")


def _judged(
    result: Identification,
    name: str,
    fit: SpectralFit,
    tests: ResidualTests,
    line_residual: Residual,
    local: LocalResponse,
    remarks: tuple[str, ...],
) -> Validation:
    taken, percent = line_residual.taken, fit_percent(line_residual.taken.measured, line_residual.simulated)
    residual = float(np.mean((line_residual.taken.measured - line_residual.simulated) ** 2))
    share, points = _share_inside(result.model, fit, local)
    hertz = taken.frequency_hz[1:]
    moved = np.abs(response_of_rows(fit, hertz) * taken.command[1:]) ** 2
    band = result.model.band_db(hertz) / DB / Z95
    allowed = 2.0 * float(np.sum(moved * band**2)) * 2.0 / taken.samples
    following = tests.unexplained * residual
    is_certain = tests.uncorrelated_p < CHANCE and following > _TRIFLE
    rows = [
        UNSEEN_EXPLAINED.of(percent, name),
        UNSEEN_FOLLOWING.of(following / max(allowed, 1e-300) if is_certain else 0.0, name),
        *([] if points < _FEWEST else [UNSEEN_INSIDE.of(100.0 * share, name)]),
    ]
    return Validation(name, percent, tests, share, points, tuple(rows), remarks)


def _share_inside(model: PlantModel, fit: SpectralFit, local: LocalResponse) -> tuple[float, int]:
    """Return the share of the record's own points, magnitude and phase, within the band and their own error."""
    low, high = model.valid_hz or model.band_hz
    size, noise = np.abs(local.value), local.noise
    fed_back = np.minimum((noise / np.maximum(local.excitation * size, 1e-300)) ** 2, size**2)
    error = np.sqrt(0.5 * (local.variance + fed_back)) / size
    keep = (local.frequency_hz >= low) & (local.frequency_hz <= high) & (error < _SHARP)
    keep &= local.excitation > _SILENT * float(np.max(local.excitation, initial=0.0))
    if not np.any(keep):
        return float("nan"), 0
    hertz = local.frequency_hz[keep]
    off = np.log(local.value[keep] / response_of_rows(fit, hertz))
    band = (model.band_db(hertz) / DB, model.band_rad(hertz))
    reach = [np.hypot(half_width, Z95 * error[keep]) for half_width in band]
    inside = np.concatenate([np.abs(off.real) <= reach[0], np.abs(off.imag) <= reach[1]])
    return float(np.mean(inside)), int(inside.size)
