"""Refinement of Gaussian beliefs about a curve from all trials together, by expectation propagation.

As trials lie at a few points, the likelihood of all of them is a product of one function for each point, kept here on a
grid of levels. Each is replaced by a Gaussian site, adjusted in turn to the marginal that the others leave (Minka 2001;
Rasmussen & Williams 2006, section 3.6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.experiment.procedure.procedure import Answering

_LEVEL_DB = np.arange(-48.0, 72.0, 0.75)
"""Thresholds at which likelihoods are kept: a sum at this step is exact to 1 % for a spread of 0.4 dB or more."""
_MIDDLE_DB = float(_LEVEL_DB.mean())
_ABOUT_DB = (_LEVEL_DB - _MIDDLE_DB).astype(np.float32)
_POWERS = np.stack([np.ones_like(_ABOUT_DB), _ABOUT_DB, _ABOUT_DB**2], axis=1)
"""Single precision is exact to 0.01 dB here, and takes half the time."""

_SWEEPS = 5
_DAMPING = 0.6
_LEAST_PRECISION = 1e-8
_LEAST_CAVITY_PRECISION = 1e-3
_ENOUGH_DB = 0.1
"""Movement of all means below which no further sweep is made."""
_SETTLED_DB = 1.0
"""Movement of a mean in the last sweep above which a component is not taken from the refinement."""


class PointLikelihoods:
    """Log likelihood of all trials at each point for each threshold on a grid, (runs, answerings, points, levels).

    The psychometric functions are in the order of answering.pairs.
    """

    def __init__(self, answering: Answering, runs: int, points: int) -> None:
        self._answering = answering
        self._slope, self._lapse = (np.array(column)[:, None] for column in answering.pairs)
        size = (runs, self._slope.size, points, _LEVEL_DB.size)
        self.log_likelihood: NDArray[np.float32] = np.zeros(size, dtype=np.float32)
        self.seen: NDArray[np.bool_] = np.zeros((runs, points), dtype=bool)

    def learn(self, point: NDArray[np.intp], level_db_sl: FloatArray, correct: NDArray[np.bool_]) -> None:
        """Learn the outcome of one trial of every run; arguments (runs,)."""
        runs = np.arange(point.size)
        psi = self._answering.psi(level_db_sl[:, None, None] - _LEVEL_DB, self._slope, self._lapse)
        self.log_likelihood[runs, :, point] += np.log(np.where(correct[:, None, None], psi, 1.0 - psi))
        self.seen[runs, point] = True

    def at(self, threshold_db_sl: FloatArray) -> FloatArray:
        """Return each point's log likelihood, (runs, answerings, points), for thresholds (runs, points)."""
        place = np.rint((threshold_db_sl - _LEVEL_DB[0]) / (_LEVEL_DB[1] - _LEVEL_DB[0])).astype(np.intp)
        place = np.clip(place, 0, _LEVEL_DB.size - 1)[:, None, :, None]
        return np.take_along_axis(self.log_likelihood, place, axis=3)[..., 0].astype(np.float64)


def log_ratio(either: FloatArray, other: FloatArray, share: FloatArray) -> FloatArray:
    """Return by how much the first log likelihood exceeds the other, psychometric functions integrated out.

    either, other: (runs, answerings, n). share: of every function, (runs, answerings). The result is (runs, n).
    """
    first, second = (scipy.special.logsumexp(log, axis=1, b=share[..., None]) for log in (either, other))
    return np.asarray(first - second)


@dataclass(frozen=True)
class Sites:
    """Gaussian sites in place of the likelihoods, (n, points) each: exp(shift g - precision g^2 / 2), g in dB SL."""

    precision: FloatArray
    shift: FloatArray


@dataclass(frozen=True)
class Refined:
    """Refined components, (n, ...). log_evidence: of all trials, (n,). settled: those that may be used, (n,)."""

    mean: FloatArray
    covariance: FloatArray
    log_evidence: FloatArray
    sites: Sites
    settled: NDArray[np.bool_]


def refine(
    prior_mean: FloatArray,
    prior_covariance: FloatArray,
    log_likelihood: NDArray[np.float32],
    seen: NDArray[np.bool_],
    sites: Sites,
) -> Refined:
    """Refine n components from their sites, and return them with their evidence.

    prior_mean: (n, points). prior_covariance: (n, points, points). log_likelihood: (n, points, levels) of
    PointLikelihoods. seen: (n, points), points that had trials. sites: where to begin; zeros where nothing is known.
    """
    mean, covariance, log_root = _posterior(prior_mean, prior_covariance, sites)
    moved = np.full(len(mean), np.inf)
    for _ in range(_SWEEPS):
        cavity_mean, cavity_variance = _cavity(mean, covariance, sites)
        _, tilted_mean, tilted_variance = _tilted(log_likelihood, cavity_mean, cavity_variance)
        precision = np.maximum(1.0 / tilted_variance - 1.0 / cavity_variance, _LEAST_PRECISION)
        shift = tilted_mean * (precision + 1.0 / cavity_variance) - cavity_mean / cavity_variance
        sites = Sites(
            _DAMPING * np.where(seen, precision, 0.0) + (1.0 - _DAMPING) * sites.precision,
            _DAMPING * np.where(seen, shift, 0.0) + (1.0 - _DAMPING) * sites.shift,
        )
        before = mean
        mean, covariance, log_root = _posterior(prior_mean, prior_covariance, sites)
        moved = np.abs(mean - before).max(axis=1)
        if moved.max() < _ENOUGH_DB:
            break
    cavity_mean, cavity_variance = _cavity(mean, covariance, sites)
    log_mass, _, _ = _tilted(log_likelihood, cavity_mean, cavity_variance)
    of_sites = _log_mass_of_sites(cavity_mean, cavity_variance, sites)
    along = sites.shift - sites.precision * prior_mean
    quadratic = np.einsum("np,npq,nq->n", along, covariance, along)
    linear = (sites.shift * prior_mean - 0.5 * sites.precision * prior_mean**2).sum(axis=1)
    evidence = np.where(seen, log_mass - of_sites, 0.0).sum(axis=1) + linear + 0.5 * quadratic - log_root
    settled = (moved < _SETTLED_DB) & np.isfinite(evidence)
    return Refined(mean, covariance, evidence, sites, settled)


def _posterior(
    prior_mean: FloatArray, prior_covariance: FloatArray, sites: Sites
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean, covariance and half the log determinant of 1 + K T, for sites of precision T >= 0."""
    root = np.sqrt(sites.precision)
    scaled = prior_covariance * root[:, None, :]
    lower = np.linalg.cholesky(np.eye(root.shape[1]) + root[:, :, None] * scaled)
    half = np.linalg.solve(lower, scaled.transpose(0, 2, 1))
    covariance = prior_covariance - half.transpose(0, 2, 1) @ half
    shift = sites.shift - sites.precision * prior_mean
    mean = prior_mean + np.einsum("npq,nq->np", covariance, shift)
    return mean, covariance, np.log(np.einsum("npp->np", lower)).sum(axis=1)


def _cavity(mean: FloatArray, covariance: FloatArray, sites: Sites) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of each point without its own site, (n, points) each."""
    alone = 1.0 / np.einsum("npp->np", covariance)
    variance = 1.0 / np.maximum(alone - sites.precision, _LEAST_CAVITY_PRECISION)
    return variance * (mean * alone - sites.shift), variance


def _tilted(
    log_likelihood: NDArray[np.float32], mean: FloatArray, variance: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return log mass, mean and variance of likelihood times Gaussian at each point, (n, points) each."""
    density = _ABOUT_DB - (mean - _MIDDLE_DB).astype(np.float32)[..., None]
    density *= density
    density *= (-0.5 / variance).astype(np.float32)[..., None]
    density += log_likelihood
    highest = density.max(axis=-1, keepdims=True)
    density -= highest
    moments = (np.exp(density, out=density) @ _POWERS).astype(np.float64)
    mass, first, second = moments[..., 0], moments[..., 1] / moments[..., 0], moments[..., 2] / moments[..., 0]
    step = _LEVEL_DB[1] - _LEVEL_DB[0]
    log_mass = highest[..., 0] + np.log(mass * step) - 0.5 * np.log(2.0 * np.pi * variance)
    return log_mass, first + _MIDDLE_DB, np.maximum(second - first**2, 0.02)


def _log_mass_of_sites(mean: FloatArray, variance: FloatArray, sites: Sites) -> FloatArray:
    """Return the log of the integral of each site times the Gaussian of its cavity, (n, points)."""
    tau, nu = sites.precision, sites.shift
    spread = 1.0 + tau * variance
    return np.asarray(-0.5 * np.log(spread) + (nu**2 * variance + 2.0 * nu * mean - tau * mean**2) / (2.0 * spread))
