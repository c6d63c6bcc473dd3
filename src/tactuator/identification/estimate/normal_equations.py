"""Normal equations of a prediction, gathered block by block: a step of the descent without ever holding its columns.

The blocks stay in the processor's cache; what is fitted beside is taken out at the end by a Schur complement.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.identification.estimate.prediction import Model, Problem, combination
from tactuator.identification.estimate.structure import Structure

_BLOCK = 4096
_RUNAWAY = 1e12
"""Mean squared residual, where the position has unit size, of a model that runs away."""
_CANCELLED = 1e-13
"""Share of a squared column that rounding leaves of it when all of it is taken away."""


@dataclass(frozen=True, eq=False)
class Normal:
    """Sums over a record: gram (p, p), gradient (p,) and cost with everything linear projected out; level (k,): what
    was fitted beside.
    """

    gram: FloatArray
    gradient: FloatArray
    cost: float
    level: FloatArray


def normal_equations(
    problem: Problem, structure: Structure, theta: FloatArray, coulomb: float, level: FloatArray | None
) -> Normal:
    """Return the normal equations of `predict`'s jacobian and residual at theta; `level` of the step before (None:
    zero) serves the derivatives by the denominator of what is fitted beside.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        gathered, fixed = _gather(Model(problem, structure, theta, coulomb), level)
        if not np.all(np.isfinite(gathered)):
            return Normal(np.zeros((0, 0)), np.zeros(0), np.inf, np.zeros(fixed))
        size = np.sqrt(np.diag(gathered)[:fixed])
        size = np.where(size > 0.0, size, 1.0)
        inverse = np.linalg.pinv(gathered[:fixed, :fixed] / np.outer(size, size), rcond=1e-11, hermitian=True)
        solution = (inverse @ (gathered[:fixed, fixed:] / size[:, None])) / size[:, None]
        left = gathered[fixed:, fixed:] - gathered[:fixed, fixed:].T @ solution
    whole = np.diag(gathered)[fixed:]
    gram, gradient, cost = left[:-1, :-1], left[:-1, -1], float(left[-1, -1])
    if not _CANCELLED * whole[-1] < cost or whole[-1] > _RUNAWAY * problem.position.size:
        # all digits went into what is fitted beside: a model that runs away explains nothing
        return Normal(gram, gradient, np.inf, solution[:, -1])
    lost = np.diag(gram) <= _CANCELLED * whole[:-1]
    gram = np.where(lost[:, None] | lost, 0.0, gram)
    return Normal(gram, np.where(lost, 0.0, gradient), cost, solution[:, -1])


def _gather(model: Model, level: FloatArray | None) -> tuple[FloatArray, int]:
    """Return the Gram matrix of [fitted beside | derivatives | residual], and how many are fitted beside."""
    problem, n = model.problem, model.order
    beside = n + 1 + problem.fixed.shape[1]
    count = model.structure.count + int(model.resisting is not None)
    numerator = np.polymul(model.b, model.monic)
    main, main_direct = combination([numerator, *model.slopes()], model.square)
    pulses, steadies = _beside(model, level)
    total = np.zeros((beside + count + 1, beside + count + 1))
    block = np.zeros((_BLOCK, beside + count + 1))
    first = beside + model.structure.numerator_count
    for start in range(0, problem.position.size, _BLOCK):
        rows = slice(start, min(start + _BLOCK, problem.position.size))
        part = block[: rows.stop - start]
        part[:, : n + 1] = 0.0
        part[:, n + 1 : beside] = problem.fixed[rows]
        states, acting = model.pushing.states[rows], model.pushing.acting[rows]
        if model.resisting is not None:
            states = states - model.coulomb * model.resisting.states[rows]
            acting = acting - model.coulomb * model.resisting.acting[rows]
            friction = model.resisting.states[rows] @ main[:, 0] + main_direct[0] * model.resisting.acting[rows]
            part[:, beside + count - 1] = -friction
        made = states @ main
        if np.any(main_direct):
            made += acting[:, None] * main_direct
        part[:, -1] = problem.position[rows] - made[:, 0]
        part[:, beside : beside + model.structure.count] = made[:, 1:]
        for driven, weights, where in ((model.pulse, pulses, slice(0, n)), (model.steady, steadies, slice(n, n + 1))):
            some = driven.states[rows]
            if some.size:
                extra = some @ weights[0] + driven.acting[rows][:, None] * weights[1]
                width = where.stop - where.start
                part[: some.shape[0], where] = extra[:, :width]
                part[: some.shape[0], first : first + n] -= extra[:, width:]
        kept = part[max(problem.skip - start, 0) :]
        total += kept.T @ kept
    return total, beside


def _beside(
    model: Model, level: FloatArray | None
) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    """Return the combinations of the pulse's and the constant's states: the columns fitted beside, then their slopes by
    a.
    """
    n = model.order
    known = np.zeros(n + 1) if level is None else level[: n + 1]
    powers = [np.append(1.0, np.zeros(i)) for i in range(n)]
    free = [np.polymul(power, model.monic) for power in powers]
    free_slopes = [np.polymul(known[:n][::-1], power) for power in powers]
    steady_slopes = [known[n] * power for power in powers]
    return combination(free + free_slopes, model.square), combination([model.monic, *steady_slopes], model.square)
