"""The equation of motion of a motor without a spring, turned round: its command from its motion.

The command is a sum of acceleration, velocity, friction and a constant. In a position loop the command is known without
error and what the sensor's noise does to it really acts on the motor. So the equation is fitted the other way round, on
signals low-passed without phase where the motion stands out of the noise. Source: Gautier and Khalil, Modeling,
Identification and Control of Robots, 2002, chapter 12.

The model's friction is Coulomb's and viscous. A record may ask for more: another level and slope in either direction, a
level that falls with the speed (Stribeck). The parameters are means over such laws by their evidence, and their
intervals hold what other laws, parts of the record and low-pass filters that it does not exclude say of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.likelihood import eliminated
from tactuator.identification.residual_tests import autocorrelation
from tactuator.identification.uncertainty import FLOOR

_SLOW = 0.2
"""Share of the velocity's deviation below which a motor may stick: it then bears any command up to its level."""
_PARTS = (0.0, 0.05, 0.5)
"""Other shares: what the parameters say of all samples, or of fast ones alone, is in their intervals."""
_APART = 0.6
"""Time kept off a slow passage, over the low-pass filter's 1/corner."""
_LOWER = 0.7
"""Another corner of the low-pass filter, over the usual one."""
_FEWEST = 60
_BLOCKS = 24
"""Stretches of a record whose errors count as independent of each other: within a move they are not."""
_AS_GOOD = 2.0
"""Power left over what the best law leaves on the same samples, up to which the record does not exclude the model's own
law; and over what is left of moving samples, up to which it does not exclude a part of the record."""
FADING = np.geomspace(0.03, 0.6, 10)
"""Speeds over which Stribeck's part may fade, over the velocity's deviation; beyond them it passes for the others."""


@dataclass(frozen=True, eq=False)
class Bound:
    """Values of a motor that are known: mass, command over acceleration; damping over mass, 1/s; None: not known."""

    mass: float | None = None
    damping: float | None = None

    @property
    def freedom(self) -> tuple[FloatArray, FloatArray]:
        """Return the weights of (acceleration, velocity, sign, one) that are known, (4,), and a basis of the others."""
        foot, basis = np.zeros(4), np.eye(4)
        if self.damping is not None:
            basis[1, 0] = self.damping
        if self.mass is not None:
            foot = self.mass * basis[:, 0]
        kept = [self.mass is None, self.damping is None, True, True]
        return foot, basis[:, kept]


FREE = Bound()


@dataclass(frozen=True, eq=False)
class PlainMotor:
    """What the model's own friction law alone says of a record. plain_t: t values of mass, viscous damping, Coulomb
    level and offset, (4,). unexplained: share of the low-passed command's power that is left; spring: works out the
    share of its deviation that a spring would explain, and its t value. predicted, commanded: low-passed command, (k,).
    """

    plain_t: FloatArray
    unexplained: float
    spring: Callable[[], tuple[float, float]]
    predicted: FloatArray
    commanded: FloatArray


@dataclass(frozen=True, eq=False)
class Motor(PlainMotor):
    """A motor without a spring. theta: acceleration for a unit command; viscous damping over mass, 1/s; Coulomb level
    and offset in units of command; (4,), with their covariance. corner_hz: of the low-pass filter.
    """

    theta: FloatArray
    covariance: FloatArray
    corner_hz: float


def motor_estimate(
    command: FloatArray,
    position: FloatArray,
    rate_hz: float,
    *,
    holds: tuple[bool, ...] = (True,),
    bound: Bound = FREE,
    may_be: Callable[[PlainMotor], bool] = lambda _: True,
) -> Motor | None:
    """Return the motor of a record (n,), or None where too little of it moves, or the plain law's word is not enough.

    holds: whether a converter held the command, both where that is not known, the likelier first. bound: known values.
    may_be: whether other laws, parts and filters are worth the work, by what the plain law says.
    """
    corner = _LOWER * motion_corner(position, rate_hz)
    equation = _Equation(command, position, rate_hz, corner, holds[0])
    plain = _plain_motor(equation, bound)
    main = _Reading.of(equation, _SLOW, bound) if plain is not None and may_be(plain) else None
    if main is None or plain is None:
        return None
    weights, covariance = main.mean
    away = np.zeros(4)
    for other in _others(equation, holds, bound):
        if other.left <= _AS_GOOD * main.left:
            away = np.maximum(away, np.abs(other.departures(weights)).max(axis=0))
    away = np.maximum(away, np.abs(main.departures(weights)).max(axis=0))
    _, basis = bound.freedom
    within = basis @ np.linalg.pinv(basis)
    covariance = covariance + within @ np.diag((away / 1.959964) ** 2 + (FLOOR * weights) ** 2) @ within.T
    # weights = (1/gain, damping/gain, coulomb, offset)
    gain = 1.0 / weights[0]
    slopes = np.diag([-(gain**2), gain, 1.0, 1.0])
    slopes[1, 0] = -weights[1] * gain**2
    covariance = slopes @ covariance @ slopes.T
    # without what rounding leaves of values that are known
    known = np.flatnonzero([bound.mass is not None, bound.damping is not None])
    covariance[known, :] = covariance[:, known] = 0.0
    if not np.all(np.isfinite(slopes)):
        return None
    theta = np.array([gain, weights[1] * gain, weights[2], weights[3]])
    return Motor(**vars(plain), theta=theta, covariance=covariance, corner_hz=corner)


def _plain_motor(equation: _Equation, bound: Bound) -> PlainMotor | None:
    """Return what the plain law says of the samples that move, None where they are too few or nothing is commanded."""
    chosen = _moving(equation.velocity, equation.rate_hz, equation.corner)
    columns, goal, (foot, basis) = equation.columns[chosen], equation.goal[chosen], bound.freedom
    total = float(np.var(goal)) if chosen.size >= _FEWEST else 0.0
    if total == 0.0:
        return None
    free, aim = columns @ basis, goal - columns @ foot
    solution, _, spread = _regress(free, aim)
    weights, covariance = foot + basis @ solution, basis @ spread @ basis.T
    predicted = columns @ weights

    def spring() -> tuple[float, float]:
        place = low_passed(equation.position, equation.rate_hz, equation.corner)[chosen]
        with_spring, _, spread = _regress(np.column_stack([free, place]), aim)
        stiffness, error = abs(float(with_spring[-1])), float(np.sqrt(max(spread[-1, -1], 1e-300)))
        return stiffness * float(np.std(place)) / np.sqrt(total), stiffness / error

    return PlainMotor(
        plain_t=weights / np.sqrt(np.maximum(covariance.diagonal(), 1e-300)),
        unexplained=float(np.var(goal - predicted)) / total,
        spring=spring,
        predicted=predicted,
        commanded=goal,
    )


def _others(equation: _Equation, holds: tuple[bool, ...], bound: Bound) -> Iterator[_Reading]:
    """Yield what other parts of the record, another low-pass filter and another hold say."""
    lower = _Equation(equation.command, equation.position, equation.rate_hz, _LOWER * equation.corner, holds[0])
    tried = [(equation, slow) for slow in _PARTS] + [(lower, _SLOW)]
    for is_held in holds[1:]:
        tried += [(equation.under(is_held), slow) for slow in (_SLOW, *_PARTS)]
    for other, slow in tried:
        reading = _Reading.of(other, slow, bound)
        if reading is not None:
            yield reading


def motor_prediction(
    command: FloatArray, position: FloatArray, rate_hz: float, theta: FloatArray, corner: float, *, is_held: bool
) -> tuple[FloatArray, FloatArray]:
    """Return the low-passed command of a record (n,) while it moves, and what theta predicts of it, each (k,).

    theta: as in `Motor`.
    """
    equation = _Equation(command, position, rate_hz, corner, is_held)
    chosen = _moving(equation.velocity, rate_hz, corner)
    gain, damping, coulomb, offset = theta
    weights = np.array([1.0 / gain, damping / gain, coulomb, offset])
    return equation.goal[chosen], equation.columns[chosen] @ weights


@dataclass(frozen=True, eq=False)
class _Equation:
    """A record (n,) behind a low-pass filter, as an equation of motion."""

    command: FloatArray
    position: FloatArray
    rate_hz: float
    corner: float
    is_held: bool

    def under(self, is_held: bool) -> _Equation:
        """Return the same under another hold; what does not depend on it is not worked out again."""
        other = replace(self, is_held=is_held)
        other.__dict__.update(columns=self.columns, velocity=self.velocity, beside=self.beside)
        return other

    def _passed(self, values: FloatArray) -> FloatArray:
        return low_passed(values, self.rate_hz, self.corner, even=True)

    @cached_property
    def goal(self) -> FloatArray:
        """Return the low-passed command as it acts, (n,)."""
        return low_passed(self.command, self.rate_hz, self.corner, even=True, is_held=self.is_held)

    @cached_property
    def _motion(self) -> FloatArray:
        """Return the second and the first derivative of the low-passed position, (2, n)."""
        lines, s, size = _passed_lines(self.position, self.rate_hz, self.corner, even=False)
        begin, end = (size - self.position.size) // 2, (size + self.position.size) // 2
        return np.asarray(np.fft.irfft([lines * s**2, lines * s], size)[:, begin:end])

    @cached_property
    def velocity(self) -> FloatArray:
        """Return the low-passed velocity, (n,)."""
        return np.asarray(self._motion[1])

    @cached_property
    def columns(self) -> FloatArray:
        """Return acceleration, velocity, its sign and one, (n, 4)."""
        acceleration, velocity = self._motion
        sign = self._passed(np.sign(velocity))
        return np.stack([acceleration, velocity, sign, np.ones(sign.size)], axis=1)

    @cached_property
    def beside(self) -> FloatArray:
        """Return what further laws add: the speed, then Stribeck's part of two shapes over each speed, (n, k)."""
        speed, sign = np.abs(self.velocity), np.sign(self.velocity)
        share = speed / max(float(np.std(self.velocity)), 1e-300)
        parts = [sign * np.exp(-((share / fading) ** shape)) for shape in (1, 2) for fading in FADING]
        return np.stack([self._passed(part) for part in (speed, *parts)], axis=1)


@dataclass(frozen=True, eq=False)
class _Law:
    """A friction law of a reading: weights of the equation's columns (4,), their covariance, what is left (k,), and how
    many parameters it has."""

    weights: FloatArray
    covariance: FloatArray
    rest: FloatArray
    count: int

    @property
    def left(self) -> float:
        return float(np.mean(self.rest**2))


@dataclass(frozen=True, eq=False)
class _Reading:
    """What chosen samples of an equation say under several friction laws; the first is the model's own, the second has
    another slope in either direction. at_rest: weights of the second with the offset at no speed, not at the usual one.
    """

    chosen: NDArray[np.int64]
    laws: tuple[_Law, ...]
    at_rest: FloatArray

    @classmethod
    def of(cls, equation: _Equation, slow: float, bound: Bound) -> _Reading | None:
        """Return the reading of the samples above a share of the usual speed, None where they are too few."""
        chosen = _moving(equation.velocity, equation.rate_hz, equation.corner, slow)
        if chosen.size < _FEWEST:
            return None
        columns, foot, basis = equation.columns[chosen], *bound.freedom
        goal, beside = equation.goal[chosen] - columns @ foot, equation.beside[chosen]
        # what one direction has more than the other, growing with the speed, leaves the mean offset as it is
        usual = float(beside[:, 0].mean())
        beside[:, 0] -= usual
        free = columns @ basis
        laws = []
        further = [beside[:, :0], beside[:, :1]]
        further += [np.column_stack([beside[:, 0], *falling]) for falling in _stribeck(free, beside, goal)]
        kept = slice(0, basis.shape[1])
        for more in further:
            solution, rest, covariance = _regress(np.hstack([free, more]), goal)
            weights = foot + basis @ solution[kept]
            # a part that is greater than the level itself is no part of friction, but another way to write the rest
            if more.shape[1] < 2 or abs(solution[-2]) < abs(weights[2]):
                laws.append(_Law(weights, basis @ covariance[kept, kept] @ basis.T, rest, solution.size))
            if more.shape[1] == 1:
                at_rest = weights - np.array([0.0, 0.0, 0.0, usual * solution[-1]])
        return cls(chosen, tuple(laws), at_rest)

    @property
    def left(self) -> float:
        return min(law.left for law in self.laws)

    @cached_property
    def shares(self) -> FloatArray:
        """Return the evidence of each law, by Bayes' criterion over as many samples as are independent, sum one."""
        best = min(self.laws, key=lambda law: law.left)
        memory = autocorrelation(best.rest, best.rest.size // 4)
        positive = memory / max(float(memory[0]), 1e-300)
        ends = np.flatnonzero(positive <= 0.0)
        count = best.rest.size / (2.0 * float(positive[: ends[0] if ends.size else None].sum()) - 1.0)
        scores = np.array([count * np.log(max(law.left, 1e-300)) + law.count * np.log(count) for law in self.laws])
        shares = np.exp(-0.5 * (scores - scores.min()))
        return np.asarray(shares / shares.sum())

    @cached_property
    def mean(self) -> tuple[FloatArray, FloatArray]:
        """Return the mean of the laws' weights by their evidence, (4,), and its covariance, their spread included."""
        weights = sum(share * law.weights for share, law in zip(self.shares, self.laws, strict=True))
        covariance = np.zeros((4, 4))
        for share, law in zip(self.shares, self.laws, strict=True):
            away = law.weights - weights
            covariance += share * (law.covariance + np.outer(away, away))
        return np.asarray(weights), covariance

    def departures(self, weights: FloatArray) -> FloatArray:
        """Return how far from `weights` (4,) it is: by its evidence, and by each plain law that is as good, (k, 4)."""
        plain = [law.weights for law in self.laws[:2] if law.left <= _AS_GOOD * self.left]
        away = np.stack([self.mean[0], *plain]) - weights
        return np.vstack([away, [0.0, 0.0, 0.0, self.at_rest[3] - weights[3]]])


def _stribeck(free: FloatArray, beside: FloatArray, goal: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield Stribeck's part of each shape, (k,), over the speed by which it explains most, and how that moves it."""
    everything = np.column_stack([free, beside[:, 0], goal, beside[:, 1:]])
    _, rest = eliminated(everything.T @ everything, free.shape[1] + 1)
    won = rest[0, 1:] ** 2 / np.maximum(rest.diagonal()[1:], 1e-300)
    for parts, gains in zip(np.split(beside[:, 1:], 2, axis=1), np.split(won, 2), strict=True):
        best = int(np.clip(np.argmax(gains), 1, FADING.size - 2))
        yield parts[:, best], parts[:, best + 1] - parts[:, best - 1]


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


def _moving(velocity: FloatArray, rate_hz: float, corner: float, share: float = _SLOW) -> NDArray[np.int64]:
    """Return the samples of a motor that moves, four to a period of the corner, away from the record's ends."""
    slow = np.abs(velocity) < share * float(np.std(velocity))
    width = int(_APART * rate_hz / corner)
    slow_before = np.concatenate([[0], np.cumsum(slow)])
    ends, step = int(2.0 * rate_hz / corner), max(int(rate_hz / (4.0 * corner)), 1)
    places = np.arange(ends, velocity.size - ends, step)
    first, beyond = np.maximum(places - width, 0), np.minimum(places + width + 1, velocity.size)
    return np.asarray(places[slow_before[beyond] == slow_before[first]])


def low_passed(
    values: FloatArray, rate_hz: float, corner: float, *, even: bool = False, is_held: bool = False
) -> FloatArray:
    """Return the Gaussian low-pass without phase, (n,), of values or of a command that is held between them (is_held);
    ends mirrored (even) or turned round."""
    lines, s, size = _passed_lines(values, rate_hz, corner, even=even)
    if is_held:
        lines[1:] *= -np.expm1(-s[1:] / rate_hz) / (s[1:] / rate_hz)
    begin = (size - values.size) // 2
    return np.asarray(np.fft.irfft(lines, size)[begin : begin + values.size])


def _passed_lines(
    values: FloatArray, rate_hz: float, corner: float, *, even: bool
) -> tuple[ComplexArray, ComplexArray, int]:
    """Return low-passed lines of the values (n,) and their turned ends, i omega of each, and how many samples."""
    # the low-pass rings over a few of its own periods: no more than those is turned round at either end
    ends = min(values.size - 1, int(6.0 * rate_hz / corner))
    size = scipy.fft.next_fast_len(values.size + 2 * ends, real=True)
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
    """Return least squares weights, what they leave, and a covariance that allows for errors that are alike within a
    stretch of the record: a sum over `_BLOCKS` stretches (Liang and Zeger, 1986).
    """
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    scaled = columns / size
    theta = np.linalg.lstsq(scaled, goal, rcond=1e-12)[0]
    rest = goal - scaled @ theta
    ends = np.linspace(0, goal.size, _BLOCKS + 1).astype(int)[:-1]
    scores = np.add.reduceat(scaled * rest[:, None], ends, axis=0)
    middle = scores.T @ scores * _BLOCKS / (_BLOCKS - columns.shape[1])
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-12, hermitian=True)
    return theta / size, rest, inverse @ middle @ inverse / np.outer(size, size)
