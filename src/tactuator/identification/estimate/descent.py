"""Levenberg and Marquardt's descent on the prediction's squared error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.identification.estimate.normal_equations import Normal, normal_equations
from tactuator.identification.estimate.prediction import Prediction, Problem, predict
from tactuator.identification.estimate.structure import Structure


@dataclass(frozen=True)
class Minimum:
    """Parameters, Coulomb level, and the prediction there; converged: the last step was small."""

    theta: FloatArray
    coulomb: float
    prediction: Prediction
    converged: bool


def descend(
    problem: Problem,
    structure: Structure,
    theta: FloatArray,
    coulomb: float = 0.0,
    *,
    most: int = 30,
    tolerance: float = 1e-5,
) -> Minimum:
    """Go from theta downhill until a step changes every parameter by less than `tolerance` of its own standard error or
    of itself, or `most` steps.
    """
    with_friction = problem.friction is not None
    now = normal_equations(problem, structure, theta, coulomb, None)
    damping, converged = 1e-3, False
    for _ in range(most):
        if not np.isfinite(now.cost):
            break
        candidate = _downhill(problem, structure, theta, coulomb, now, damping)
        if candidate is None:
            converged = True
            break
        count = max(problem.position.size - problem.skip - now.gradient.size, 1)
        spread = np.sqrt(np.maximum(np.diag(_inverse(now.gram)), 0.0) * now.cost / count)
        gain = (now.cost - candidate.normal.cost) / max(now.cost, 1e-300)
        theta, coulomb, now = candidate.theta, candidate.coulomb, candidate.normal
        damping = max(candidate.damping / 10.0, 1e-9)
        size = np.abs(np.append(theta, coulomb) if with_friction else theta)
        if np.all(np.abs(candidate.step) <= np.maximum(0.03 * spread, tolerance * size)) or abs(gain) < 1e-9:
            converged = True
            break
    return Minimum(theta, coulomb, predict(problem, structure, theta, coulomb), converged)


@dataclass(frozen=True, eq=False)
class _Candidate:
    theta: FloatArray
    coulomb: float
    step: FloatArray
    normal: Normal
    damping: float


def _downhill(
    problem: Problem, structure: Structure, theta: FloatArray, coulomb: float, now: Normal, damping: float
) -> _Candidate | None:
    """Return a step that does not raise the cost, more and more careful; None where there is none."""
    for _ in range(12):
        step = _step(now.gram, now.gradient, damping)
        moved, level = _moved(structure, theta, coulomb, step, problem.friction is not None)
        ahead = normal_equations(problem, structure, moved, level, now.level)
        if ahead.cost <= now.cost * (1.0 + 1e-10):
            return _Candidate(moved, level, step, ahead, damping)
        damping = max(damping * 8.0, 1e-4)
    return None


def _step(gram: FloatArray, gradient: FloatArray, damping: float) -> FloatArray:
    size = _sizes(gram)
    scaled = gram / np.outer(size, size) + damping * np.eye(size.size)
    return np.asarray(np.linalg.lstsq(scaled, gradient / size, rcond=1e-13)[0] / size)


def _inverse(gram: FloatArray) -> FloatArray:
    size = _sizes(gram)
    return np.asarray(np.linalg.pinv(gram / np.outer(size, size), rcond=1e-13) / np.outer(size, size))


def _sizes(gram: FloatArray) -> FloatArray:
    """Return the root of the diagonal; 1 for a parameter of which the record says nothing."""
    diagonal = np.diag(gram)
    return np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))


def _moved(
    structure: Structure, theta: FloatArray, coulomb: float, step: FloatArray, with_friction: bool
) -> tuple[FloatArray, float]:
    level = coulomb + float(step[-1]) if with_friction else coulomb
    candidate = theta + (step[:-1] if with_friction else step)
    if structure.dead_time:
        candidate[-1] = max(candidate[-1], 0.0)
    return candidate, max(level, 0.0)
