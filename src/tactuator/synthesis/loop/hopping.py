"""Search beyond the nearest local optimum: from the nearest misses, by steps that do not depend on what is asked.

A local solution that misses the limits says little. The problem has dozens of local optima a few tenths of a decibel
apart, and which of them a start leads to changes with every limit, so that the same starts can find a loop under tight
limits and none under looser ones. Here each of the best local solutions is left by a fixed sequence of steps and solved
again, and what comes out closer to the limits takes its place (monotonic basin hopping: Leary, Journal of Global
Optimization 18, 2000).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy import optimize, special
from scipy.stats import qmc

from tactuator.arrays import FloatArray
from tactuator.synthesis.family import Member
from tactuator.synthesis.loop.problem import LoopProblem
from tactuator.synthesis.loop.solution import Solution, is_sound, solve
from tactuator.synthesis.loop.structure import COUNT

_HOPS = 128
_SIZES = (0.3, 0.7)
"""Standard deviations of the steps, in turn: natural logarithms of gain, frequencies and dampings."""
_POOL_MAX = 6
_SAME_DB = 1e-3


def hops(
    problem: LoopProblem,
    starts: Sequence[FloatArray],
    limits: optimize.Bounds,
    family: Sequence[Member],
    must_bear_less: bool,
) -> Iterator[Solution]:
    """Yield stable local solutions, those of `starts` first: each the solution of a step away from one that was yielded
    before, the nearer to the limits the more often. The sequence ends after 128 steps; whoever is content ends it
    before.
    """
    pool: list[Solution] = []
    low, high = limits.lb[:COUNT], limits.ub[:COUNT]
    for begin in _begins(starts, pool):
        solution = solve(problem, np.clip(begin, low, high), limits)
        if solution is None:
            continue
        if is_sound(problem.structure.system(solution.parameters), family, must_bear_less):
            if all(abs(solution.excess_db - known.excess_db) > _SAME_DB for known in pool):
                pool[:] = sorted([*pool, solution], key=lambda one: one.excess_db)[:_POOL_MAX]
            yield solution


def _begins(starts: Sequence[FloatArray], pool: Sequence[Solution]) -> Iterator[FloatArray]:
    """Yield the starts, then steps away from members of `pool` as it then is; from the starts while it is empty."""
    yield from starts
    for index, (share, step) in enumerate(_steps()):
        left = [one.parameters for one in pool] or list(starts)
        origin = left[min(int(-np.log2(share)), len(left) - 1)]
        yield origin + _SIZES[index % len(_SIZES)] * step


def _steps() -> Iterator[tuple[float, FloatArray]]:
    """Yield a number in (0, 1) that chooses where to step from, and a normal step, shape (COUNT,): Sobol's points."""
    sequence = qmc.Sobol(COUNT + 1, scramble=False)
    sequence.fast_forward(1)  # the first point is zero
    for point in sequence.random(_HOPS):
        yield float(point[0]), np.asarray(special.ndtri(point[1:]))
