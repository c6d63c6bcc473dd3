"""QUEST+ (Watson 2017): each trial is placed where its outcome is expected to be most informative, over a grid of
parameters.

With aim `parameters`, which is Watson's, the level has the greatest expected fall of entropy over threshold, slope and
lapse together. That is the mutual information I(s) = h(mean psi) - mean h(psi), with h the entropy of a yes-or-no
outcome. With aim `threshold` it has the least expected variance of the threshold alone; this spends no trials on lapses
and needs about 15 % fewer. Both are matrix products, for any number of runs at once.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Annotated, Literal

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import Field

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import GUESS, PLAYABLE, Estimate, Playable, Procedure, Runs, psi_at
from tactuator.parameters import Number, Positive, Whole, table
from tactuator.perception.curve import Level

_STEP_DB = 1.0
"""Step between levels; thresholds are half as far apart."""
_SLOPES, _SLOPE_SHARES = (1.3, 2.0, 2.8, 3.8), (0.2, 0.3, 0.3, 0.2)
"""Prior of the Weibull slope."""
_LAPSES = (0.0, 0.01, 0.02, 0.04)
"""Lapse rates, equally probable."""


@table("[procedure]")
class QuestPlus(Procedure):
    """Keys of `quest-plus`."""

    scatter_db = 5.0

    trials: Annotated[Whole, Field(ge=1, description="trials of a run")] = 48
    low_db_sl: Annotated[Level, Field(description="lowest threshold, and lowest level of a trial")] = -30.0
    high_db_sl: Annotated[Level, Field(description="highest threshold, and highest level of a trial")] = 40.0
    expected_db_sl: Annotated[Number, Field(description="mean of the threshold's normal prior")] = 0.0
    expected_sd_db: Annotated[Positive, Field(description="standard deviation of that prior")] = 15.0
    aim: Annotated[
        Literal["threshold", "parameters"],
        Field(description="least expected variance of the threshold, or Watson's entropy of all parameters"),
    ] = "threshold"

    def __post_init__(self) -> None:
        if not self.low_db_sl + _STEP_DB < self.high_db_sl:
            raise BadInput(
                f"levels {self.low_db_sl:g} to {self.high_db_sl:g} dB SL in steps of {_STEP_DB:g}",
                "two or more ascending levels",
            )

    def begin(self, guess: float = GUESS, playable: Playable = PLAYABLE, count: int = 1) -> QuestPlusRuns:
        return QuestPlusRuns(self, guess, count)

    def expected_threshold(self) -> float:
        return self.expected_db_sl

    def expecting(self, threshold_db_sl: float) -> QuestPlus:
        return replace(self, expected_db_sl=threshold_db_sl)

    def below(self, ceiling_db_sl: float) -> QuestPlus:
        return replace(self, high_db_sl=min(self.high_db_sl, ceiling_db_sl))


class Tables:
    """Tables of a procedure: psi and its entropy for every parameter at every level, and the prior.

    psi, entropy: (parameters, levels). Parameters are thresholds x slopes x lapses, flattened in that order.
    """

    def __init__(self, rule: QuestPlus, guess: float) -> None:
        self.levels = np.arange(rule.low_db_sl, rule.high_db_sl + 1e-9, _STEP_DB)
        self.thresholds = np.arange(rule.low_db_sl, rule.high_db_sl + 1e-9, 0.5 * _STEP_DB)
        slopes, lapses = np.array(_SLOPES), np.array(_LAPSES)
        self.shape = (self.thresholds.size, slopes.size, lapses.size)
        level = self.levels[None, None, None, :] - self.thresholds[:, None, None, None]
        psi = psi_at(level, slopes[None, :, None, None], lapses[:, None], guess, rule.point)
        self.psi = psi.reshape(-1, self.levels.size)
        self.entropy = scipy.special.entr(self.psi) + scipy.special.entr(1.0 - self.psi)
        self._likelihood = np.stack([1.0 - self.psi.T, self.psi.T])  # of a wrong and of a right answer, by level
        weights = np.broadcast_to(np.array(_SLOPE_SHARES)[None, :, None], self.shape).reshape(-1)
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


tables = lru_cache(maxsize=8)(Tables)
"""The tables of a procedure, computed once and kept."""


class QuestPlusRuns(Runs):
    """Runs of QUEST+ side by side; posterior: (count, parameters)."""

    def __init__(self, rule: QuestPlus, guess: float, count: int) -> None:
        super().__init__(count, rule.trials)
        self.rule, self._tables = rule, tables(rule, guess)
        self.posterior: FloatArray = np.broadcast_to(self._tables.prior, (count, self._tables.prior.size))
        self._next = self._tables.most_telling(self.posterior)

    @property
    def level_db_sl(self) -> FloatArray:
        return np.asarray(self._tables.levels[self._next])

    def learn(self, correct: NDArray[np.bool_]) -> None:
        self.posterior = self._tables.learn(self.posterior, self._next, correct)
        self._next = self._tables.most_telling(self.posterior)

    def estimate(self, run: int = 0) -> Estimate | None:
        """Return the posterior mean and standard deviation once the run is over; None before."""
        if not self.over[run]:
            return None
        mean, sd = self._tables.threshold(self.posterior[run : run + 1])
        return Estimate(float(mean[0]), float(sd[0]))

    def flags(self, run: int = 0) -> tuple[str, ...]:
        """Return `floor` or `ceiling` where the estimate is within two standard deviations of that end of the range."""
        estimate = self.estimate(run)
        if estimate is None or estimate.standard_error_db is None:
            return ()
        reach = 2.0 * estimate.standard_error_db
        ceiling = estimate.level_db_sl + reach > self.rule.high_db_sl
        floor = estimate.level_db_sl - reach < self.rule.low_db_sl
        return (*(["ceiling"] if ceiling else []), *(["floor"] if floor else []))
