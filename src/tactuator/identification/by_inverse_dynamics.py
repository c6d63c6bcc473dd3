"""A motor that friction rules and no spring holds, as an identification."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactuator.identification.by_prediction import Prepared, usual_band
from tactuator.identification.estimate.friction import Friction
from tactuator.identification.estimate.inverse_dynamics import Motor, motor_estimate
from tactuator.identification.evidence.residuals import ResidualTests
from tactuator.identification.result import BetweenSamples, Identification
from tactuator.model.plant_model import PlantModel

_RULES = 0.1
"""Coulomb level over the command's deviation from which on friction rules a record."""
_UNEXPLAINED = 0.05
_SPRING = 0.03
_CERTAIN = 10.0


def motor_identification(common: Prepared, between: BetweenSamples) -> Identification | None:
    """Return the identification of a record that a free motor with Coulomb friction explains, None of any other.

    The fit is that of the low-passed command, since the position of a free motor remembers every error for ever.
    """
    record = common.record
    motor = motor_estimate(record.command, record.position, record.rate_hz, is_held=between.hold != "band-limited")
    if motor is None or not _is_motor(motor):
        return None
    errors = 1.959964 * np.sqrt(np.diag(motor.covariance))
    covariance = np.zeros((4, 4))
    covariance[:2, :2] = motor.covariance[:2, :2]
    friction = Friction(
        motor.coulomb, float(errors[2]), 1e-3 * float(np.std(record.position)), motor.offset, float(errors[3])
    )
    model = PlantModel(
        num=np.array([motor.gain]),
        den=np.array([1.0, motor.damping, 0.0]),
        delay_s=0.0,
        covariance=covariance,
        band_hz=usual_band(record),
        quantity=common.quantity,
        command_unit=record.command_unit,
        position_unit=record.position_unit,
        method="inverse dynamics",
        record=record.about | {"rate_hz": record.rate_hz, "duration_s": record.duration_s},
        friction={"coulomb": friction.coulomb, "presliding": friction.presliding or 0.0, "offset": friction.offset},
        valid_hz=(1.0 / record.duration_s, motor.corner_hz),
    )
    left = motor.commanded - motor.predicted
    spread = float(np.linalg.norm(motor.commanded - motor.commanded.mean()))
    return Identification(
        model=model,
        order=2,
        excitation=replace(common.excitation, needed=4),
        tests=ResidualTests(float("nan"), float("nan"), motor.unexplained, feedback=None),
        fit_percent=100.0 * (1.0 - float(np.linalg.norm(left)) / spread),
        friction=friction,
        tried=(),
        empirical=common.own_response,
        simulated=motor.predicted,
        measured=motor.commanded,
        remarks=(
            *common.remarks,
            "friction rules this record and no spring holds the mechanism: it is taken as an integrator with one pole, "
            f"from its equation of motion below {motor.corner_hz:.3g} Hz; the fit is that of the command",
        ),
        between=between,
    )


def _is_motor(motor: Motor) -> bool:
    errors = np.sqrt(np.diag(motor.covariance))
    rules = motor.coulomb > _RULES * float(np.std(motor.commanded)) and motor.coulomb > _CERTAIN * errors[2]
    known = abs(motor.gain) > _CERTAIN * errors[0] and motor.damping > -3.0 * errors[1]
    free = motor.spring < _SPRING or motor.spring_t < 5.0
    return bool(rules and known and free and motor.unexplained < _UNEXPLAINED)
