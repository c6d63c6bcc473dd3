"""The whole-curve procedure: every trial chooses its frequency and its level so that the curve is known soonest.

Its runs are tested for guessing, lapses, and a curve that moved. A curve that rises by d from the first trial to the
last, alike at all frequencies, answers as one that stays does to levels that fall by d, both about the middle of the
run. Every component of a belief is therefore refined from the moved levels, and the evidence of all components for a
drift of +6 or -6 dB is divided by that for none: the ratio of likelihoods, with curve, slope and lapse rate integrated
out over the belief's own prior. The log evidence is about s d - i d^2 / 2, where i is the information about d, read
where the evidence is highest, and s is normal with mean i times the drift and variance i. That gives the test's power.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Annotated

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.procedure.curve_belief import CurveBelief
from tactuator.experiment.procedure.curve_prior import CurvePrior, CurveReading, CurveShares
from tactuator.experiment.procedure.curve_refinement import PointLikelihoods
from tactuator.experiment.procedure.procedure import Answering, FixedTrials, Placement, Playable, ProcedureKeys
from tactuator.experiment.procedure.run_flags import LEAST_LOG_EVIDENCE, POWER_DRIFT_DB
from tactuator.parameters import Whole, table
from tactuator.perception.curve import Level


@table("[procedure]")
class _CurveRun(ProcedureKeys):
    """Length of a run, and limits of its levels."""

    trials: Annotated[Whole, Field(ge=1, description="trials of a run")] = 150
    floor_db_sl: Annotated[Level, Field(description="lowest level")] = -30.0
    ceiling_db_sl: Annotated[Level, Field(description="highest level")] = 50.0

    def __post_init__(self) -> None:
        if not self.floor_db_sl < self.ceiling_db_sl:
            raise BadInput(f"floor {self.floor_db_sl:g}, ceiling {self.ceiling_db_sl:g} dB SL", "floor below")


@table("[procedure]")
class CurveKeys(_CurveRun):
    """Keys of `curve`: the whole curve is measured in one run, over the display's band."""

    chooses_frequency = True

    points: Annotated[Whole, Field(ge=3, le=60, description="frequencies over the band")] = CurvePrior.points
    prior: Annotated[CurveShares, Field(description="curves that people may have")] = CurveShares()

    def rule(self, guess: float, playable: Playable) -> WholeCurveRule:
        """Return the settings of a run over what can be played, in which guesses are right with that probability."""
        prior = CurvePrior(**vars(self.prior), **vars(playable), points=self.points)
        shared = {field.name: getattr(self, field.name) for field in fields(_CurveRun)}
        return WholeCurveRule(**shared, prior=prior, answering=Answering(guess=guess))

    def build(self, guess: float, playable: Playable) -> WholeCurve:
        """Return a fresh run."""
        return WholeCurve(self.rule(guess, playable))


@table("whole curve")
class WholeCurveRule(_CurveRun):
    """Settings of a whole-curve run; prior, answering: curves and psychometric functions thought possible."""

    prior: CurvePrior = field(default_factory=CurvePrior)
    answering: Answering = field(default_factory=Answering)


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

    def curve(self, frequency_hz: ArrayLike) -> CurveReading:
        """Return the curve at the frequencies, shape (n,) each."""
        read = self.belief.curve(frequency_hz)
        return CurveReading(read.mean[0], read.sd[0], read.low[0], read.high[0])


LEAST_LOG_ODDS = 3.0
"""Log evidence ratio above which drift is flagged: odds of twenty to one, as against guessing."""
_TRIED_DB = (0.0, -2.0 * POWER_DRIFT_DB, -POWER_DRIFT_DB, POWER_DRIFT_DB, 2.0 * POWER_DRIFT_DB)
"""Drifts whose evidence is computed; the outermost are for the information alone."""
_LEAST_INFORMATION = 1e-6


@dataclass(frozen=True)
class Trials:
    """Trials of several runs: point (index), level_db_sl and correct, each (runs, trials)."""

    point: NDArray[np.intp]
    level_db_sl: FloatArray
    correct: NDArray[np.bool_]


@dataclass(frozen=True)
class CurveDrift:
    """Outcome of the test for every run, each (runs,).

    log_odds: log evidence for a drift of POWER_DRIFT_DB up or down (alike probable) against none. power: probability
    that a drift of POWER_DRIFT_DB would be flagged.
    """

    log_odds: FloatArray
    power: FloatArray


def curve_drift(belief: CurveBelief, trials: Trials) -> CurveDrift:
    """Test every run of a belief that has learnt these trials for drift.

    A run in which no component settles has odds of one to one and no power.
    """
    tried = belief.log_evidence([_likelihoods(belief, trials, drift_db) for drift_db in _TRIED_DB])
    none, _, down, up, _ = tried = np.nan_to_num(tried, neginf=0.0).T
    log_odds = np.logaddexp(up, down) - np.log(2.0) - none
    return CurveDrift(log_odds, _power(tried[np.argsort(_TRIED_DB)]))


def _power(evidence: FloatArray) -> FloatArray:
    """Return the power of the test in every run, (runs,), from the evidence of each drift in their order, (5, runs)."""
    bends = 2.0 * evidence[1:-1] - evidence[:-2] - evidence[2:]
    peak = np.argmax(evidence[1:-1], axis=0)[None]
    bend = np.take_along_axis(bends, peak, axis=0)[0]
    reach = np.sqrt(np.maximum(bend, _LEAST_INFORMATION))
    needed = (LEAST_LOG_ODDS + np.log(2.0)) / reach + 0.5 * reach
    return np.asarray(scipy.special.ndtr(reach - needed) + scipy.special.ndtr(-reach - needed))


def _likelihoods(belief: CurveBelief, trials: Trials, drift_db: float) -> PointLikelihoods:
    """Return the likelihoods of the trials for the curve in the middle of a run with that drift."""
    runs, count = trials.level_db_sl.shape
    likelihoods = PointLikelihoods(belief.answering, runs, belief.prior.points)
    fallen = trials.level_db_sl - drift_db * (np.arange(count) / max(count - 1, 1) - 0.5)
    for trial in range(count):
        likelihoods.learn(trials.point[:, trial], fallen[:, trial], trials.correct[:, trial])
    return likelihoods


_FLAGGED_LAPSE_RATE = 0.05
_LAPSE_PROBABILITY_MIN = 0.98


@dataclass(frozen=True)
class CurveFlags:
    """Results of the tests on whole-curve runs, each (runs,).

    log_bayes_factor: log evidence for the model against guessing. lapsing: probability of a lapse rate above 5 %.
    """

    log_bayes_factor: FloatArray
    lapsing: FloatArray
    drift: CurveDrift

    def names(self, run: int = 0) -> tuple[str, ...]:
        """Return the names of the flags of one run, sorted."""
        flags = {
            "chance": self.log_bayes_factor[run] < LEAST_LOG_EVIDENCE,
            "lapses": self.lapsing[run] > _LAPSE_PROBABILITY_MIN,
            "drift": self.drift.log_odds[run] > LEAST_LOG_ODDS,
        }
        return tuple(sorted(name for name, true in flags.items() if true))


def curve_flags(belief: CurveBelief, trials: Trials) -> CurveFlags:
    """Test every run of a belief that has learnt these trials."""
    lapsing = np.where(belief.lapse > _FLAGGED_LAPSE_RATE, belief.weight, 0.0).sum(axis=1)
    return CurveFlags(belief.log_bayes_factor, np.asarray(lapsing), curve_drift(belief, trials))
