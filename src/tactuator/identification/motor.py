"""Records of a motor with friction and no spring, identified by its equation of motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tactuator.identification.asked import Fixed
from tactuator.identification.inverse_dynamics import FREE, Bound, Motor, PlainMotor, motor_estimate
from tactuator.identification.prepared import Prepared
from tactuator.identification.residual_tests import ResidualTests
from tactuator.identification.result import BetweenSamples, Friction, Identification
from tactuator.identification.standing import FixedAgainstOwn, held_against
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
    bound = bound_by(common.asked.fixed)
    if bound is None:
        return None
    record, is_held = common.records[0], between.hold != "band-limited"
    holds = (is_held,) if between.certain else (is_held, not is_held)

    signals = record.command, record.position, record.rate_hz
    free = motor_estimate(*signals, holds=holds, may_be=_may_be_motor)
    if free is None or not free.theta[2] > _RULES * float(np.std(free.commanded)):
        return None
    motor = free if bound == FREE else motor_estimate(*signals, holds=holds, bound=bound)
    if motor is None:
        return None
    result = _identification(common, between, motor)
    if bound == FREE:
        return result
    held: Identification = held_against(result, _model(common, free), common.asked.fixed, _departs)
    return held


def bound_by(fixed: Sequence[Fixed]) -> Bound | None:
    """Return what fixed values say of a motor without a spring; None where they are of another mechanism."""
    mass = damping = None
    for value in fixed:
        if value.name in ("mass", "num_s0"):
            mass = value.value if value.name == "mass" else 1.0 / value.value
        elif value.name in ("pole", "den_s1") and damping is None:
            damping = value.section[0] if value.section else value.value
        else:
            return None
    return Bound(mass, damping)


def _may_be_motor(plain: PlainMotor) -> bool:
    """Return true where friction is certain, no spring shows and little is left over."""
    known = abs(plain.plain_t[0]) > _CERTAIN and plain.plain_t[1] * np.sign(plain.plain_t[0]) > -3.0
    if not (plain.plain_t[2] > _CERTAIN and known and plain.unexplained < _UNEXPLAINED):
        return False
    share, spring_t = plain.spring()
    return share < _SPRING or spring_t < 5.0


def _friction(common: Prepared, motor: Motor) -> Friction:
    half_widths = 1.959964 * np.sqrt(np.diag(motor.covariance))
    short = 1e-3 * float(np.std(common.records[0].position))
    return Friction(float(motor.theta[2]), float(half_widths[2]), short, float(motor.theta[3]), float(half_widths[3]))


def _model(common: Prepared, motor: Motor) -> PlantModel:
    gain, damping = motor.theta[:2].tolist()
    covariance = np.zeros((4, 4))
    covariance[:2, :2] = motor.covariance[:2, :2]
    friction, fixed = _friction(common, motor), common.asked.fixed
    return common.model(
        np.array([gain]),
        np.array([1.0, damping, 0.0]),
        covariance,
        method="inverse dynamics",
        record={"fixed": " ".join(map(str, fixed))} if fixed else {},
        friction=friction.stated | {"offset": friction.offset},
        valid_hz=(1.0 / common.records[0].duration_s, motor.corner_hz),
    )


def _identification(common: Prepared, between: BetweenSamples, motor: Motor) -> Identification:
    rest = motor.commanded - motor.predicted
    spread = float(np.linalg.norm(motor.commanded - motor.commanded.mean()))
    return Identification(
        model=_model(common, motor),
        order=2,
        excitation=replace(common.excitation, needed=4),
        tests=ResidualTests(float("nan"), float("nan"), motor.unexplained, feedback=None),
        fit_percent=100.0 * (1.0 - float(np.linalg.norm(rest)) / spread),
        friction=_friction(common, motor),
        tried=(),
        empirical=common.own_response,
        simulated=motor.predicted,
        measured=motor.commanded,
        remarks=(
            *common.remarks,
            f"a motor without a spring, ruled by friction: fitted is its command, below {motor.corner_hz:.3g} Hz",
        ),
        between=between,
    )


def _departs(known: Sequence[FixedAgainstOwn]) -> bool:
    """Return true where a value is not the record's own."""
    return any(
        value.by_record is not None and not abs(value.by_record[0] - value.fixed.value) < value.half for value in known
    )
