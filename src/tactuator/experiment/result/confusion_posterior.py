"""Posterior of information transfer, given a confusion matrix, from which its interval is taken.

A row of the matrix is a share of errors e_i and a spread of them over the wrong responses. Both are learnt from all
rows together. e_i is beta, with its two parameters on a grid. In the spread, the rate of each confusion is drawn from
one of two gammas, an ordinary and a habitual one, whose shapes and shares are on a grid; with counts that are Poisson
given the rate, each cell is a mixture of two negative binomials, in closed form. The prior of the grid is flat in the
entropy of the spread that a point of it implies (after Nemenman, Shafee & Bialek 2002); flat in the parameters
themselves, it would be all but certain of the entropy before any data.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaln, gammaln

from tactuator.arrays import FloatArray

_TINY = 1e-300
_CHUNK_DRAWS = 64


def information_draws(counts: NDArray[np.int64], draws: int, rng: np.random.Generator) -> FloatArray:
    """Draw the information transfer in bits, (draws,), from its posterior. counts: square, every row presented."""
    stimuli = counts.shape[0]
    presented = counts.sum(axis=1)
    wrong = presented - np.diag(counts)
    off = ~np.eye(stimuli, dtype=bool)
    confused = counts[off].reshape(stimuli, stimuli - 1).astype(np.float64)
    errors = _error_draws(np.diag(counts).astype(np.float64), wrong.astype(np.float64), draws, rng)
    spread = _SpreadPosterior(confused, wrong.astype(np.float64))
    found = np.empty(draws)
    for first in range(0, draws, _CHUNK_DRAWS):
        some = errors[first : first + _CHUNK_DRAWS]
        chances = np.zeros((some.shape[0], stimuli, stimuli))
        chances[:, off] = (some[..., None] * spread.draw(some.shape[0], rng)).reshape(some.shape[0], -1)
        chances[:, np.arange(stimuli), np.arange(stimuli)] = 1.0 - some
        found[first : first + _CHUNK_DRAWS] = information_of(chances, presented / presented.sum())
    return found


def information_of(chances: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the information transfer, bits, of known response probabilities (..., stimuli, responses).

    weights: probability of each stimulus, (stimuli,).
    """
    joint = chances * weights[:, None]
    responses = joint.sum(axis=-2, keepdims=True)
    ratio = np.where(joint > 0.0, chances / np.maximum(responses, _TINY), 1.0)
    return np.asarray(np.sum(joint * np.log2(np.maximum(ratio, _TINY)), axis=(-2, -1)))


def _error_draws(right: FloatArray, wrong: FloatArray, draws: int, rng: np.random.Generator) -> FloatArray:
    """Draw the error rates of every stimulus, (draws, stimuli).

    They are beta with mean and weight on a grid that is even a priori.
    """
    mean = np.linspace(0.002, 0.998, 100)[:, None]
    weight = np.geomspace(1.0, 2000.0, 20)
    first, second = (mean * weight).ravel(), ((1.0 - mean) * weight).ravel()
    fit = betaln(first[:, None] + wrong, second[:, None] + right) - betaln(first, second)[:, None]
    log_posterior = fit.sum(axis=1)
    posterior = np.exp(log_posterior - log_posterior.max())
    picked = rng.choice(first.size, draws, p=posterior / posterior.sum())
    return np.asarray(rng.beta(first[picked, None] + wrong, second[picked, None] + right))


@dataclass(frozen=True, eq=False)
class _Spreads:
    """Grid of spreads of errors over `cells` responses; arrays (grid,).

    habitual: probability that a cell is habitual. ordinary_*, habitual_*: shape and mean of the gammas, such that the
    rates of a row sum to 1 on average. prior: probability of each point of the grid.
    """

    ordinary_shape: FloatArray
    ordinary_mean: FloatArray
    habitual: FloatArray
    habitual_shape: FloatArray
    habitual_mean: FloatArray
    prior: FloatArray


@lru_cache(maxsize=16)
def _spreads(cells: int) -> _Spreads:
    rows = []
    for first in (0.03, 0.1, 0.3, 1.0, 3.0, 30.0, 300.0):
        rows.append((first, 1.0 / cells, 0.0, 1.0, 1.0))
        for share in (0.15, 0.35, 0.55, 0.75, 0.9, 0.98):
            for number in (0.5, 1.0, 2.0, 4.0):
                for habitual_shape in (2.0, 20.0):
                    chance = number / cells
                    if chance < 1.0:
                        mean = (1.0 - share) / (cells * (1.0 - chance))
                        rows.append((first, mean, chance, habitual_shape, share / number))
    grid = np.array(rows).T
    ordinary_shape, ordinary_mean, habitual, shape, mean = grid
    return _Spreads(ordinary_shape, ordinary_mean, habitual, shape, mean, _flat_in_entropy(grid, cells))


def _flat_in_entropy(grid: FloatArray, cells: int) -> FloatArray:
    """Return the prior of each point of the grid, (grid,): even over eighths of the largest entropy of a spread."""
    if cells == 1:
        return np.full(grid.shape[1], 1.0 / grid.shape[1])
    rng = np.random.default_rng(cells)
    shape = (24, cells, grid.shape[1])
    habitual = rng.random(shape) < grid[2]
    rates = rng.standard_gamma(np.where(habitual, grid[3], grid[0]), shape)
    rates = np.maximum(rates * np.where(habitual, grid[4] / grid[3], grid[1] / grid[0]), _TINY)
    rates /= rates.sum(axis=1, keepdims=True)
    entropy = -np.sum(rates * np.log2(rates), axis=1).mean(axis=0) / np.log2(cells)
    place = np.minimum((8.0 * entropy).astype(np.int64), 7)
    prior = 1.0 / np.bincount(place, minlength=8)[place]
    return np.asarray(prior / prior.sum())


class _SpreadPosterior:
    """Posterior of the spread of errors.

    confused: counts of the wrong responses, (stimuli, stimuli - 1). wrong: their sums, (stimuli,).
    """

    def __init__(self, confused: FloatArray, wrong: FloatArray) -> None:
        self._grid, self._counts = _spreads(confused.shape[1]), confused.ravel()
        self._exposure = np.repeat(wrong, confused.shape[1])
        self._shape = confused.shape
        pairs = np.stack([self._counts, self._exposure])
        kinds, self._kind, often = np.unique(pairs, axis=1, return_inverse=True, return_counts=True)
        self._kind = self._kind.ravel()
        grid = self._grid
        seen = kinds[1] > 0.0
        exposure = np.maximum(kinds[1], 1e-9)
        with np.errstate(divide="ignore"):
            ordinary = _log_negative_binomial(kinds[0], grid.ordinary_shape, grid.ordinary_mean, exposure)
            ordinary = ordinary + np.log1p(-grid.habitual)[:, None]
            habitual = _log_negative_binomial(kinds[0], grid.habitual_shape, grid.habitual_mean, exposure)
            habitual = habitual + np.log(grid.habitual)[:, None]
        either = np.logaddexp(ordinary, habitual)
        log_posterior = np.sum(either * (often * seen), axis=1) + np.log(grid.prior)
        posterior = np.exp(log_posterior - log_posterior.max())
        self._posterior = posterior / posterior.sum()
        self._habitual = np.exp(habitual - either)

    def draw(self, draws: int, rng: np.random.Generator) -> FloatArray:
        """Draw shares of the wrong responses among the errors, (draws, stimuli, stimuli - 1); rows sum to 1."""
        grid = self._grid
        picked = rng.choice(self._posterior.size, draws, p=self._posterior)
        habitual = rng.random((draws, self._counts.size)) < self._habitual[picked][:, self._kind]
        shape = np.where(habitual, grid.habitual_shape[picked, None], grid.ordinary_shape[picked, None])
        mean = np.where(habitual, grid.habitual_mean[picked, None], grid.ordinary_mean[picked, None])
        rates = rng.standard_gamma(shape + self._counts) / (shape / mean + self._exposure)
        rates = np.maximum(rates, _TINY).reshape(draws, *self._shape)
        return np.asarray(rates / rates.sum(axis=2, keepdims=True))


def _log_negative_binomial(count: FloatArray, shape: FloatArray, mean: FloatArray, exposure: FloatArray) -> FloatArray:
    """Return the log probability, (grid, n), of counts (n,) whose rates are gamma of that shape and mean (grid,).

    exposure: of each count, (n,).
    """
    expected = mean[:, None] * exposure
    share = expected / (expected + shape[:, None])
    ways = gammaln(count + shape[:, None]) - gammaln(shape)[:, None] - gammaln(count + 1.0)
    return np.asarray(ways + count * np.log(share) + shape[:, None] * np.log1p(-share))
