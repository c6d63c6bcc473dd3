"""The whole-curve procedure: every trial chooses its frequency and its level so that the curve is known soonest."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.procedure.answering import Answering
from tactuator.experiment.procedure.procedure import Estimate, FixedTrials, Placement
from tactuator.experiment.procedure.whole_curve.curve_belief import CurveBelief
from tactuator.experiment.procedure.whole_curve.curve_prior import CurvePrior


@dataclass(frozen=True)
class WholeCurveRule:
    """Settings of a whole-curve run.

    trials: number of trials in the run. prior, answering: curves and psychometric functions thought possible.
    floor_db_sl, ceiling_db_sl: limits of the level. Raises BadInput for settings that cannot be.
    """

    trials: int = 150
    prior: CurvePrior = field(default_factory=CurvePrior)
    answering: Answering = field(default_factory=Answering)
    floor_db_sl: float = -30.0
    ceiling_db_sl: float = 50.0

    def __post_init__(self) -> None:
        if self.trials < 1:
            raise BadInput(f"whole curve: {self.trials} trials", "1 or more")
        if not self.floor_db_sl < self.ceiling_db_sl:
            raise BadInput(
                f"whole curve: floor {self.floor_db_sl:g}, ceiling {self.ceiling_db_sl:g} dB SL", "floor below"
            )


class WholeCurve(FixedTrials):
    """One run of the whole-curve procedure.

    belief: what is known so far. played: frequency, level and outcome of every trial.
    """

    def __init__(self, rule: WholeCurveRule) -> None:
        super().__init__(rule.trials)
        self.rule = rule
        self.belief = CurveBelief(rule.prior, rule.answering)
        self.played: list[tuple[float, float, bool]] = []
        self._limits: set[str] = set()
        self._placed: tuple[int, float] | None = None

    @property
    def flags(self) -> tuple[str, ...]:
        """Return `floor` or `ceiling` where a trial was put at that limit."""
        return tuple(sorted(self._limits))

    def placement(self) -> Placement | None:
        """Return the most telling frequency and level, or None when the run is over."""
        if self.is_over:
            return None
        point, level_db_sl = self._chosen()
        return Placement(level_db_sl, float(self.rule.prior.frequency_hz[point]))

    def _chosen(self) -> tuple[int, float]:
        if self._placed is None:
            point, level = self.belief.choose(self.rule.floor_db_sl, self.rule.ceiling_db_sl)
            self._placed = int(point[0]), float(level[0])
        return self._placed

    def record(self, correct: bool) -> None:
        """Learn the outcome of a trial. Raises BadInput once the run is over."""
        self._count()
        point, level = self._chosen()
        self.belief.learn(np.array([point]), np.array([level]), np.array([correct]))
        self.played.append((float(self.rule.prior.frequency_hz[point]), level, bool(correct)))
        self._placed = None
        if level <= self.rule.floor_db_sl:
            self._limits.add("floor")
        if level >= self.rule.ceiling_db_sl:
            self._limits.add("ceiling")

    def estimate(self) -> Estimate | None:
        """Return None, as a curve is not one number; see `curve`."""
        return None

    def curve(self, frequency_hz: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return threshold in dB SL and its standard deviation at the frequencies, shape (n,) each."""
        mean, sd = self.belief.curve(frequency_hz)
        return mean[0], sd[0]
