"""Simulated subjects: each feels a displacement level in every interval and picks one."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.perception.curve import ThresholdCurve
from tactuator.perception.psychometric import MaxOfM, Psychometric, Weibull


@dataclass(frozen=True)
class Observer:
    """A subject with a threshold curve of its own.

    curve: level (dB re 1 um peak) at which psi reaches its target. A Weibull or logistic observer notices each interval
    independently with probability F (a high threshold), picks the strongest that it noticed, and guesses where it
    noticed none; with the signal in one interval that is psi exactly. A MaxOfM observer takes the largest of m noisy
    impressions. interval_bias: weights of the intervals in guesses and lapses (none: even). drift_db_per_trial: rise of
    the threshold from trial to trial. Raises BadInput for weights that cannot be.
    """

    name: str
    curve: ThresholdCurve
    psychometric: Psychometric = field(default_factory=lambda: Psychometric(Weibull(2.5), lapse=0.02))
    interval_bias: tuple[float, ...] | None = None
    drift_db_per_trial: float = 0.0

    def __post_init__(self) -> None:
        bias = self.interval_bias
        if bias is not None and (len(bias) < 2 or min(bias) < 0.0 or sum(bias) <= 0.0):
            raise BadInput(f"observer {self.name!r}: interval_bias {list(bias)}", "weights >= 0, not all zero")

    def respond(self, felt_db_re_1um: ArrayLike, frequency_hz: float, trial: int, rng: np.random.Generator) -> int:
        """Return the index of the interval picked; felt_db_re_1um: (m,) level of each; trial: counted from 0."""
        threshold = float(self.curve.level_db_re_1um_at(frequency_hz)) + self.drift_db_per_trial * trial
        level = np.asarray(felt_db_re_1um, dtype=np.float64) - threshold
        return respond(self.psychometric, level, self._weights(level.size), rng)

    def _weights(self, intervals: int) -> FloatArray:
        if self.interval_bias is None:
            return np.full(intervals, 1.0 / intervals)
        if len(self.interval_bias) != intervals:
            raise BadInput(
                f"observer {self.name!r}: interval_bias has {len(self.interval_bias)} weights for {intervals} intervals"
            )
        weights = np.asarray(self.interval_bias, dtype=np.float64)
        return weights / float(weights.sum())


def respond(psychometric: Psychometric, level_db: FloatArray, weights: FloatArray, rng: np.random.Generator) -> int:
    """Return the index of the interval picked; level_db: (m,) re own threshold; weights: (m,) of guesses.

    A lapse ignores what was felt, with probability lapse / (1 - guess), so that the highest psi is 1 - lapse.
    """
    intervals = level_db.size
    inattentive = rng.random() < psychometric.lapse / (1.0 - psychometric.guess)
    if isinstance(psychometric.shape, MaxOfM):
        impression = psychometric.shape.d_prime(level_db, psychometric.at_threshold) + rng.standard_normal(intervals)
        impression += _criterion_shift(weights)
        picked = int(np.argmax(impression))
    else:
        noticed = rng.random(intervals) < psychometric.rise(level_db)
        strongest = int(np.argmax(np.where(noticed, level_db, -np.inf)))
        picked = strongest if noticed.any() else int(rng.choice(intervals, p=weights))
    return int(rng.choice(intervals, p=weights)) if inattentive else picked


def _criterion_shift(weights: FloatArray) -> FloatArray:
    """Return what is added to each impression so that preferred intervals win more often; zero for even weights."""
    return np.asarray(np.log(np.maximum(weights, 1e-6) * weights.size))
