"""One local optimum of a loop problem, by sequential quadratic programming (SLSQP).

Two further unknowns make the problem smooth and always solvable: the worst member's mean |S|, and one common excess
that is punished so hard that it is zero wherever that is possible.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from tactuator.arrays import FloatArray
from tactuator.signals.loop import FeedbackLoop
from tactuator.signals.systems import SampledSystem
from tactuator.synthesis.family import Member
from tactuator.synthesis.loop.problem import LoopProblem, Point
from tactuator.synthesis.loop.screening import WEAKER
from tactuator.synthesis.loop.structure import COUNT

_PUNISHMENT = 30.0
_GAIN_RANGE = 4.0


@dataclass(frozen=True)
class Solution:
    """A local optimum: its parameters, the worst member's mean |S| in dB (or the excess that was minimised), and the
    common excess, dB: zero where every requirement is kept."""

    parameters: FloatArray
    mean_db: float
    excess_db: float


def solve(
    problem: LoopProblem, start: FloatArray, limits: optimize.Bounds, relaxed: frozenset[str] = frozenset()
) -> Solution | None:
    """Find one local solution; the excess of the requirements `relaxed`, if any, is minimised instead, all others being
    kept.
    """
    free = np.array([label in relaxed for label, _ in problem.labels])
    cache: dict[bytes, Point] = {}

    def at(unknowns: FloatArray) -> Point:
        key = unknowns[:COUNT].tobytes()
        if key not in cache:
            cache.clear()
            cache[key] = problem.at(unknowns[:COUNT])
        return cache[key]

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
    low, high = limits.lb.copy(), limits.ub.copy()
    low[0], high[0] = start[0] - _GAIN_RANGE, start[0] + _GAIN_RANGE
    with np.errstate(all="ignore"):
        point = problem.at(start)
        first = [float(np.max(aims(point)[0])), max(0.0, float(np.max(point.excess[~free], initial=0.0)))]
        result = optimize.minimize(
            lambda unknowns: float(cost @ unknowns),
            np.append(start, first),
            jac=lambda unknowns: cost,
            bounds=optimize.Bounds(low, high),
            constraints=[{"type": "ineq", "fun": rooms, "jac": slopes}],
            method="SLSQP",
            options={"maxiter": 80, "ftol": 1e-3},
        )
    if not np.all(np.isfinite(result.x)):
        return None
    return Solution(result.x[:COUNT], float(result.x[COUNT]), float(result.x[COUNT + 1]))


def is_sound(feedback: SampledSystem, family: Sequence[Member], must_bear_less: bool = True) -> bool:
    """Tell whether the loop is stable on every plant and, where it must bear less, at lower gains too: not
    conditionally stable."""
    for member in family:
        for factor in WEAKER if must_bear_less else WEAKER[:1]:
            weaker = SampledSystem(feedback.zeros, feedback.poles, feedback.gain * factor, feedback.rate_hz)
            if not FeedbackLoop(weaker, member.sampled).is_stable:
                return False
    return True
