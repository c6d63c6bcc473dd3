"""The whole-curve procedure: every trial chooses its frequency and its level so that the curve is known soonest."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.errors import BadInput
from tactuator.experiment.procedure.curve_belief import Answering, CurveBelief
from tactuator.experiment.procedure.curve_prior import CurvePrior
from tactuator.experiment.procedure.procedure import Estimate, Placement

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class WholeCurveRule:
    """trials: how many end the run; levels stay between floor and ceiling."""

    trials: int = 150
    prior: CurvePrior = field(default_factory=CurvePrior)
    answering: Answering = field(default_factory=Answering)
    floor_db_sl: float = -30.0
    ceiling_db_sl: float = 40.0

    def __post_init__(self) -> None:
        if self.trials < 1:
            raise BadInput(f"whole curve: {self.trials} trials; allowed: 1 or more")
        if not self.floor_db_sl < self.ceiling_db_sl:
            raise BadInput(
                f"whole curve: floor {self.floor_db_sl:g}, ceiling {self.ceiling_db_sl:g} dB SL; allowed: floor below"
            )


class WholeCurve:
    """One run."""

    def __init__(self, rule: WholeCurveRule) -> None:
        self.rule = rule
        self._frequency_hz = rule.prior.frequency_hz
        self._belief = CurveBelief(rule.prior, rule.answering)
        self._trials = 0
        self._limits: set[str] = set()
        self._choose()

    def _choose(self) -> None:
        rule = self.rule
        point, level = self._belief.choose(rule.floor_db_sl, rule.ceiling_db_sl)
        self._point, self._level = int(point[0]), float(level[0])
        if self._level <= rule.floor_db_sl:
            self._limits.add("floor")
        if self._level >= rule.ceiling_db_sl:
            self._limits.add("ceiling")

    @property
    def trials(self) -> int:
        """Trials recorded so far."""
        return self._trials

    @property
    def progress(self) -> float:
        """Share of the trials done."""
        return self._trials / self.rule.trials

    @property
    def flags(self) -> tuple[str, ...]:
        """floor, ceiling: a trial was put at that limit."""
        return tuple(sorted(self._limits))

    def placement(self) -> Placement | None:
        """The most telling frequency and level."""
        if self._trials >= self.rule.trials:
            return None
        return Placement(self._level, float(self._frequency_hz[self._point]))

    def record(self, correct: bool) -> None:
        """Learn the outcome."""
        if self.placement() is None:
            raise BadInput(f"the run was over after {self._trials} trials; allowed: no further response")
        self._belief.learn(np.array([self._point]), np.array([self._level]), np.array([correct]))
        self._trials += 1
        if self._trials < self.rule.trials:
            self._choose()

    def estimate(self) -> Estimate | None:
        """None: a curve is not one number; see `curve`."""
        return None

    def curve(self, frequency_hz: ArrayLike) -> tuple[Floats, Floats]:
        """Threshold in dB SL and its standard deviation at the frequencies, shape (n,) each."""
        mean, covariance = self._belief.curve()
        weights = self.rule.prior.weights(frequency_hz)
        own = self.rule.prior.covariance(self._frequency_hz, self._frequency_hz)
        prior = np.diag(self.rule.prior.covariance(frequency_hz, frequency_hz))
        between = prior - np.einsum("fg,gh,fh->f", weights, own, weights)
        variance = np.einsum("fg,gh,fh->f", weights, covariance[0], weights) + np.maximum(between, 0.0)
        return weights @ mean[0], np.sqrt(variance)
