"""A motor with Coulomb friction and no spring, by its equation of motion turned round.

The command is a sum of acceleration, velocity, the velocity's sign and a constant.

In a position loop the command is known without error and what the sensor's noise does to it really acts on the motor.
So the equation is fitted the other way round, on signals low-passed without phase where the motion stands out of the
noise, and only while the motor moves: a motor that sticks bears any command up to its Coulomb level. Source: Gautier
and Khalil, Modeling, Identification and Control of Robots, 2002, chapter 12.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.prepared import Prepared
from tactuator.identification.residual_tests import ResidualTests
from tactuator.identification.result import BetweenSamples, Friction, Identification

_SLOW = 0.2
"""Share of the velocity's deviation below which a motor may stick."""
_APART = 0.6
"""Time kept off a slow passage, over the low-pass filter's 1/corner."""
_LAGS = 12
_FEWEST = 60
_HOPELESS = 0.3
"""Share of the command left unexplained from which on the record is no motor's, and nothing more is tried."""


@dataclass(frozen=True, eq=False)
class Motor:
    """A motor without a spring. theta: acceleration for a unit command; viscous damping over mass, 1/s; Coulomb level
    and offset in units of command; (4,), with their covariance. unexplained: share of the low-passed command's power
    that is left; spring: share of its deviation that a spring would explain, with its t value. predicted, commanded:
    low-passed command, (k,). corner_hz: of the low-pass filter.
    """

    theta: FloatArray
    covariance: FloatArray
    unexplained: float
    spring: float
    spring_t: float
    predicted: FloatArray
    commanded: FloatArray
    corner_hz: float


def motor_estimate(command: FloatArray, position: FloatArray, rate_hz: float, *, is_held: bool = True) -> Motor | None:
    """Return the motor of a record (n,), or None where too little of it moves.

    The confidence holds what another corner of the low-pass filter changes.
    """
    corner = 0.7 * motion_corner(position, rate_hz)
    motor = _estimate(command, position, rate_hz, corner, is_held)
    if motor is None or motor.unexplained > _HOPELESS:
        return motor
    other = _estimate(command, position, rate_hz, 0.7 * corner, is_held)
    if other is None:
        return None
    return replace(motor, covariance=motor.covariance + np.diag((motor.theta - other.theta) ** 2))


def motion_corner(position: FloatArray, rate_hz: float) -> float:
    """Return the frequency up to which the position stands 7 dB above its noise (the floor beyond 0.3 rate), hertz."""
    power = np.abs(np.fft.rfft(np.hanning(position.size) * (position - position.mean()))) ** 2
    frequency = np.fft.rfftfreq(position.size, 1.0 / rate_hz)
    floor = float(np.mean(power[frequency > 0.3 * rate_hz]))
    edges = np.unique(np.round(np.geomspace(3, power.size - 1, 120)).astype(int))
    mean = np.add.reduceat(power, edges)[:-1] / np.diff(edges)
    centre = np.sqrt(edges[:-1] * edges[1:]) * rate_hz / position.size
    above = centre[mean > 5.0 * floor]
    lowest = 20.0 * rate_hz / position.size
    return float(np.clip(above.max() if above.size else lowest, lowest, 0.1 * rate_hz))


def _estimate(command: FloatArray, position: FloatArray, rate_hz: float, corner: float, is_held: bool) -> Motor | None:
    everything, goal, chosen = _equation(command, position, rate_hz, corner, is_held)
    if chosen.size < _FEWEST:
        return None
    columns, place = everything[chosen], low_passed(position, rate_hz, corner)[chosen]
    theta, rest, covariance = _regress(columns, goal[chosen])
    spring, _, spread = _regress(np.column_stack([columns, place]), goal[chosen])
    total = float(np.var(goal[chosen]))
    if theta[0] == 0.0 or total == 0.0:
        return None
    # theta = (1/gain, damping/gain, coulomb, offset)
    gain = 1.0 / theta[0]
    slopes = np.diag([-(gain**2), gain, 1.0, 1.0])
    slopes[1, 0] = -theta[1] * gain**2
    share = abs(float(spring[4])) * float(np.std(place)) / np.sqrt(total)
    return Motor(
        theta=np.array([gain, theta[1] * gain, theta[2], theta[3]]),
        covariance=slopes @ covariance @ slopes.T,
        unexplained=float(np.var(rest)) / total,
        spring=share,
        spring_t=abs(float(spring[4])) / float(np.sqrt(max(spread[4, 4], 1e-300))),
        predicted=goal[chosen] - rest,
        commanded=goal[chosen],
        corner_hz=corner,
    )


def motor_prediction(
    command: FloatArray, position: FloatArray, rate_hz: float, theta: FloatArray, corner: float, *, is_held: bool
) -> tuple[FloatArray, FloatArray]:
    """Return the low-passed command of a record (n,) while it moves, and what theta predicts of it, each (k,).

    theta: as in `Motor`.
    """
    columns, goal, chosen = _equation(command, position, rate_hz, corner, is_held)
    gain, damping, coulomb, offset = theta
    weights = np.array([1.0 / gain, damping / gain, coulomb, offset])
    return goal[chosen], columns[chosen] @ weights


def _equation(
    command: FloatArray, position: FloatArray, rate_hz: float, corner: float, is_held: bool
) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
    """Return the regressors (n, 4), the low-passed command (n,) and the samples that count."""
    acting = command.copy()
    if is_held:
        # a held command acts half a sample later than its own time
        acting[1:] = 0.5 * (command[1:] + command[:-1])
    acceleration, velocity = _derivatives(position, rate_hz, corner)
    sign = low_passed(np.sign(velocity), rate_hz, corner, even=True)
    goal = low_passed(acting, rate_hz, corner, even=True)
    columns = np.stack([acceleration, velocity, sign, np.ones(sign.size)], axis=1)
    return columns, goal, _moving(velocity, rate_hz, corner)


def _moving(velocity: FloatArray, rate_hz: float, corner: float) -> NDArray[np.int64]:
    """Return the samples of a motor that moves, four to a period of the corner, away from the record's ends."""
    slow = np.abs(velocity) < _SLOW * float(np.std(velocity))
    width = int(_APART * rate_hz / corner)
    slow_before = np.concatenate([[0], np.cumsum(slow)])
    ends, step = int(2.0 * rate_hz / corner), max(int(rate_hz / (4.0 * corner)), 1)
    places = np.arange(ends, velocity.size - ends, step)
    first, beyond = np.maximum(places - width, 0), np.minimum(places + width + 1, velocity.size)
    return np.asarray(places[slow_before[beyond] == slow_before[first]])


def low_passed(values: FloatArray, rate_hz: float, corner: float, *, even: bool = False) -> FloatArray:
    """Return the Gaussian low-pass without phase, (n,); ends mirrored (even) or turned round."""
    lines, _, size = _passed_lines(values, rate_hz, corner, even=even)
    begin = (size - values.size) // 2
    return np.asarray(np.fft.irfft(lines, size)[begin : begin + values.size])


def _derivatives(values: FloatArray, rate_hz: float, corner: float) -> tuple[FloatArray, FloatArray]:
    """Return the second and the first derivative of the low-passed values, (n,) each."""
    lines, s, size = _passed_lines(values, rate_hz, corner, even=False)
    begin = (size - values.size) // 2
    derivatives = [np.fft.irfft(lines * s**order, size)[begin : begin + values.size] for order in (2, 1)]
    return derivatives[0], derivatives[1]


def _passed_lines(
    values: FloatArray, rate_hz: float, corner: float, *, even: bool
) -> tuple[ComplexArray, ComplexArray, int]:
    """Return low-passed lines of the values (n,) and their turned ends, i omega of each, and how many samples."""
    # the low-pass rings over a few of its own periods: no more than those is turned round at either end
    ends = min(values.size - 1, int(6.0 * rate_hz / corner))
    size = int(scipy.fft.next_fast_len(values.size + 2 * ends, real=True))
    before = (size - values.size) // 2
    ends_by = (before, size - values.size - before)
    if even:
        turned = np.pad(values, ends_by, mode="symmetric")
    else:
        turned = np.pad(values, ends_by, mode="reflect", reflect_type="odd")
    frequency = np.fft.rfftfreq(size, 1.0 / rate_hz)
    passed = np.exp(-0.35 * (frequency / corner) ** 2)
    return np.asarray(np.fft.rfft(turned) * passed), np.asarray(2j * np.pi * frequency), size


def _regress(columns: FloatArray, goal: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Solve least squares with a covariance that allows for neighbours' correlation (Newey and West, 1987)."""
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    scaled = columns / size
    theta = np.linalg.lstsq(scaled, goal, rcond=1e-12)[0]
    rest = goal - scaled @ theta
    scores = scaled * rest[:, None]
    middle = scores.T @ scores
    for lag in range(1, _LAGS + 1):
        cross = scores[lag:].T @ scores[:-lag]
        middle += (1.0 - lag / (_LAGS + 1.0)) * (cross + cross.T)
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-12, hermitian=True)
    return theta / size, rest, inverse @ middle @ inverse / np.outer(size, size)


_RULES = 0.1
"""Coulomb level over the command's deviation from which on friction rules a record."""
_UNEXPLAINED = 0.05
_SPRING = 0.03
_CERTAIN = 10.0


def motor_identification(common: Prepared, between: BetweenSamples) -> Identification | None:
    """Return the identification of a record that a free motor with Coulomb friction explains, None of any other.

    The fit is that of the low-passed command, since the position of a free motor remembers every error for ever.
    """
    record = common.records[0]
    motor = motor_estimate(record.command, record.position, record.rate_hz, is_held=between.hold != "band-limited")
    if motor is None:
        return None
    gain, damping, coulomb, offset = motor.theta.tolist()
    errors = np.sqrt(np.diag(motor.covariance))
    rules = coulomb > _RULES * float(np.std(motor.commanded)) and coulomb > _CERTAIN * errors[2]
    known = abs(gain) > _CERTAIN * errors[0] and damping > -3.0 * errors[1]
    free = motor.spring < _SPRING or motor.spring_t < 5.0
    if not (rules and known and free and motor.unexplained < _UNEXPLAINED):
        return None
    errors, covariance = 1.959964 * errors, np.zeros((4, 4))
    covariance[:2, :2] = motor.covariance[:2, :2]
    short = 1e-3 * float(np.std(record.position))
    friction = Friction(coulomb, float(errors[2]), short, offset, float(errors[3]))
    model = common.model(
        np.array([gain]),
        np.array([1.0, damping, 0.0]),
        covariance,
        method="inverse dynamics",
        friction=friction.stated | {"offset": offset},
        valid_hz=(1.0 / record.duration_s, motor.corner_hz),
    )
    rest = motor.commanded - motor.predicted
    spread = float(np.linalg.norm(motor.commanded - motor.commanded.mean()))
    return Identification(
        model=model,
        order=2,
        excitation=replace(common.excitation, needed=4),
        tests=ResidualTests(float("nan"), float("nan"), motor.unexplained, feedback=None),
        fit_percent=100.0 * (1.0 - float(np.linalg.norm(rest)) / spread),
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
