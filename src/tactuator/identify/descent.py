"""Levenberg and Marquardt's descent on the prediction's squared error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.identify.prediction import Prediction, Problem, predict
from tactuator.identify.structure import Structure

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Minimum:
    """Parameters, Coulomb level, and the prediction there; converged: the last step was small."""

    theta: Array
    coulomb: float
    prediction: Prediction
    converged: bool


def descend(
    problem: Problem,
    structure: Structure,
    theta: Array,
    coulomb: float = 0.0,
    *,
    most: int = 30,
    tolerance: float = 1e-5,
) -> Minimum:
    """From theta downhill until a step changes every parameter by less than `tolerance` of its own standard error
    or of itself, or `most` steps."""
    with_friction = problem.friction is not None
    now = predict(problem, structure, theta, coulomb)
    damping, converged = 1e-3, False
    for _ in range(most):
        if not np.isfinite(now.cost):
            break
        step, spread, damping_used = np.zeros(0), np.zeros(0), damping
        gram = now.jacobian.T @ now.jacobian
        gradient = now.jacobian.T @ now.residual
        accepted = False
        for _ in range(12):
            step = _step(gram, gradient, damping_used)
            trial, level = _moved(structure, theta, coulomb, step, with_friction)
            ahead = predict(problem, structure, trial, level)
            if ahead.cost <= now.cost * (1.0 + 1e-12):
                accepted = True
                break
            damping_used = max(damping_used * 8.0, 1e-4)
        if not accepted:
            converged = True
            break
        count = max(now.residual.size - problem.skip - step.size, 1)
        spread = np.sqrt(np.maximum(np.diag(_inverse(gram)), 0.0) * now.cost / count)
        gain = (now.cost - ahead.cost) / now.cost
        theta, coulomb, now = trial, level, ahead
        damping = max(damping_used / 10.0, 1e-9)
        size = np.abs(np.append(theta, coulomb) if with_friction else theta)
        if np.all(np.abs(step) <= np.maximum(0.03 * spread, tolerance * size)) or gain < 1e-9:
            converged = True
            break
    return Minimum(theta, coulomb, now, converged)


def _step(gram: Array, gradient: Array, damping: float) -> Array:
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    scaled = gram / np.outer(size, size) + damping * np.eye(size.size)
    return np.asarray(np.linalg.lstsq(scaled, gradient / size, rcond=1e-13)[0] / size)


def _inverse(gram: Array) -> Array:
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    return np.asarray(np.linalg.pinv(gram / np.outer(size, size), rcond=1e-13) / np.outer(size, size))


def _moved(structure: Structure, theta: Array, coulomb: float, step: Array, with_friction: bool) -> tuple[Array, float]:
    level = coulomb + float(step[-1]) if with_friction else coulomb
    trial = theta + (step[:-1] if with_friction else step)
    if structure.dead_time:
        trial[-1] = max(trial[-1], 0.0)
    return trial, max(level, 0.0)
