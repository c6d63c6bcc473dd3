"""Requirements on a synthesised loop as smooth functions of its parameters, and the local optima of that problem.

Every requirement becomes an excess in dB (phase: degrees / 5) that must not be positive. On a fixed grid, for every
plant of the family at once: d log S = -T dlogC, d log|T| = Re(S dlogC), d|CS|^2 = 2 |CS|^2 Re(S dlogC).

A loop is stable at every lower gain if 1 + kL turns as often for every k from 0 to 1: L meets no point of the real axis
below -1, nor S one below zero. So the angle of S, followed from half the rate downwards, stays within 180 degrees.

A local optimum is found by sequential quadratic programming (SLSQP). Two further unknowns make the problem smooth and
always solvable: the worst member's mean |S|, and one common excess that is punished so hard that it is zero wherever
that is possible.

A local solution that misses the limits says little. The problem has dozens of local optima a few tenths of a decibel
apart, and which of them a start leads to changes with every limit, so that the same starts can find a loop under tight
limits and none under looser ones. Each of the best local solutions is therefore left by a fixed sequence of steps and
solved again, and what comes out closer to the limits takes its place (monotonic basin hopping: Leary, Journal of Global
Optimization 18, 2000).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain, pairwise

import numpy as np
import scipy

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.signals.loop import FeedbackLoop
from tactuator.signals.loop_figures import LoopFigures, least_gain
from tactuator.signals.systems import SampledSystem, backward_difference
from tactuator.synthesis.assessment import quadrature
from tactuator.synthesis.candidates import (
    COUNT,
    FREQUENCIES,
    LIGHT_DAMPING,
    POLE_DAMPINGS,
    POLES,
    ZERO_DAMPINGS,
    LoopStructure,
    other_modes,
    slow_pair,
)
from tactuator.synthesis.family import Member
from tactuator.synthesis.limits import DB, DEGREES_PER_DB, Limit, Task

_SHARPNESS = 300.0
"""Of the smooth maximum, per dB: of hundreds of alike values it is 0.02 dB too high."""
_KEPT = 8
"""Evaluations that are remembered, the newest."""
_MOST_TURN = np.pi - 0.02
"""Greatest angle of S, radians, on a grid that may overlook a little."""


@dataclass(frozen=True)
class Point:
    """The problem at one parameter vector: mean |S| in dB of every member, shape (m,), with slopes (m, COUNT); every
    excess, shape (c,), with slopes (c, COUNT)."""

    mean_db: FloatArray
    mean_slope: FloatArray
    excess: FloatArray
    excess_slope: FloatArray


class LoopProblem:
    """The limits of a task, with a share of the resonance objective, on its family of plants, on fixed grids.

    limits: in the order of the excesses, for each member in turn. tighten: shape (c,), added to every excess: what the
    grids overlook, found by a full assessment. peaks_hz: more frequencies, hertz, at which |S| and |T| are looked at.
    """

    def __init__(self, task: Task, share: float = 1.0, peaks_hz: Sequence[float] = ()) -> None:
        self.task, self.share, self.peaks_hz = task, share, tuple(peaks_hz)
        self.structure = LoopStructure(task.rate_hz)
        self.loop_limits = task.limits_at(share)
        self.limits = tuple(limit.under(member.name) for member in task.family for limit in self.loop_limits)
        self.tighten = np.zeros(len(self.limits))
        self._kept: dict[bytes, Point] = {}
        self.solved: dict[tuple[object, ...], Solution | None] = {}
        self._hard = np.array([not limit.relaxable for limit in self.limits])
        low, high = task.rejection_band_hz
        nodes, weights = np.polynomial.legendre.leggauss(16)
        band = np.exp(0.5 * (np.log(low * high) + np.log(high / low) * nodes))
        spread = [np.geomspace(0.02 * low, low, 10), np.geomspace(low, 0.49 * task.rate_hz, 170)]
        peaks = np.unique(np.concatenate([*spread, *_around_modes_hz(task.family), peaks_hz]))
        peaks = peaks[(peaks > 0.0) & (peaks <= 0.49 * task.rate_hz)]
        noise, self._noise_weight = quadrature(task.rate_hz, panels=9, nodes=9)
        lines = {limit: np.array([limit.frequency_hz]) for limit in self.loop_limits if limit.frequency_hz is not None}
        parts = [band, peaks, noise, *lines.values()]
        edges = np.cumsum([0, *(part.size for part in parts)]).tolist()
        self._band, self._peaks, self._noise, *places = (slice(a, b) for a, b in pairwise(edges))
        self._lines = dict(zip(lines, places, strict=True))
        self._band_weight = 0.5 * weights
        grid = np.concatenate(parts)
        z = np.exp(2j * np.pi * grid / task.rate_hz)
        self._difference = backward_difference(grid, task.rate_hz) * z
        self._plants = np.array([member.sampled.response(grid) for member in task.family])

    def at(self, parameters: FloatArray) -> Point:
        """Return the values and derivatives of everything at one parameter vector. A few of the last are kept: programs
        begin where others ended.
        """
        key = parameters.tobytes() + self.tighten.tobytes()
        if key not in self._kept:
            if len(self._kept) >= _KEPT:
                del self._kept[next(iter(self._kept))]
            self._kept[key] = self._point(parameters)
        return self._kept[key]

    def _point(self, parameters: FloatArray) -> Point:
        controller, slope = self.structure.response_and_slope(parameters, self._difference)
        loops, by_log = LoopFigures(controller * self._plants), np.ascontiguousarray(slope.T)
        band = self._band
        mean = DB * (loops.log_s[:, band] @ self._band_weight)
        rows = [(mean, band, -DB * loops.complementary[:, band] * self._band_weight)]
        rows += [self._excess(limit, loops, controller) for limit in self.loop_limits]
        values = np.stack([row for row, _, _ in rows], axis=1)
        slopes = np.stack([(weights @ by_log[place]).real for _, place, weights in rows], axis=1)
        excess = values[:, 1:].reshape(-1) + self.tighten
        return Point(values[:, 0], slopes[:, 0], excess, slopes[:, 1:].reshape(-1, COUNT))

    def turned_db(self, parameters: FloatArray) -> float:
        """Return how far loops of lower gain are from stable ones, dB; zero where they need not be stable."""
        return float(np.max(self.at(parameters).excess[self._hard], initial=0.0))

    def _excess(
        self, limit: Limit, loops: LoopFigures, controller: ComplexArray
    ) -> tuple[FloatArray, slice, ComplexArray]:
        """Return the excess of every member, (m,), a place in the grid, and weights w there, (m, size), with which the
        excess follows log C: Re(sum w dlogC)."""
        at = self._lines.get(limit, self._noise if limit.quantity == "command_noise_gain_max" else self._peaks)
        sensitivity, complementary = loops.sensitivity[:, at], loops.complementary[:, at]
        match limit.quantity:
            case "|T|" | "resonance_peak":
                level, share = _smooth_maximum(loops.log_t[:, at])
                return _level_excess_db(limit, level), at, DB * sensitivity * share
            case "|S|" | "sensitivity_peak":
                level, share = _smooth_maximum(loops.log_s[:, at])
                return _level_excess_db(limit, level), at, -DB * complementary * share
            case "phase_margin_deg":
                margin, weights = loops.phase_margin_deg(at)
                return limit.excess_db(margin), at, -weights / DEGREES_PER_DB
            case "command_noise_gain_max":
                power = self._noise_weight * np.abs(controller[at] * sensitivity) ** 2
                total = power.sum(axis=1)
                excess = 0.5 * DB * np.log(total) - DB * math.log(limit.asked)
                return excess, at, DB * sensitivity * power / total[:, None]
            case "least_gain":
                angle = np.angle(sensitivity)
                if np.abs(angle[:, 1:] - angle[:, :-1]).max() >= np.pi:
                    angle = np.unwrap(angle[:, ::-1], axis=1)[:, ::-1]
                most, share = _smooth_maximum(np.abs(angle))
                weights = 1j * complementary * np.sign(angle) * share
                return np.degrees(most - _MOST_TURN) / DEGREES_PER_DB, at, np.degrees(1.0) / DEGREES_PER_DB * weights


def _level_excess_db(limit: Limit, level: FloatArray) -> FloatArray:
    """Return by how much levels, logarithms of a ratio, pass a limit in dB or of a ratio."""
    return np.asarray(DB * level - limit.asked if limit.unit == "dB" else DB * (level - math.log(limit.asked)))


def _around_modes_hz(family: Sequence[Member]) -> Iterator[FloatArray]:
    """Yield frequencies around every lightly damped pole and zero of each member: dense in proportion to its damping,
    up to 30 % away, as far as a controller's notch may lie beside it."""
    for member in family:
        for root in np.append(member.continuous.poles, member.continuous.zeros):
            if root.imag > 0.0 and abs(root.real) < LIGHT_DAMPING * abs(root):
                away = np.geomspace(0.25 * min(max(abs(root.real) / root.imag, 1e-5), 0.3), 0.3, 12)
                yield root.imag * (1.0 + np.concatenate([-away[::-1], [0.0], away])) / (2.0 * np.pi)


@lru_cache(maxsize=8)
def problem_of(task: Task, share: float = 1.0) -> LoopProblem:
    """Return the problem before anything tightens it; solutions are cached."""
    return LoopProblem(task, share)


def _smooth_maximum(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the log-sum-exp along each row, slightly above the maximum, and the share that each value has in it."""
    top = values.max(axis=1, keepdims=True)
    weights = np.exp(_SHARPNESS * (values - top))
    total = weights.sum(axis=1, keepdims=True)
    return (top + np.log(total) / _SHARPNESS)[:, 0], weights / total


_PUNISHMENT = 30.0
"""Mean |S|, dB, that each dB beyond the limits costs."""
_BOX, _SMALLER, _LEAST_BOX, _ROUNDS = 1.0, 4.0, 0.05, 12
"""Reach of a round in each parameter (natural logarithms), by what it shrinks without gain, its least; rounds."""
_FEW, _TO_THE_END = {"maxiter": 20, "ftol": 1e-3}, {"maxiter": 200, "ftol": 1e-6}
_TURNED_DB, _SETTLED_DB, _KEPT_DB = 2.0, 0.05, 1e-3


@dataclass(frozen=True)
class Solution:
    """A local optimum: its parameters, the worst member's mean |S| in dB (or the excess that was minimised), and the
    common excess, dB: zero where every requirement is kept."""

    parameters: FloatArray
    mean_db: float
    excess_db: float

    @property
    def merit_db(self) -> float:
        """Return what is minimised."""
        return self.mean_db + _PUNISHMENT * self.excess_db


def solve(problem: LoopProblem, start: FloatArray, relaxed: Sequence[Limit] = ()) -> Solution | None:
    """Find one local solution; the excess of the limits `relaxed`, if any, is minimised instead, all others kept.

    Programs of a few iterations follow each other, each in a box around where the last one ended: a longer step leaps
    into loops that are unstable, and between which and stable ones no way leads downhill. A box from which a program
    leaps all the same is tried again, smaller.
    """
    key = (start.tobytes(), *relaxed, problem.tighten.tobytes())
    if key not in problem.solved:
        problem.solved[key] = _solved(problem, start, relaxed)
    return problem.solved[key]


def polished(problem: LoopProblem, start: FloatArray) -> Solution | None:
    """Return the local optimum next to `start`, to many digits: one program that goes on to its end. None where that
    is not better than the start. Where programs of a few iterations end depends on the last bits of a processor.
    """
    low, high = bounds(problem.task)
    box = np.maximum(low, start - _BOX), np.minimum(high, start + _BOX)
    end = _solve_near(problem, start, (), box, _TO_THE_END)
    if end is None or problem.turned_db(end.parameters) > _TURNED_DB:
        return None
    first = problem.at(start)
    before = Solution(start, float(np.max(first.mean_db)), max(0.0, float(np.max(first.excess))))
    return end if end.merit_db <= before.merit_db else None


def _solved(problem: LoopProblem, start: FloatArray, relaxed: Sequence[Limit]) -> Solution | None:
    low, high = bounds(problem.task)
    here, box = np.clip(start, low, high), _BOX
    best: Solution | None = None
    for _ in range(_ROUNDS):
        solution = _solve_near(problem, here, relaxed, (np.maximum(low, here - box), np.minimum(high, here + box)))
        better = -np.inf
        if solution is not None and problem.turned_db(solution.parameters) <= _TURNED_DB:
            better = np.inf if best is None else best.merit_db - solution.merit_db
            if better > 0.0:
                best, here = solution, solution.parameters
        if better < _SETTLED_DB:
            box /= _SMALLER
            if box < _LEAST_BOX or (best is not None and better > 0.0 and best.excess_db <= _KEPT_DB):
                break
    return best


def _solve_near(
    problem: LoopProblem,
    start: FloatArray,
    relaxed: Sequence[Limit],
    box: tuple[FloatArray, FloatArray],
    options: Mapping[str, float] = _FEW,
) -> Solution | None:
    first = problem.at(start)
    free = np.array([limit.under(None) in relaxed for limit in problem.limits])

    def at(unknowns: FloatArray) -> Point:
        return problem.at(unknowns[:COUNT])

    def aims(point: Point) -> tuple[FloatArray, FloatArray]:
        return (point.excess[free], point.excess_slope[free]) if relaxed else (point.mean_db, point.mean_slope)

    def rooms(unknowns: FloatArray) -> FloatArray:
        point = at(unknowns)
        return np.concatenate([unknowns[COUNT] - aims(point)[0], unknowns[COUNT + 1] - point.excess[~free]])

    def slopes(unknowns: FloatArray) -> FloatArray:
        point = at(unknowns)
        aim = aims(point)[1]
        rows = np.zeros((aim.shape[0] + int(np.sum(~free)), COUNT + 2))
        rows[: aim.shape[0], :COUNT], rows[: aim.shape[0], COUNT] = -aim, 1.0
        rows[aim.shape[0] :, :COUNT], rows[aim.shape[0] :, COUNT + 1] = -point.excess_slope[~free], 1.0
        return rows

    cost = np.append(np.zeros(COUNT), [1.0, _PUNISHMENT])
    with np.errstate(all="ignore"):
        aim, excess = float(np.max(aims(first)[0])), max(0.0, float(np.max(first.excess[~free], initial=0.0)))
        result = scipy.optimize.minimize(
            lambda unknowns: float(cost @ unknowns),
            np.append(start, [aim, excess]),
            jac=lambda unknowns: cost,
            bounds=scipy.optimize.Bounds(np.append(box[0], [-np.inf, 0.0]), np.append(box[1], [np.inf, np.inf])),
            constraints=[{"type": "ineq", "fun": rooms, "jac": slopes}],
            method="SLSQP",
            options=options,
        )
        last = at(result.x)
        reached = float(np.max(aims(last)[0])), max(0.0, float(np.max(last.excess[~free], initial=0.0)))
    return Solution(result.x[:COUNT], *reached) if np.all(np.isfinite(reached)) else None


def is_sound(feedback: SampledSystem, task: Task) -> bool:
    """Return whether the loop is stable on every plant and, if required, at every lower gain."""
    loops = [FeedbackLoop(feedback, member.sampled) for member in task.family]
    most = 0.0 if task.requires_unconditional_stability else 1.0
    return all(loop.is_stable and least_gain(loop.open_loop) <= most for loop in loops)


_SLOWEST_ZERO_HZ, _SLOWEST_POLE_HZ = 1.0, 3.0
"""Lowest corners of the controller's zeros and poles."""
_ZERO_DAMPING = (0.7, 4.0)
"""Least and greatest damping of the controller's zeros; the least is lower beside a plant's own mode."""
_POLE_DAMPING = (0.9, 2.0)
"""Least and greatest damping of the controller's poles."""


def bounds(task: Task) -> tuple[FloatArray, FloatArray]:
    """Return lower and upper bounds on the parameters, shape (COUNT,) each.

    Natural frequencies of zeros lie from 1 Hz, those of poles from 3 Hz, up to just below half the rate: a slow pole
    winds up while the command is at its limit, and anti-windup keeps one of them from it. Zeros are damped by 0.7 or
    more, poles by 0.9: nothing in the controller rings, and T stays smooth enough for a prefilter of few poles. Zeros
    may be as soft as the plant's own resonances, to cancel them.
    """
    to_radians = 2.0 * np.pi / task.rate_hz
    low, high = np.full(COUNT, -np.inf), np.full(COUNT, np.inf)
    frequencies, zeros, poles = list(FREQUENCIES), list(ZERO_DAMPINGS), list(POLE_DAMPINGS)
    low[frequencies], high[frequencies] = np.log(to_radians * _SLOWEST_ZERO_HZ), np.log(2.0 * np.pi * 0.45)
    low[list(POLES)] = np.log(to_radians * _SLOWEST_POLE_HZ)
    own = task.family[0].continuous.poles
    own = own[own.imag > 0.0]
    softest = min(_ZERO_DAMPING[0], 0.6 * max(float(np.min(-own.real / np.abs(own), initial=1.0)), 1e-3))
    low[zeros], high[zeros] = np.log(softest), np.log(_ZERO_DAMPING[1])
    low[poles], high[poles] = np.log(_POLE_DAMPING[0]), np.log(_POLE_DAMPING[1])
    return low, high


_LIGHT, _HEAVY = (1.0, 0.25, 2.0), (2.0, 0.5, 4.0)
_STARTS = ((0.02, _LIGHT), (0.035, _HEAVY), (0.02, _HEAVY), (0.008, _LIGHT), (0.008, _HEAVY), (0.035, _LIGHT))
"""Starts, the most fruitful first: crossover as a share of the rate, and a lag: a frequency (hertz) and a share of the
crossover, between which its poles lie, and their damping."""
_BELOW_MODE, _ROLL_OFF = (0.1, 0.2), 4.0
"""Crossovers of the starts that stay below a mode, and where their poles lie, as shares of the mode's frequency."""
_FAR = 2.5
"""A root out of the way, rad/sample: close to half the rate."""
_LOWER, _TIMES_LOWER = 0.5, 14
"""Log of the gain that a start which is unstable at some lower gain gives up at a time, and how often (-61 dB)."""


def starts(problem: LoopProblem) -> list[FloatArray]:
    """Return starts that invert the plant's two slowest poles and its next mode and fall twice as steeply far below the
    crossover, for several crossovers; the gain as far below that as the loop is stable. A plant that integrates and has
    no mode gets one more, the first: its single pole is as slow as allowed, with zeros around the crossover."""
    nominal, rate_hz = problem.task.family[0].continuous, problem.task.rate_hz
    slow, damping = slow_pair(nominal)
    others = other_modes(nominal)
    integrates = not others and bool(np.any(nominal.poles == 0.0))
    beginnings = []
    for index, (share, (lag_hz, lag_share, lag_damping)) in enumerate(_STARTS[3:4] * integrates + _STARTS):
        omega = 2.0 * np.pi * share
        lag = np.sqrt(2.0 * np.pi * lag_hz / rate_hz * lag_share * omega)
        notch, depth = (others[0][0] / rate_hz, max(others[0][1], 1e-3)) if others else (_FAR, 1.0)
        pole, far = _FAR, 3.0 * omega
        if integrates and index == 0:
            pole, notch, depth, far = 2.0 * np.pi * _SLOWEST_POLE_HZ / rate_hz, 1.7 * omega, 4.0, 1.25 * omega
        second = [0.25 * omega, 0.8, lag, lag_damping, notch, depth, far, 0.9]
        beginnings.append(_with_gain(problem, [slow / rate_hz, damping, pole, *second], share * rate_hz))
    return beginnings


def start_near(problem: LoopProblem, controller: SampledSystem) -> FloatArray:
    """Return a controller of the structure as a start: of its parameter vectors the one furthest within the bounds."""
    low, high = bounds(problem.task)
    vectors = problem.structure.vectors(controller)
    return min(vectors, key=lambda vector: float(np.abs(vector - np.clip(vector, low, high)).max()))


def starts_below_modes(problem: LoopProblem) -> list[FloatArray]:
    """Return starts whose crossover lies below a mode of the plant: they invert its two slowest poles and that mode,
    and roll off above it. There are none without a mode. What inverts a slow mode up to a fast crossover (`starts`)
    sends too much noise to the motor, and no way leads from there to a slow one."""
    nominal, rate_hz = problem.task.family[0].continuous, problem.task.rate_hz
    slow, damping = slow_pair(nominal)
    beginnings = []
    for natural, softness in other_modes(nominal):
        mode = natural / rate_hz
        pole = min(_ROLL_OFF * mode, _FAR)
        values = [slow / rate_hz, damping, pole, _FAR, 1.0, pole, 0.9, mode, max(softness, 1e-3), pole, 0.9]
        beginnings += [_with_gain(problem, values, share * natural / (2.0 * np.pi)) for share in _BELOW_MODE]
    return beginnings


def _with_gain(problem: LoopProblem, values: Sequence[float], crossover_hz: float) -> FloatArray:
    """Return the parameters of a shape, with the gain of that crossover, or as far below that as the loop is stable."""
    nominal = problem.task.family[0].sampled
    parameters = np.clip(np.log([1.0, *values]), *bounds(problem.task))
    unit = problem.structure.system(parameters).response(crossover_hz) * nominal.response(crossover_hz)
    parameters[0] -= np.log(np.abs(unit))
    for _ in range(_TIMES_LOWER):
        if problem.turned_db(parameters) <= 0.0:
            break
        parameters[0] -= _LOWER
    return parameters


_HOPS, _HOPS_LEAST, _HOPS_TIMES_DB = 128, 6, 24.0
_SIZES = (0.3, 0.7)
"""Standard deviations of the steps, in turn: natural logarithms of gain, frequencies and dampings."""
_SAME_DB = 1e-3
"""Difference of the excess within which two solutions are one."""


def hops(problem: LoopProblem, beginnings: Sequence[FloatArray]) -> Iterator[Solution]:
    """Yield stable local solutions, those of `beginnings` first: each that of a step away from one yielded before, the
    nearer to the limits the more often. The sequence ends after _HOPS steps, or sooner the farther from the limits the
    nearest is: steps find tenths of a dB, not whole ones. The caller can stop earlier.
    """
    pool: list[Solution] = []
    for start in chain(beginnings, _steps_away(beginnings, pool)):
        solution = solve(problem, start)
        if solution is not None and is_sound(problem.structure.system(solution.parameters), problem.task):
            if all(abs(solution.excess_db - known.excess_db) > _SAME_DB for known in pool):
                # the best few, from which further hops begin
                pool[:] = sorted([*pool, solution], key=lambda known: known.excess_db)[:6]
            yield solution


def _steps_away(beginnings: Sequence[FloatArray], pool: Sequence[Solution]) -> Iterator[FloatArray]:
    """Yield steps away from members of `pool` as it then is; from `beginnings` while it is empty. Sobol's points choose
    the member, and the step."""
    points = scipy.stats.qmc.Sobol(COUNT + 1, scramble=False).fast_forward(1).random(_HOPS)  # the first is zero
    for index, point in enumerate(points):
        if index >= _HOPS_LEAST and index * min((known.excess_db for known in pool), default=np.inf) > _HOPS_TIMES_DB:
            return
        origins = [known.parameters for known in pool] or list(beginnings)
        origin = origins[min(int(-np.log2(point[0])), len(origins) - 1)]
        yield origin + _SIZES[index % len(_SIZES)] * np.asarray(scipy.special.ndtri(point[1:]))
