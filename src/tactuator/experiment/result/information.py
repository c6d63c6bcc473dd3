"""Information transfer: how much of what was presented is known from what was answered.

IT = sum over i, j of (n_ij / n) log2(n_ij n / (n_i n_j)), in bits a stimulus; 2^IT categories are reliably
distinguished. Counted from few trials it comes out too high, and every correction fails somewhere, so several are given
side by side.

The interval is taken from a posterior. A row of the matrix is a share of errors e_i and a spread of them over the wrong
responses. Both are learnt from all rows together. e_i is beta, with its two parameters on a grid. In the spread, the
rate of each confusion is drawn from one of two gammas, an ordinary and a habitual one, whose shapes and shares are on a
grid; with counts that are Poisson given the rate, each cell is a mixture of two negative binomials, in closed form. The
prior of the grid is flat in the entropy of the spread that a point of it implies (after Nemenman, Shafee & Bialek
2002); flat in the parameters themselves, it would be all but certain of the entropy before any data.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.words import Words, shipped_words

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
    bits = np.empty(draws)
    for first in range(0, draws, _CHUNK_DRAWS):
        some = errors[first : first + _CHUNK_DRAWS]
        chances = np.zeros((some.shape[0], stimuli, stimuli))
        chances[:, off] = (some[..., None] * spread.draw(some.shape[0], rng)).reshape(some.shape[0], -1)
        chances[:, np.arange(stimuli), np.arange(stimuli)] = 1.0 - some
        bits[first : first + _CHUNK_DRAWS] = information_of(chances, presented / presented.sum())
    return bits


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
    fit = (
        scipy.special.betaln(first[:, None] + wrong, second[:, None] + right)
        - scipy.special.betaln(first, second)[:, None]
    )
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
    ways = (
        scipy.special.gammaln(count + shape[:, None])
        - scipy.special.gammaln(shape)[:, None]
        - scipy.special.gammaln(count + 1.0)
    )
    return np.asarray(ways + count * np.log(share) + shape[:, None] * np.log1p(-share))


ESTIMATORS = ("plug_in", "miller_madow", "all_cells", "error_rule")
"""Estimators that are numbers alone. plug_in: the sum above. miller_madow: less its first-order bias, from the cells,
rows and columns that are occupied (Miller 1955). all_cells: less (k - 1)^2 / (2 n ln 2), the same bias with every cell
counted. error_rule: (1 - 2 e) log2 k, e the share of errors (Tan et al. 1999)."""

POSTERIOR = "posterior"
"""The estimate with an interval: median of the posterior of confusion_posterior."""

TRIALS_PER_CELL_MIN = 5
"""Trials for each cell below which estimates are not to be relied on: n >= 5 k^2 (Miller 1955)."""


_INTERVAL_FACTORS = (1.15, 1.15)
"""Reach of the interval, downwards and upwards, over that of the posterior: with 1, the worst of the ways to err was
covered 0.83."""
_INTERVAL_FACTORS_FEW = (1.0, 1.3)
"""The same where a stimulus has fewer trials than there are stimuli, so that the prior of the spread weighs more. With
39 stimuli of 20 trials each the truth lies above where errors gather at neighbours (0.09 of 100 runs with 1.25, 0.06
with 1.3), and below where they are even (0.04 of 200)."""


@dataclass(frozen=True)
class InformationEstimate:
    """An estimate in bits, and its interval of that confidence; None where it would not be trusted."""

    bits: float
    low_bits: float | None = None
    high_bits: float | None = None

    @property
    def categories(self) -> float:
        """Return the number of items that are distinguished without error: 2^bits."""
        return float(2.0**self.bits)


@dataclass(frozen=True)
class Reason:
    """A reason for caution: its text is that of key in the table [results] of a language, with the values put in."""

    key: str
    values: dict[str, str] = field(default_factory=dict)

    def told(self, words: Words) -> str:
        """Return the reason in these words."""
        return words(f"results.{self.key}", **self.values)


@dataclass(frozen=True, eq=False)
class Information:
    """Information transfer of a confusion matrix.

    estimates: by name, as in ESTIMATORS, and POSTERIOR. bits_per_second: by name, where the time that a stimulus takes
    is known. warning: None or one line. no_interval: None, or the reason why the estimates have no interval. reasons:
    both of these where they are there, for texts in other languages.
    """

    stimuli: int
    responses: int
    trials: int
    share_correct: float
    confidence: float
    estimates: dict[str, InformationEstimate]
    bits_per_second: dict[str, float] | None
    warning: str | None
    no_interval: str | None = None
    reasons: tuple[Reason, ...] = ()


def confusion_counts(matrix: ArrayLike) -> NDArray[np.int64]:
    """Return a confusion matrix (stimuli, responses) as whole counts, stimuli that were never presented left out.

    Raises BadInput for a matrix that is not of two dimensions, or holds anything but whole numbers of zero or more, or
    in which fewer than two stimuli were presented.
    """
    values = np.asarray(matrix, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] < 2:
        raise BadInput(f"confusion matrix has shape {values.shape}", "(stimuli, responses), two or more of each")
    if not np.all(np.isfinite(values)) or np.any(values < 0.0) or np.any(values != np.round(values)):
        raise BadInput("confusion matrix holds a number that is not a count", "0, 1, 2, ...")
    presented = values.sum(axis=1) > 0.0
    if presented.sum() < 2:
        raise BadInput(f"confusion matrix: {presented.sum()} stimuli were presented", "two or more")
    return values.astype(np.int64)


def plug_in_bits(counts: NDArray[np.int64]) -> FloatArray:
    """Return the plug-in estimate of matrices (..., stimuli, responses), shape (...)."""
    n = counts.sum(axis=(-2, -1))
    cells = _n_log_n(counts).sum(axis=(-2, -1))
    rows = _n_log_n(counts.sum(axis=-1)).sum(axis=-1)
    columns = _n_log_n(counts.sum(axis=-2)).sum(axis=-1)
    return np.asarray((cells - rows - columns + _n_log_n(n)) / n)


def all_estimates(counts: NDArray[np.int64]) -> dict[str, FloatArray]:
    """Return every estimator of ESTIMATORS on matrices (..., stimuli, responses), each of shape (...).

    `error_rule` is at least zero, and NaN where responses are not those of the stimuli.
    """
    plug_in, trials, stimuli, responses = plug_in_bits(counts), _trials(counts), _stimuli(counts), counts.shape[-1]
    occupied = (counts > 0).sum(axis=(-2, -1)) - stimuli - (counts.sum(axis=-2) > 0).sum(axis=-1) + 1
    error_rule = np.full(counts.shape[:-2], np.nan)
    if responses == counts.shape[-2]:
        errors = 1.0 - np.trace(counts, axis1=-2, axis2=-1) / trials
        error_rule = np.maximum(0.0, (1.0 - 2.0 * errors) * np.log2(stimuli))
    miller_madow = plug_in - occupied / (2.0 * trials * np.log(2.0))
    all_cells = plug_in - (stimuli - 1) * (responses - 1) / (2.0 * trials * np.log(2.0))
    return dict(zip(ESTIMATORS, (plug_in, miller_madow, all_cells, error_rule), strict=True))


def information(
    matrix: ArrayLike,
    rng: np.random.Generator,
    *,
    seconds_per_stimulus: float | None = None,
    draws: int = 1000,
    confidence: float = 0.95,
) -> Information:
    """Return the information transfer of a confusion matrix (stimuli, responses) of counts.

    Only the posterior's median has an interval: intervals of the other estimates missed the truth (a bootstrap's covers
    the bias of its estimator and not the truth). It is refused where trials are too few for the number of stimuli, and
    where responses are not those of the stimuli. Raises BadInput for a matrix, confidence or number of draws that is
    not allowed.
    """
    counts = confusion_counts(matrix)
    if not 0.0 < confidence < 1.0 or draws < 100:
        raise BadInput(f"confidence {confidence:g}, {draws} draws", "between 0 and 1, and 100 or more")
    if seconds_per_stimulus is not None and not seconds_per_stimulus > 0.0:
        raise BadInput(f"{seconds_per_stimulus:g} seconds a stimulus", "a positive number")
    estimates = {name: InformationEstimate(float(bits)) for name, bits in all_estimates(counts).items()}
    why = _no_interval(counts)
    if why is None:
        estimates[POSTERIOR] = _posterior(counts, rng, draws, confidence)
    per_second = None
    if seconds_per_stimulus is not None:
        per_second = {name: estimate.bits / seconds_per_stimulus for name, estimate in estimates.items()}
    few, english = _few_trials(counts), shipped_words("en")
    trials, square = int(counts.sum()), counts.shape[0] == counts.shape[1]
    return Information(
        stimuli=int(_stimuli(counts)),
        responses=counts.shape[1],
        trials=trials,
        share_correct=float(np.trace(counts) / trials) if square else float("nan"),
        confidence=confidence,
        estimates=estimates,
        bits_per_second=per_second,
        warning=None if few is None else few.told(english),
        no_interval=None if why is None else why.told(english),
        reasons=tuple(reason for reason in (few, why) if reason is not None),
    )


def _posterior(
    counts: NDArray[np.int64], rng: np.random.Generator, draws: int, confidence: float
) -> InformationEstimate:
    """Return the posterior's median with an interval somewhat wider than the posterior's own."""
    bits = information_draws(counts, draws, rng)
    few = float(_trials(counts)) < counts.shape[0] ** 2
    down, up = _INTERVAL_FACTORS_FEW if few else _INTERVAL_FACTORS
    tails = (0.5 - 0.5 * confidence, 0.5, 0.5 + 0.5 * confidence)
    low, middle, high = (float(value) for value in np.quantile(bits, tails))
    most = float(np.log2(counts.shape[0]))
    return InformationEstimate(
        middle, max(middle - down * (middle - low), 0.0), min(middle + up * (high - middle), most)
    )


def _no_interval(counts: NDArray[np.int64]) -> Reason | None:
    if counts.shape[0] != counts.shape[1]:
        return Reason("other_responses")
    if np.any(counts.sum(axis=1) == 0):
        return Reason("never_presented")
    each, wanted = float(_trials(counts)) / counts.shape[0], 0.5 * counts.shape[0]
    if each < wanted:
        values = {"each": f"{each:.3g}", "wanted": f"{wanted:g}", "stimuli": str(counts.shape[0])}
        return Reason("few_each", values)
    return None


def _few_trials(counts: NDArray[np.int64]) -> Reason | None:
    stimuli, responses, trials = int(_stimuli(counts)), counts.shape[1], int(counts.sum())
    wanted = TRIALS_PER_CELL_MIN * stimuli * responses
    if trials >= wanted:
        return None
    values = {"trials": trials, "stimuli": stimuli, "responses": responses, "wanted": wanted}
    return Reason("few_trials", {name: str(value) for name, value in values.items()})


def _n_log_n(counts: NDArray[np.int64]) -> FloatArray:
    values = np.asarray(counts, dtype=np.float64)
    return np.asarray(values * np.log2(np.where(values > 0.0, values, 1.0)))


def _trials(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.asarray(counts.sum(axis=(-2, -1)))


def _stimuli(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.asarray((counts.sum(axis=-1) > 0).sum(axis=-1))
