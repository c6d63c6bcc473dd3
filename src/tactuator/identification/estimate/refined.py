"""The refined estimate: output error with a noise model, in continuous time, exact for the hold.

The squared innovation is minimised over plant, dead time and friction, with an autoregressive model of the noise: with
that model the estimate is unbiased in closed loop too (prediction error method: Ljung, System Identification, 1999,
sections 8.4 and 13.4), and there is nothing of the noise in its regressors, as there is in least squares.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.identification.estimate.covariance import robust_covariance
from tactuator.identification.estimate.descent import Minimum, descend
from tactuator.identification.estimate.friction import Friction, FrictionSearch, certain
from tactuator.identification.estimate.loops import dahl_state
from tactuator.identification.estimate.prediction import Prediction, Problem, predict
from tactuator.identification.estimate.states import Hold
from tactuator.identification.estimate.structure import RationalModel, Structure
from tactuator.identification.evidence.hum_lines import find_lines, line_columns
from tactuator.identification.evidence.residuals import ResidualTests, check_residual
from tactuator.identification.evidence.whitening import apply_filter, whitening_filter


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of a record. command, position: (n,), at rate_hz; hold: what the command does between samples."""

    command: FloatArray
    position: FloatArray
    rate_hz: float
    hold: Hold = "zero-order"


@dataclass(frozen=True, eq=False)
class Disturbance:
    """The part that is fitted beside the plant: lines (hertz), friction's presliding distance and path, the noise's
    whitener.
    """

    lines_hz: FloatArray
    presliding: float = 0.0
    path: FloatArray | None = None
    whitener: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Fit:
    """A minimum and what it is a minimum of."""

    structure: Structure
    model: RationalModel
    coulomb: float
    minimum: Minimum
    problem: Problem
    disturbance: Disturbance

    @property
    def cost(self) -> float:
        """Return the sum of squared innovations."""
        return self.minimum.prediction.cost


@dataclass(frozen=True, eq=False)
class RefinedEstimate:
    """The fit with its covariance (of theta, without friction), tests, friction and what it explains.

    simulated: the position as the plant alone gives it, with offsets and lines, (n,); fit_percent:
    100 (1 - |y - that| / |y - mean|).
    """

    fit: Fit
    covariance: FloatArray
    condition: float
    tests: ResidualTests
    friction: Friction | None
    simulated: FloatArray
    fit_percent: float


def fit_model(
    samples: Samples,
    structure: Structure,
    start: RationalModel,
    disturbance: Disturbance,
    coulomb: float = 0.0,
    *,
    most: int = 30,
) -> Fit:
    """Fit by descent from `start` with the lines, friction and whitener of `disturbance` as they are."""
    problem = build_problem(samples, start.scale_rad_s, start.delay_s, disturbance)
    theta = structure.join(_padded(start.b, structure), start.a, start.delay_s * start.scale_rad_s)
    minimum = descend(problem, structure, theta, coulomb, most=most)
    b, a, delay = structure.split(minimum.theta, problem.delay)
    model = RationalModel(b, a, start.scale_rad_s, delay / start.scale_rad_s)
    return Fit(structure, model, minimum.coulomb, minimum, problem, disturbance)


def build_problem(samples: Samples, scale: float, delay_s: float, disturbance: Disturbance) -> Problem:
    """Return the problem in scaled time with whitened signals."""
    count = samples.position.size
    fixed = line_columns(disturbance.lines_hz, samples.rate_hz, count)
    state = None
    if disturbance.path is not None:
        state = dahl_state(disturbance.path, disturbance.presliding)
    command, position, skip = samples.command, samples.position, 1
    if disturbance.whitener is not None and disturbance.whitener.size > 1:
        h = disturbance.whitener
        command, position, fixed = apply_filter(h, command), apply_filter(h, position), apply_filter(h, fixed)
        state = None if state is None else apply_filter(h, state)
        skip = h.size + 1
    rate = samples.rate_hz / scale
    return Problem(command, position, state, fixed, rate, delay_s * scale, skip, samples.hold)


def fit_with_disturbance(
    samples: Samples, structure: Structure, start: RationalModel, *, friction: bool = True, lines: bool = True
) -> Fit:
    """Fit with white noise, then lines and friction where the residual shows them, then the noise's colour."""
    fit = fit_model(samples, structure, start, Disturbance(np.zeros(0)), most=12)
    with_lines = fit
    if lines:
        found = find_lines(fit.minimum.prediction.residual, samples.command[fit.problem.skip :], samples.rate_hz)
        if found.size:
            with_lines = replace(fit, disturbance=Disturbance(found))
    rubbed = add_friction(samples, with_lines) if friction else with_lines
    if rubbed is not fit and rubbed is with_lines:
        rubbed = fit_model(samples, structure, fit.model, with_lines.disturbance)
    coloured = colour(samples, rubbed)
    if coloured.disturbance.path is not None and not _friction_stands(coloured):
        bare = replace(coloured.disturbance, path=None, presliding=0.0)
        return colour(samples, fit_model(samples, structure, coloured.model, bare))
    return coloured


def _friction_stands(fit: Fit) -> bool:
    """Tell whether the Coulomb level is still certain after the noise has got its colour: five standard errors."""
    jacobian = fit.minimum.prediction.jacobian
    size = np.linalg.norm(jacobian, axis=0)
    inverse = np.linalg.pinv(jacobian.T @ jacobian / np.outer(size, size), rcond=1e-12)
    variance = inverse[-1, -1] / size[-1] ** 2 * fit.cost / jacobian.shape[0]
    return fit.coulomb > 5.0 * float(np.sqrt(variance))


def add_friction(samples: Samples, fit: Fit) -> Fit:
    """Return the fit with friction along its own noise-free path, if friction is certain; two rounds, as the path
    changes.

    Without, it is the very fit that was given.
    """
    for last in (False, True):
        path = clean_path(samples, fit)
        motion, noise = float(np.std(path)), float(np.sqrt(fit.cost / samples.position.size))
        if motion == 0.0:
            return fit
        bare = build_problem(samples, fit.model.scale_rad_s, fit.model.delay_s, replace(fit.disturbance, path=None))
        search = FrictionSearch(bare, fit.structure, fit.minimum, path)
        if last:
            around = fit.disturbance.presliding
            presliding, _, level = search.best(around / 1.25, around * 1.25, 3, refinements=1)
        else:
            low = min(max(1e-4 * motion, 1e-3 * noise), 0.1 * motion)
            presliding, gain, level = search.best(low, motion, 5, refinements=0)
            if not certain(4.0 * gain, search.cost, samples.position.size):
                return fit
            presliding, gain, level = search.best(low, motion, 5, refinements=3)
            if not certain(gain, search.cost, samples.position.size):
                return fit
        changed = replace(fit.disturbance, presliding=presliding, path=path)
        fit = fit_model(samples, fit.structure, fit.model, changed, level, most=30 if last else 2)
    return fit


def plain_prediction(samples: Samples, fit: Fit) -> tuple[Prediction, Problem]:
    """Return the fit's prediction of the record as it is, not whitened."""
    plain = build_problem(samples, fit.model.scale_rad_s, fit.model.delay_s, replace(fit.disturbance, whitener=None))
    return predict(plain, fit.structure, fit.minimum.theta, fit.coulomb, derivatives=False), plain


def clean_path(samples: Samples, fit: Fit) -> FloatArray:
    """Return the position without noise and lines, as the fit sees it, (n,)."""
    prediction, plain = plain_prediction(samples, fit)
    path = samples.position.copy()
    path[plain.skip :] -= prediction.residual
    path[: plain.skip] = path[plain.skip]
    if fit.disturbance.lines_hz.size:
        # the plant's output hardly has power at a line, so that a fit of the difference is enough
        columns = plain.fixed
        level = np.linalg.lstsq(columns.T @ columns, columns.T @ (samples.position - prediction.output), rcond=None)[0]
        path -= columns[:, 1:] @ level[1:]
    return path


def colour(samples: Samples, fit: Fit, rounds: int = 2) -> Fit:
    """Refit with the noise's colour taken away, until the colour stays."""
    for _ in range(rounds):
        residual = _plain_residual(samples, fit)
        whitener = whitening_filter(residual)
        before = fit.disturbance.whitener
        if whitener.size == 1 and before is None:
            return fit
        if before is not None and before.size == whitener.size and np.allclose(before, whitener, atol=3e-3):
            return fit
        fit = fit_model(samples, fit.structure, fit.model, replace(fit.disturbance, whitener=whitener), fit.coulomb)
    return fit


def _plain_residual(samples: Samples, fit: Fit) -> FloatArray:
    if fit.disturbance.whitener is None:
        return fit.minimum.prediction.residual
    return plain_prediction(samples, fit)[0].residual


def fit_tests(samples: Samples, fit: Fit) -> ResidualTests:
    """Return the tests of a fit's innovations."""
    prediction = fit.minimum.prediction
    command = fit.problem.command[fit.problem.skip :]
    return check_residual(prediction.residual, command, prediction.jacobian, samples.rate_hz)


def judge(samples: Samples, fit: Fit, tests: ResidualTests) -> RefinedEstimate:
    """Return the covariance, friction and fit of a finished fit that passed or failed `tests`."""
    prediction = fit.minimum.prediction
    residual = _plain_residual(samples, fit)
    past = None
    whitener = fit.disturbance.whitener
    if tests.feedback and whitener is not None and whitener.size > 1:
        past = _past(residual[-prediction.residual.size :], whitener.size - 1)
    covariance = robust_covariance(prediction.jacobian, prediction.residual, past)
    p = fit.structure.count
    friction = None
    if fit.disturbance.path is not None and fit.coulomb > 0.0:
        half_width = 1.96 * float(np.sqrt(covariance[p, p]))
        if fit.coulomb > 2.0 * half_width:
            friction = Friction(fit.coulomb, half_width, fit.disturbance.presliding)
    size = np.linalg.norm(prediction.jacobian, axis=0)
    size[size == 0.0] = 1.0
    condition = float(np.linalg.cond(prediction.jacobian.T @ prediction.jacobian / np.outer(size, size)))
    measured = samples.position[-residual.size :]
    spread = float(np.linalg.norm(measured - measured.mean()))
    percent = 100.0 * (1.0 - float(np.linalg.norm(residual)) / spread) if spread > 0.0 else 0.0
    return RefinedEstimate(fit, covariance[:p, :p], condition, tests, friction, measured - residual, percent)


def _past(residual: FloatArray, lags: int) -> FloatArray:
    columns = np.zeros((residual.size, lags))
    for lag in range(1, lags + 1):
        columns[lag:, lag - 1] = residual[:-lag]
    return columns


def _padded(b: FloatArray, structure: Structure) -> FloatArray:
    made = np.zeros(structure.zeros + 1)
    made[: min(b.size, made.size)] = b[: made.size]
    return made
