"""The whole-curve procedure: every trial chooses its frequency and its level so that the curve is known soonest.

Its runs are tested for guessing, lapses, and a curve that moved. A curve that rises by d from the first trial to the
last, alike at all frequencies, answers as one that stays does to levels that fall by d, both about the middle of the
run. Every component of a belief is therefore refined from the moved levels, and the evidence of all components for a
drift of +6 or -6 dB is divided by that for none: the ratio of likelihoods, with curve, slope and lapse rate integrated
out over the belief's own prior. The log evidence is about s d - i d^2 / 2, where i is the information about d, read
where the evidence is highest, and s is normal with mean i times the drift and variance i. That gives the test's power.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import Field

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.procedure.curve_belief import CurveBelief
from tactuator.experiment.procedure.curve_prior import CurvePrior, CurveShares
from tactuator.experiment.procedure.curve_refinement import PointLikelihoods
from tactuator.experiment.procedure.procedure import (
    GUESS,
    PLAYABLE,
    Answering,
    MeasuredCurve,
    Playable,
    Procedure,
    Runs,
)
from tactuator.experiment.procedure.run_flags import LEAST_LOG_EVIDENCE, POWER_DRIFT_DB, unseen_notch
from tactuator.parameters import Whole, table
from tactuator.perception.curve import Level

_PICTURE_POINTS, _JUDGED_TRIALS_MIN = 60, 40
"""Frequencies of the drawn curve, and trials from which guessing is reported."""
_PEOPLE = Answering(slopes=(0.8, 1.3, 2.1, 3.4, 5.5), normal_share=0.5)
"""Slopes of spreads from 2 to 14 dB, each 1.6 times the next."""


@table("[procedure]")
class WholeCurve(Procedure):
    """Keys of `curve`: the whole curve is measured in one run, over the display's band."""

    chooses_frequency = True
    runs_at_once = 50

    trials: Annotated[Whole, Field(ge=1, description="trials of a run")] = 150
    floor_db_sl: Annotated[Level, Field(description="lowest level")] = -30.0
    ceiling_db_sl: Annotated[Level, Field(description="highest level")] = 50.0
    points: Annotated[Whole, Field(ge=3, le=60, description="frequencies over the band")] = CurvePrior.points
    prior: Annotated[CurveShares, Field(description="curves that people may have")] = CurveShares()

    def __post_init__(self) -> None:
        if not self.floor_db_sl < self.ceiling_db_sl:
            raise BadInput(f"floor {self.floor_db_sl:g}, ceiling {self.ceiling_db_sl:g} dB SL", "floor below")

    def prior_at(self, playable: Playable) -> CurvePrior:
        """Return the prior of curves over what can be played."""
        return CurvePrior(**vars(self.prior), **vars(playable), points=self.points)

    def expected_threshold(self) -> float:
        return 0.0

    def places(self, playable: Playable) -> FloatArray:
        return self.prior_at(playable).frequency_hz

    def begin(self, guess: float = GUESS, playable: Playable = PLAYABLE, count: int = 1) -> CurveRuns:
        return CurveRuns(self, CurveBelief(self.prior_at(playable), replace(_PEOPLE, guess=guess), count))

    def curve(
        self, guess: float, playable: Playable, frequency_hz: FloatArray, level_db_sl: FloatArray,
        correct: NDArray[np.bool_],
    ) -> MeasuredCurve:  # fmt: skip
        belief = CurveBelief(self.prior_at(playable), replace(_PEOPLE, guess=guess))
        at = belief.prior.frequency_hz
        points = np.argmin(np.abs(np.log(frequency_hz[:, None] / at)), axis=1)
        trials = Trials(points[None, :], level_db_sl[None, :], correct[None, :])
        flags, read = curve_flags(learnt(belief, trials), trials), belief.curve(at)
        curve = read.mean[0], read.sd[0], read.low[0], read.high[0]
        return MeasuredCurve(at, *curve, unseen_notch(belief).trials[0], flags.names(), float(flags.drift.power[0]))


class CurveRuns(Runs):
    """Runs of the whole-curve procedure side by side.

    belief: what is known so far. played: frequencies, levels and outcomes of every trial, (count,) each.
    """

    def __init__(self, rule: WholeCurve, belief: CurveBelief) -> None:
        super().__init__(belief.runs, rule.trials)
        self.rule, self.belief = rule, belief
        self.played: list[tuple[FloatArray, FloatArray, NDArray[np.bool_]]] = []
        self._chosen: tuple[NDArray[np.intp], FloatArray] | None = None

    def _choice(self) -> tuple[NDArray[np.intp], FloatArray]:
        if self._chosen is None:
            self._chosen = self.belief.choose(self.rule.floor_db_sl, self.rule.ceiling_db_sl)
        return self._chosen

    @property
    def level_db_sl(self) -> FloatArray:
        return self._choice()[1]

    @property
    def frequency_hz(self) -> FloatArray:  # type: ignore[override]
        """The most informative frequency of every run, (count,)."""
        return np.asarray(self.belief.prior.frequency_hz[self._choice()[0]])

    def learn(self, correct: NDArray[np.bool_]) -> None:
        self.played.append((self.frequency_hz, self.level_db_sl, correct))
        self.belief.learn(*self._choice(), correct)
        self._chosen = None

    def flags(self, run: int = 0) -> tuple[str, ...]:
        """Return `floor` or `ceiling` where a trial was put at that limit."""
        levels = [level[run] for _, level, _ in self.played]
        ceiling, floor = max(levels) >= self.rule.ceiling_db_sl, min(levels) <= self.rule.floor_db_sl
        return (*(["ceiling"] if ceiling else []), *(["floor"] if floor else []))

    def picture(self) -> Mapping[str, object]:
        """Return the curve so far in dB SL with its 95 % band, and the trials."""
        frequency_hz = np.geomspace(*self.belief.prior.band_hz, _PICTURE_POINTS)
        read = self.belief.curve(frequency_hz)
        levels = {"level_db_sl": read.mean, "low_db_sl": read.low, "high_db_sl": read.high}
        limits = self.rule.floor_db_sl, self.rule.ceiling_db_sl
        enough = self.belief.trials >= _JUDGED_TRIALS_MIN
        return {
            "kind": "curve",
            "frequency_hz": np.round(frequency_hz, 3).tolist(),
            **{name: np.round(np.clip(at[0], *limits), 2).tolist() for name, at in levels.items()},
            "trials": [[round(float(hertz[0]), 3), float(at[0]), bool(right[0])] for hertz, at, right in self.played],
            "chance": bool(enough and self.belief.log_bayes_factor[0] < LEAST_LOG_EVIDENCE),
        }


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


def learnt(belief: CurveBelief, trials: Trials) -> CurveBelief:
    """Return the belief after the trials of its runs, refined."""
    for point, level, correct in zip(trials.point.T, trials.level_db_sl.T, trials.correct.T, strict=True):
        belief.learn(point, level, correct)
    belief.refine()
    return belief


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
