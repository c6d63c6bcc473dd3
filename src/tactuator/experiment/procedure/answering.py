"""Psychometric functions that a procedure thinks possible: slopes, lapse rates and their prior probabilities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.perception.psychometric import TARGET_3_DOWN_1_UP, weibull_rise

_PROBABILITY_MARGIN = 1e-6


@dataclass(frozen=True)
class Answering:
    """Psychometric functions of a detection task that a procedure thinks possible, with their prior probabilities.

    slopes: of the Weibull in amplitude, equally probable. lapses, lapse_shares: lapse rates and their probabilities.
    guess: probability of a right guess. target: share correct at threshold, lapses included. Raises BadInput unless 0
    <= guess < target < 1 - lapse for every lapse.
    """

    slopes: tuple[float, ...] = (1.5, 2.1, 2.9)
    lapses: tuple[float, ...] = (0.02, 0.1, 0.2)
    lapse_shares: tuple[float, ...] = (0.78, 0.12, 0.10)
    guess: float = 1.0 / 3.0
    target: float = TARGET_3_DOWN_1_UP

    def __post_init__(self) -> None:
        if not self.slopes or min(self.slopes) <= 0.0 or len(self.lapses) != len(self.lapse_shares):
            raise BadInput("answering: slopes, lapses or shares", "positive slopes, a share for every lapse")
        if not 0.0 <= self.guess < self.target < 1.0 - max(self.lapses):
            raise BadInput(
                f"answering: guess {self.guess:g}, target {self.target:g}, lapses up to {max(self.lapses):g}",
                "0 <= guess < target < 1 - lapse",
            )

    def psi(self, level_db: FloatArray, slope: FloatArray, lapse: FloatArray) -> FloatArray:
        """Return the probability of a correct response at level_db relative to threshold; arguments broadcast."""
        at_threshold = (self.target - self.guess) / (1.0 - self.guess - lapse)
        found = self.guess + (1.0 - self.guess - lapse) * weibull_rise(level_db, slope, at_threshold)
        return np.asarray(np.clip(found, _PROBABILITY_MARGIN, 1.0 - _PROBABILITY_MARGIN))

    def log_chance(self, correct: NDArray[np.bool_]) -> FloatArray:
        """Return the log probability of each answer if it was guessed."""
        return np.asarray(np.where(correct, np.log(self.guess), np.log1p(-self.guess)))
