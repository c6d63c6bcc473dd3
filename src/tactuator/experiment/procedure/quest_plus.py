"""QUEST+ (Watson 2017): each trial is put where its outcome is expected to tell most, over a grid of parameters.

With aim `parameters`, which is Watson's, the level has the greatest expected fall of entropy over threshold, slope and
lapse together. That is the mutual information I(s) = h(mean psi) - mean h(psi), with h the entropy of a yes-or-no
outcome. With aim `threshold` it has the least expected variance of the threshold alone; this spends no trials on lapses
and needs about 15 % fewer. Both are matrix products, for any number of runs at once.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Literal

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import Field

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Estimate, FixedTrials, Placement, Playable, ProcedureKeys, psi_at
from tactuator.experiment.procedure.up_down import Probability, Tracks
from tactuator.parameters import NotNegative, Number, Positive, Share, Whole, table
from tactuator.perception.curve import Level
from tactuator.perception.psychometric import TARGET_3_DOWN_1_UP

_BATCH_RUNS = 64
"""Runs that are computed side by side: their posteriors stay in the processor's own memory."""
_DRAWN_RUNS = 1024
"""Runs whose answers are drawn one trial after the other for all of them; another number would be other runs."""


def run_quests(rule: QuestPlusRule, runs: int, probability: Probability, rng: np.random.Generator) -> Tracks:
    """Run `runs` simulated runs of QUEST+ to their ends."""
    parts = []
    for drawn in _parts(np.arange(runs), _DRAWN_RUNS):
        chance = rng.random((rule.trials, drawn.size))
        for numbers in _parts(drawn, _BATCH_RUNS):
            parts.append(_batch(rule, numbers, probability, chance[:, numbers - drawn[0]]))
    levels, correct, estimates = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Tracks(levels, correct, np.full(runs, rule.trials), estimates)


def _parts(numbers: NDArray[np.intp], most: int) -> list[NDArray[np.intp]]:
    return [numbers[first : first + most] for first in range(0, numbers.size, most)]


def _batch(
    rule: QuestPlusRule, numbers: NDArray[np.intp], probability: Probability, chance: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_], FloatArray]:
    """Run those runs, whose answers are right where chance (trials, runs) is below their probability."""
    table = tables(rule)
    runs = numbers.size
    posterior = np.broadcast_to(table.prior, (runs, table.prior.size))
    levels = np.empty((runs, rule.trials))
    outcomes = np.empty((runs, rule.trials), dtype=np.bool_)
    for trial in range(rule.trials):
        place = table.most_telling(posterior)
        levels[:, trial] = table.levels[place]
        outcomes[:, trial] = chance[trial] < probability(levels[:, trial], numbers, trial)
        posterior = table.learn(posterior, place, outcomes[:, trial])
    return levels, outcomes, table.threshold(posterior)[0]


@table("[procedure]")
class QuestPlusKeys(ProcedureKeys):
    """Keys of `quest-plus`."""

    trials: Annotated[Whole, Field(ge=1, description="trials of a run")] = 48
    low_db_sl: Annotated[Level, Field(description="lowest threshold, and lowest level of a trial")] = -30.0
    high_db_sl: Annotated[Level, Field(description="highest threshold, and highest level of a trial")] = 40.0
    expected_db_sl: Annotated[Number, Field(description="mean of the threshold's normal prior")] = 0.0
    expected_sd_db: Annotated[Positive, Field(description="standard deviation of that prior")] = 15.0
    aim: Annotated[
        Literal["threshold", "parameters"],
        Field(description="least expected variance of the threshold, or Watson's entropy of all parameters"),
    ] = "threshold"

    def rule(self, guess: float) -> QuestPlusRule:
        """Return the settings of a run in which guesses are right with that probability."""
        return QuestPlusRule(**vars(self), guess=guess)

    def build(self, guess: float, playable: Playable) -> QuestPlus:
        """Return a fresh run."""
        return QuestPlus(self.rule(guess))


@table("QUEST+")
class QuestPlusRule(QuestPlusKeys):
    """Settings of a QUEST+ run.

    step_db: step between levels. slopes, slope_weights: prior of the Weibull slope. lapses: lapse rates, equally
    probable. guess: probability of a right guess. target: share correct at threshold. Raises BadInput for a setting
    that cannot be.
    """

    step_db: Positive = 1.0
    slopes: tuple[Positive, ...] = (1.3, 2.0, 2.8, 3.8)
    slope_weights: tuple[NotNegative, ...] = (0.2, 0.3, 0.3, 0.2)
    lapses: tuple[Share, ...] = (0.0, 0.01, 0.02, 0.04)
    guess: Share = 1.0 / 3.0
    target: Share = TARGET_3_DOWN_1_UP

    def __post_init__(self) -> None:
        if not self.low_db_sl + self.step_db < self.high_db_sl:
            raise BadInput(
                f"levels {self.low_db_sl:g} to {self.high_db_sl:g} dB SL in steps of {self.step_db:g}",
                "two or more ascending levels",
            )
        if len(self.slopes) != len(self.slope_weights) or not self.lapses:
            raise BadInput("slopes, slope_weights or lapses", "positive slopes, as many weights, a lapse")
        if not self.guess < self.target < 1.0 - max(self.lapses):
            raise BadInput(f"guess {self.guess:g}, target {self.target:g}", "guess < target < 1 - lapse")


class Tables:
    """Tables of a rule: psi and its entropy for every parameter at every level, and the prior.

    psi, entropy: (parameters, levels). Parameters are thresholds x slopes x lapses, flattened in that order.
    """

    def __init__(self, rule: QuestPlusRule) -> None:
        fine = 0.5 * rule.step_db
        self.levels = np.arange(rule.low_db_sl, rule.high_db_sl + 1e-9, rule.step_db)
        self.thresholds = np.arange(rule.low_db_sl, rule.high_db_sl + 1e-9, fine)
        slopes, lapses = np.array(rule.slopes), np.array(rule.lapses)
        self.shape = (self.thresholds.size, slopes.size, lapses.size)
        level = self.levels[None, None, None, :] - self.thresholds[:, None, None, None]
        psi = psi_at(level, slopes[None, :, None, None], lapses[:, None], rule.guess, rule.target)
        self.psi = psi.reshape(-1, self.levels.size)
        self.entropy = scipy.special.entr(self.psi) + scipy.special.entr(1.0 - self.psi)
        self._likelihood = np.stack([1.0 - self.psi.T, self.psi.T])  # of a wrong and of a right answer, by level
        weights = np.broadcast_to(np.array(rule.slope_weights)[None, :, None], self.shape).reshape(-1)
        self.parameter_threshold = np.repeat(self.thresholds, slopes.size * lapses.size)
        z = (self.parameter_threshold - rule.expected_db_sl) / rule.expected_sd_db
        weights = weights * np.exp(-0.5 * z**2)
        self.prior = weights / weights.sum()
        self.aim = rule.aim

    def most_telling(self, posterior: FloatArray) -> NDArray[np.intp]:
        """Return the index of the level to try next in every run, (runs,); posterior: (runs, parameters)."""
        chance = posterior @ self.psi
        if self.aim == "parameters":
            return np.asarray(
                np.argmax(
                    scipy.special.entr(chance) + scipy.special.entr(1.0 - chance) - posterior @ self.entropy, axis=1
                )
            )
        return np.asarray(np.argmin(self._expected_variance(posterior, chance), axis=1))

    def _expected_variance(self, posterior: FloatArray, chance: FloatArray) -> FloatArray:
        """Return the expected variance of the threshold after a trial at each level, less what all levels share."""
        weighted = posterior * self.parameter_threshold
        total = weighted.sum(axis=1, keepdims=True)
        right = weighted @ self.psi
        return np.asarray(-(right**2) / chance - (total - right) ** 2 / (1.0 - chance))

    def learn(self, posterior: FloatArray, level: NDArray[np.intp], correct: NDArray[np.bool_]) -> FloatArray:
        """Return the posterior, (runs, parameters), after a trial at `level` (index) of every run."""
        after = self._likelihood[correct.astype(np.intp), level]
        after *= posterior
        after /= after.sum(axis=1, keepdims=True)
        return after

    def threshold(self, posterior: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the posterior mean and standard deviation of the threshold of every run, dB SL, (runs,) each."""
        marginal = posterior.reshape(-1, *self.shape).sum(axis=(2, 3))
        mean = marginal @ self.thresholds
        return mean, np.sqrt(np.maximum(marginal @ self.thresholds**2 - mean**2, 0.0))


@lru_cache(maxsize=8)
def tables(rule: QuestPlusRule) -> Tables:
    """Return the tables of a rule, which are computed once and kept."""
    return Tables(rule)


class QuestPlus(FixedTrials):
    """One run of QUEST+ by the given rule."""

    def __init__(self, rule: QuestPlusRule) -> None:
        super().__init__(rule.trials)
        self.rule = rule
        self._tables = tables(rule)
        self._posterior = self._tables.prior[None, :]
        self._next = int(self._tables.most_telling(self._posterior)[0])

    @property
    def flags(self) -> tuple[str, ...]:
        """Return `floor` or `ceiling` where the estimate is within two standard deviations of that end of the range."""
        estimate = self.estimate()
        if estimate is None or estimate.standard_error_db is None:
            return ()
        reach = 2.0 * estimate.standard_error_db
        flags = {"floor": estimate.level_db_sl - reach < self.rule.low_db_sl}
        flags["ceiling"] = estimate.level_db_sl + reach > self.rule.high_db_sl
        return tuple(sorted(name for name, true in flags.items() if true))

    def placement(self) -> Placement | None:
        """Return the most telling level, or None when the run is over."""
        if self.is_over:
            return None
        return Placement(float(self._tables.levels[self._next]))

    def record(self, correct: bool) -> None:
        """Learn the outcome of a trial. Raises BadInput once the run is over."""
        self._count()
        self._posterior = self._tables.learn(self._posterior, np.array([self._next]), np.array([correct]))
        self._next = int(self._tables.most_telling(self._posterior)[0])

    def estimate(self) -> Estimate | None:
        """Return the posterior mean and standard deviation once the run is over; None before."""
        if not self.is_over:
            return None
        mean, sd = self._tables.threshold(self._posterior)
        return Estimate(float(mean[0]), float(sd[0]))
