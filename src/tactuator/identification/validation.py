"""A model on a record that its fit never saw: fit, residual, and how much of that record's response is in the band."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.identification.by_spectrum import residual_tests
from tactuator.identification.hold import HOLDS, Hold
from tactuator.identification.likelihood import SpectralFit, SpectralProblem
from tactuator.identification.lines import LocalResponse, Spectrum, equations, local_response, spectrum, weights
from tactuator.identification.loops import dahl_state
from tactuator.identification.motor import motor_estimate, motor_prediction
from tactuator.identification.prepared import Samples, check_record
from tactuator.identification.residual import Residual, line_residual
from tactuator.identification.residual_tests import ResidualTests
from tactuator.identification.result import Identification, Validation
from tactuator.identification.uncertainty import fit_of_model, response_of_rows
from tactuator.model.plant_model import PlantModel
from tactuator.signals.record import Record

_LEAST_SHARE = 0.8
_FEWEST = 10
"""Points of the record's own response below which their share in the band is not judged."""
_SHARP = 0.12
"""Relative error of such a point, 1 dB, beyond which it says nothing."""
_CHANCE = 1e-3
_BEYOND = 4.0
"""Power that follows the command, over what the band allows, from which on a model fails."""
_SILENT = 1e-5
_SHORT = 1e-3
"""Presliding distance, of the size of the motion, where the model cannot tell its own."""


def validated(found: Identification, records: Sequence[tuple[str, Record]]) -> Identification:
    """Return the identification with its standing on each named record; what fails speaks against trusting it."""
    with threadpool_limits(limits=1):
        made = tuple(validate(found, record, name) for name, record in records)
    reasons = (*found.distrust, *(reason for one in made for reason in one.failures))
    remarks = (*found.remarks, *(remark for one in made for remark in one.remarks))
    return replace(found, validations=made, distrust=reasons, remarks=remarks)


@np.errstate(all="ignore")
def validate(found: Identification, record: Record, name: str = "") -> Validation:
    """Return how the model that was found stands on a record of the same mechanism. Raises BadInput where the record
    cannot be used, or is in other units.
    """
    model, called = found.model, name or record.about.get("file", "the other record")
    units = (record.command_unit, record.position_unit)
    if units != (model.command_unit, model.position_unit):
        own = _units(model.command_unit, model.position_unit)
        raise BadInput(f"{called} is in {_units(*units)}, the model in {own}", "the same units")
    remarks = (*record.remarks, *check_record(record))
    if model.method == "inverse dynamics":
        return _validate_motor(found, record, called, remarks)
    hold = _hold(found, record)
    scale = (float(np.std(record.command)), float(np.std(record.position)))
    fit = fit_of_model(model, record.rate_hz, hold, scale[1] / scale[0])
    command = (record.command - record.command.mean()) / scale[0]
    samples = Samples(command, (record.position - record.position.mean()) / scale[1], record.rate_hz)
    taken, left = _left(fit, samples)
    if model.friction:
        for path in ("measured", "simulated"):
            along = (samples.position if path == "measured" else left.simulated) * scale[1]
            pull = dahl_state(np.ascontiguousarray(along), model.friction.get("presliding", _SHORT * scale[1]))
            rest = samples.command.size - pull.size
            pulled = np.concatenate([pull, np.full(rest, pull[-1])]) * model.friction["coulomb"] / scale[0]
            moving = replace(samples, command=command - pulled)
            taken, left = _left(fit, moving)
        samples = moving
    return _judged(found, called, fit, samples, taken, left, remarks)


def _units(command: str, position: str) -> str:
    return f"{command or 'no unit'} and {position or 'no unit'}"


def _hold(found: Identification, record: Record) -> Hold:
    said = record.about.get("hold", found.between.hold)
    return next((hold for hold in HOLDS if hold == said), "zero-order")


def _left(fit: SpectralFit, samples: Samples) -> tuple[Spectrum, Residual]:
    """Return the record's lines and what the fit leaves of them, weighted by its own spectrum."""
    shift = min(max(int(fit.delay_s * samples.rate_hz + 1e-3) - 1, 0), samples.command.size // 4)
    taken = spectrum(samples.command, samples.position, samples.rate_hz, shift)
    given = equations(taken, 0.0, 0.5 * samples.rate_hz)
    grid = replace(fit.grid, frequency_hz=given.frequency_hz, shift=shift)
    highest = 0.47 * samples.rate_hz
    problem = SpectralProblem(given, np.where(given.of_hz <= highest, 1.0, 0.0), grid)
    problem = problem.with_weight(weights(given, problem.residual(fit), highest))
    return taken, line_residual(fit, given, problem.weight, taken)


def _judged(
    found: Identification,
    name: str,
    fit: SpectralFit,
    samples: Samples,
    taken: Spectrum,
    left: Residual,
    remarks: tuple[str, ...],
) -> Validation:
    tests = residual_tests(samples, left, fit, taken, fitted=False)
    residual = float(np.mean((left.measured - left.simulated) ** 2))
    percent = 100.0 * (1.0 - float(np.sqrt(residual / np.mean(left.measured**2))))
    whole = spectrum(samples.command, samples.position, samples.rate_hz)
    share, points = _share_inside(found.model, fit, local_response(whole, 0.45 * samples.rate_hz))
    hertz = taken.frequency_hz[1:]
    moved = np.abs(response_of_rows(fit, hertz) * taken.command[1:]) ** 2
    band = found.model.band_db(hertz) / 8.685890 / 1.959964
    allowed = 2.0 * float(np.sum(moved * band**2)) * 2.0 / taken.samples
    following = tests.unexplained * residual
    failures, remarks_ = [], list(remarks)
    if points < _FEWEST:
        remarks_.append(f"{name} shows its response at {points} points alone: the share in the band is not judged")
    elif share < _LEAST_SHARE:
        failures.append(
            f"on {name} {100.0 * share:.0f} % of the record's own response lie inside the band (95 % should, "
            f"{100.0 * _LEAST_SHARE:.0f} % must)"
        )
    if tests.uncorrelated_p < _CHANCE and following > _BEYOND * allowed and following > 1e-6:
        failures.append(
            f"on {name} {100.0 * tests.unexplained:.2g} % of what the model leaves follow the command, "
            f"{following / max(allowed, 1e-300):.2g} times the power that the band allows"
        )
    if not percent > 0.0:
        failures.append(f"on {name} the model explains nothing of the position")
    return Validation(name, percent, tests, share, points, tuple(failures), tuple(remarks_))


def _share_inside(model: PlantModel, fit: SpectralFit, local: LocalResponse) -> tuple[float, int]:
    """Return the share of the record's own points, magnitude and phase, within the band and their own error."""
    low, high = model.valid_hz or model.band_hz
    size, noise = np.abs(local.value), local.noise
    fed_back = np.minimum((noise / np.maximum(local.excitation * size, 1e-300)) ** 2, size**2)
    own = np.sqrt(0.5 * (local.variance + fed_back)) / size
    keep = (local.frequency_hz >= low) & (local.frequency_hz <= high) & (own < _SHARP)
    keep &= local.excitation > _SILENT * float(np.max(local.excitation, initial=0.0))
    if not np.any(keep):
        return float("nan"), 0
    hertz = local.frequency_hz[keep]
    off = _logarithm(local.value[keep] / response_of_rows(fit, hertz))
    band = (model.band_db(hertz) / 8.685890, model.band_rad(hertz))
    reach = [np.hypot(one, 1.959964 * own[keep]) for one in band]
    inside = np.concatenate([np.abs(off.real) <= reach[0], np.abs(off.imag) <= reach[1]])
    return float(np.mean(inside)), int(inside.size)


def _logarithm(ratio: ComplexArray) -> ComplexArray:
    return np.asarray(np.log(np.abs(ratio)) + 1j * np.angle(ratio))


def _validate_motor(found: Identification, record: Record, name: str, remarks: tuple[str, ...]) -> Validation:
    model, friction = found.model, found.friction
    assert friction is not None
    assert model.valid_hz is not None
    is_held = _hold(found, record) != "band-limited"
    theta = np.array([model.num[0], model.den[1], friction.coulomb, friction.offset])
    wanted, predicted = motor_prediction(
        record.command, record.position, record.rate_hz, theta, model.valid_hz[1], is_held=is_held
    )
    if wanted.size < _FEWEST:
        raise BadInput(f"in {name} the motor hardly moves", "a record with motion of its own")
    left = wanted - predicted
    spread = float(np.sum((wanted - wanted.mean()) ** 2))
    unexplained = float(left @ left) / max(spread, 1e-300)
    tests = ResidualTests(float("nan"), float("nan"), unexplained, feedback=None)
    failures, said, inside, points = [], list(remarks), float("nan"), 0
    again = motor_estimate(record.command, record.position, record.rate_hz, is_held=is_held)
    if again is None:
        said.append(f"{name} alone does not tell the motor's parameters: they are not compared")
    else:
        agree = _agreement(model, theta, friction.confidence, friction.offset_confidence, again.covariance, again)
        inside, points = float(np.mean(agree)), agree.size
        if inside < 0.5:
            failures.append(f"on {name} {int(np.sum(~agree))} of the motor's four parameters lie outside their bands")
    if unexplained > 0.1:
        failures.append(f"on {name} {100.0 * unexplained:.2g} % of the command's power stay unexplained")
    return Validation(name, 100.0 * (1.0 - unexplained**0.5), tests, inside, points, tuple(failures), tuple(said))


def _agreement(
    model: PlantModel, theta: FloatArray, coulomb: float, offset: float, covariance: FloatArray, again: object
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return for each of the four parameters whether the two records' values agree within both confidences."""
    names = ("gain", "damping", "coulomb", "offset")
    other = np.array([getattr(again, name) for name in names])
    own = np.append(1.959964 * np.sqrt(np.diag(model.covariance)[:2]), [coulomb, offset])
    reach = np.hypot(own, 1.959964 * np.sqrt(np.diag(covariance)))
    return np.asarray(np.abs(other - theta) <= reach)
