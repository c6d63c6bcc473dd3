"""Bayesian refit of a run's trials: the threshold's posterior with slope and lapse rate integrated out on a grid.

psi is a Weibull in amplitude (perception.psychometric). The prior is flat in the threshold and log-normal in the slope.
In the lapse rate it falls exponentially, except for one person in ten, whose lapse rate may be anything.

A run says little about the slope, and people's slopes differ more than the prior says. So the interval takes all slopes
for equally likely: it is of the thresholds that explain the answers at least 1 / _LEAST_LIKELY times as well as the
best one, slope and lapse rate integrated out (decision 0017).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import FEWEST_TRIALS, psi_at
from tactuator.perception.psychometric import TARGET_3_DOWN_1_UP

_SLOPES = np.geomspace(0.4, 5.0, 10)
_LEAST_LIKELY = 15.0
"""How many times less likely than the best a threshold at an end of the interval is: 15 holds 0.91 of people with slope
0.8, 0.94 with 1, 0.97 with 1.5 and more above."""
_ANY_LAPSE_SHARE = 0.1
"""Share of people whose lapse rate may be anything up to where psi no longer reaches its target."""
_FREQUENT_LAPSE_RATE, _RARE_LAPSE_RATE = 0.10, 0.025
ALIKE_DB = 6.0
"""Thresholds further than this beyond all levels played explain the answers alike: an interval is open there."""
_BATCH_RUNS = 128
"""Runs that are fitted side by side; more of them leave the processor's own memory."""


@dataclass(frozen=True)
class RefitPrior:
    """Prior of a run's psychometric function.

    guess: probability of a right guess. target: share correct at threshold. slope_median, slope_sd_log: log-normal
    prior of the Weibull slope. lapse_mean: mean of the exponential prior of the lapse rate. reach_db, step_db: half
    width and step of the threshold's grid, centred on the run's middle level.
    """

    guess: float = 1.0 / 3.0
    target: float = TARGET_3_DOWN_1_UP
    slope_median: float = 2.15
    slope_sd_log: float = 0.4
    lapse_mean: float = 0.02
    reach_db: float = 30.0
    step_db: float = 0.25

    def __post_init__(self) -> None:
        if not 0.0 <= self.guess < self.target < 1.0:
            got = f"refit at {100.0 * self.target:.3g} % correct, where guesses are right in {100.0 * self.guess:.3g} %"
            raise BadInput(got, "a point above chance and below 100 %")

    def settings(self) -> dict[str, object]:
        """Return the prior as values of a side-car, with what another program needs to compute the refit anew."""
        grid = _grid(self)
        return {
            "psi": "guess + (1 - guess - lapse) (1 - exp(-(10^((level - a) / 20))^slope)); point at the threshold",
            "guess": self.guess,
            "point": self.target,
            "threshold_db_sl": {
                "centre": "median level of the second half of the run's trials, blank ones left out",
                "reach_db": self.reach_db,
                "step_db": self.step_db,
                "prior": "flat",
            },
            "slope": {"values": grid.slopes.tolist(), "prior": grid.slope_prior.tolist()},
            "lapse": {"values": grid.lapses.tolist(), "prior": grid.lapse_prior.tolist()},
            "interval": f"likelihood at least 1/{_LEAST_LIKELY:g} of the highest, slopes weighed evenly and lapses "
            "by their prior; its logarithm is linear within a grid cell; open beyond the levels played where "
            f"the median lies there (bound) or an end lies {ALIKE_DB:g} dB further",
        }


@dataclass(frozen=True)
class Refit:
    """Posterior of the threshold of each run, dB; all arrays (runs,).

    threshold_db: median. sd_db: standard deviation. low_db, high_db: 95 % interval. slope, lapse: posterior means.
    log_bayes_factor: log evidence for a threshold within the grid against guessing. lapse_log_odds: log likelihood of
    lapse rates of 10 % or more, on average, over that of the likeliest rate of 2.5 % or less, threshold and slope
    integrated out.
    """

    threshold_db: FloatArray
    sd_db: FloatArray
    low_db: FloatArray
    high_db: FloatArray
    slope: FloatArray
    lapse: FloatArray
    log_bayes_factor: FloatArray
    lapse_log_odds: FloatArray


def refit(levels_db: FloatArray, correct: NDArray[np.bool_], prior: RefitPrior | None = None) -> Refit:
    """Refit runs. levels_db, correct: (runs, trials), NaN where a run was over; or (trials,) for one run.

    Raises BadInput for a run of fewer than five trials.
    """
    prior = RefitPrior() if prior is None else prior
    levels = np.atleast_2d(np.asarray(levels_db, dtype=np.float64))
    outcomes = np.atleast_2d(np.asarray(correct, dtype=np.bool_))
    fewest = int(np.min(np.sum(np.isfinite(levels), axis=1), initial=FEWEST_TRIALS))
    if fewest < FEWEST_TRIALS:
        raise BadInput(f"refit of a run of {fewest} trials", f"{FEWEST_TRIALS} or more")
    parts = [
        _refit_batch(levels[first : first + _BATCH_RUNS], outcomes[first : first + _BATCH_RUNS], prior)
        for first in range(0, levels.shape[0], _BATCH_RUNS)
    ]
    return Refit(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _refit_batch(levels: FloatArray, outcomes: NDArray[np.bool_], prior: RefitPrior) -> tuple[FloatArray, ...]:
    centre = _middle(levels)
    offsets, right, wrong = _counts(levels - centre[:, None], outcomes)
    grid = _grid(prior)
    log_right, log_wrong = grid.log_likelihood(offsets)
    log_posterior = right @ log_right
    log_posterior += wrong @ log_wrong
    log_posterior += grid.log_prior
    highest = log_posterior.max(axis=1, keepdims=True)
    log_posterior -= highest
    posterior = np.exp(log_posterior, out=log_posterior).reshape(levels.shape[0], *grid.shape)
    by_slope = posterior.sum(axis=3)
    low, high = _ends(by_slope @ (1.0 / grid.slope_prior), grid.thresholds)
    marginal = by_slope.sum(axis=2)
    total = marginal.sum(axis=1, keepdims=True)
    chance = right.sum(axis=1) * np.log(prior.guess) + wrong.sum(axis=1) * np.log1p(-prior.guess)
    against_chance = highest[:, 0] + np.log(total[:, 0]) - chance
    of_shape = posterior.sum(axis=1) / total[:, :, None]
    by_lapse = of_shape.sum(axis=1) / grid.lapse_prior
    often, seldom = by_lapse[:, grid.lapses >= _FREQUENT_LAPSE_RATE], by_lapse[:, grid.lapses <= _RARE_LAPSE_RATE]
    odds = np.log(np.maximum(often.mean(axis=1), 1e-300)) - np.log(np.maximum(seldom.max(axis=1), 1e-300))
    marginal /= total
    mean = marginal @ grid.thresholds
    sd = np.sqrt(np.maximum(marginal @ grid.thresholds**2 - mean**2, 0.0))
    middle = _median(marginal, grid.thresholds)
    slope = of_shape.sum(axis=2) @ grid.slopes
    lapse = of_shape.sum(axis=1) @ grid.lapses
    return centre + middle, sd, centre + low, centre + high, slope, lapse, against_chance, odds


def _middle(levels: FloatArray) -> FloatArray:
    trials = np.sum(np.isfinite(levels), axis=1)
    late = np.where(np.arange(levels.shape[1]) >= trials[:, None] // 2, levels, np.nan)
    return np.asarray(np.nanmedian(late, axis=1))


def _counts(offsets: FloatArray, outcomes: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the distinct levels, (bins,), and how often each run was right and wrong at each, (runs, bins)."""
    present = np.isfinite(offsets)
    distinct, position = np.unique(np.round(offsets[present], 6), return_inverse=True)
    run = np.nonzero(present)[0]
    size = (offsets.shape[0], distinct.size)
    right, wrong = np.zeros(size), np.zeros(size)
    hit = outcomes[present]
    np.add.at(right, (run[hit], position[hit]), 1.0)
    np.add.at(wrong, (run[~hit], position[~hit]), 1.0)
    return distinct, right, wrong


def _median(marginal: FloatArray, thresholds: FloatArray) -> FloatArray:
    """Return the median of each row's marginal, linear within a grid cell."""
    step = thresholds[1] - thresholds[0]
    cumulative = np.cumsum(marginal, axis=1)
    cell = np.argmax(cumulative >= 0.5, axis=1)
    rows = np.arange(marginal.shape[0])
    before = cumulative[rows, cell] - marginal[rows, cell]
    inside = (0.5 - before) / np.maximum(marginal[rows, cell], 1e-300)
    return np.asarray(thresholds[cell] + (inside - 0.5) * step)


def _ends(likelihood: FloatArray, thresholds: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and the highest threshold whose likelihood, (runs, thresholds), is high enough; at most those
    of the grid."""
    height = np.log(np.maximum(likelihood, 1e-300))
    height -= height.max(axis=1, keepdims=True) - np.log(_LEAST_LIKELY)
    rows, last, inside, ends = np.arange(height.shape[0]), thresholds.size - 1, height >= 0.0, []
    for outward, inner in ((-1, inside.argmax(axis=1)), (1, last - inside[:, ::-1].argmax(axis=1))):
        outer = np.clip(inner + outward, 0, last)
        fall = np.maximum(height[rows, inner] - height[rows, outer], 1e-300)
        ends.append(thresholds[inner] + (thresholds[outer] - thresholds[inner]) * height[rows, inner] / fall)
    return ends[0], ends[1]


class _Grid:
    """Grid of thresholds x slopes x lapse rates, flattened in that order, with its log prior."""

    def __init__(self, prior: RefitPrior) -> None:
        self.prior = prior
        count = round(2.0 * prior.reach_db / prior.step_db) + 1
        self.thresholds = np.linspace(-prior.reach_db, prior.reach_db, count)
        self.slopes = _SLOPES
        z = np.log(self.slopes / prior.slope_median) / prior.slope_sd_log
        self.lapses = np.array([0.0, 0.02, 0.05, 0.12, 0.25, 0.5, 0.75, 0.95]) * (1.0 - prior.target)
        self.shape = (count, self.slopes.size, self.lapses.size)
        width = np.gradient(self.lapses)
        falling = np.exp(-self.lapses / prior.lapse_mean) * width
        self.lapse_prior = (1.0 - _ANY_LAPSE_SHARE) * falling / falling.sum() + _ANY_LAPSE_SHARE * width / width.sum()
        self.slope_prior = np.exp(-0.5 * z**2) / np.exp(-0.5 * z**2).sum()
        log_prior = np.log(self.slope_prior)[:, None] + np.log(self.lapse_prior)
        log_prior = log_prior - np.log(count)
        self.log_prior = np.broadcast_to(log_prior, self.shape).reshape(-1)

    def log_likelihood(self, offsets: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return log psi and log(1 - psi) at each level, (bins, grid points) each."""
        level = offsets[:, None, None, None] - self.thresholds[None, :, None, None]
        psi = psi_at(level, self.slopes[:, None], self.lapses, self.prior.guess, self.prior.target)
        psi = psi.reshape(offsets.size, -1)
        return np.log(psi), np.log1p(-psi)


@lru_cache(maxsize=4)
def _grid(prior: RefitPrior) -> _Grid:
    return _Grid(prior)
