"""Transformed up-down tracks (Levitt 1971): any n-down-m-up, any steps, one run at a time or many for simulation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Estimate, Placement, Playable, ProcedureKeys
from tactuator.parameters import Flag, Positive, Whole, table
from tactuator.perception.curve import COMFORT_DB_SL, LOWEST_DB_SL, Level

_LEVEL_TOLERANCE_DB = 1e-9  # levels are sums of steps, so a level at a limit may differ from it by rounding


_TRIALS_PER_REVERSAL = 5.3
"""Trials for a reversal of the paper's procedure, by simulation (79 for 15)."""


@table("[procedure]")
class UpDownRule(ProcedureKeys):
    """Keys of `up-down`: the rule by which a track begins, moves and ends; the defaults are the paper's."""

    start_db_sl: Annotated[Level, Field(description="level of the first trial")] = 20.0
    down: Annotated[Whole, Field(ge=1, description="right answers in a row that lower the level")] = 3
    up: Annotated[Whole, Field(ge=1, description="wrong answers in a row that raise the level")] = 1
    steps_db: Annotated[
        tuple[Positive, ...], Field(min_length=1, description="step after 0, 1, 2 ... reversals; the last one stays")
    ] = (4.0, 4.0, 4.0, 1.0)
    reversals: Annotated[Whole, Field(ge=1, description="reversals that end the run")] = 15
    averaged: Annotated[Whole, Field(ge=1, description="last reversals that make the threshold")] = 12
    initial_rule: Annotated[Flag, Field(description="1-down-1-up until the first reversal")] = False
    average: Annotated[
        Literal["reversals", "mid-runs"],
        Field(description="mean of the reversals' levels, or Levitt's: of the midpoints of every second run"),
    ] = "reversals"
    floor_db_sl: Annotated[Level, Field(description="lowest level")] = LOWEST_DB_SL
    ceiling_db_sl: Annotated[Level, Field(description="highest level")] = COMFORT_DB_SL
    trial_limit: Annotated[Whole, Field(ge=1, description="trials after which a run ends in any case")] = 1000

    def __post_init__(self) -> None:
        if self.averaged > self.reversals:
            raise BadInput(f"averages {self.averaged} of {self.reversals} reversals", "1 to all")
        if self.average == "mid-runs" and self.averaged < 2:
            raise BadInput(f"mid-runs of {self.averaged} reversals", "2 or more")
        if not self.floor_db_sl < self.ceiling_db_sl:
            raise BadInput(f"floor {self.floor_db_sl:g} dB SL is not below the ceiling {self.ceiling_db_sl:g}")
        if not self.floor_db_sl <= self.start_db_sl <= self.ceiling_db_sl:
            limits = f"{self.floor_db_sl:g} to {self.ceiling_db_sl:g}"
            raise BadInput(f"{self.start_db_sl:g}", limits, key="start_db_sl")

    def build(self, guess: float, playable: Playable) -> UpDown:
        """Return a fresh track."""
        return UpDown(self)

    @property
    def target(self) -> float:
        """Return the proportion correct at which the track balances: 0.5^(1/n) for n-down-1-up.

        In general it is where a run of n correct responses comes before a run of m incorrect ones half of the time
        (Feller, vol. 1, XIII.8).
        """
        return _balance(self.down, self.up)

    @property
    def typical_trials(self) -> float:
        """Return the number of trials that runs have on average, by simulation of the paper's rule."""
        return _TRIALS_PER_REVERSAL * self.reversals

    def step_db(self, reversals: int) -> float:
        """Return the step in dB after that many reversals."""
        return self.steps_db[min(reversals, len(self.steps_db) - 1)]


@cache
def _balance(down: int, up: int) -> float:
    """Return the proportion correct at which `down` correct responses in a row come before `up` incorrect ones half of
    the time.
    """
    p = np.linspace(1e-6, 1.0 - 1e-6, 200_001)
    q = 1.0 - p
    a, b = p ** (down - 1), q ** (up - 1)
    race = a * (1.0 - q**up) / (a + b - a * b)
    return float(np.interp(0.5, race, p))


IMECE2004 = UpDownRule()
"""The rule of the paper: 3-down-1-up; 4 dB until the third reversal, then 1 dB; the mean of 12 reversals at 1 dB."""


@table("[procedure]")
class PaperKeys(ProcedureKeys):
    """Keys of `imece2004`, the procedure of the paper: nothing but its start is to choose."""

    start_db_sl: Annotated[Level, Field(description="level of the first trial")] = IMECE2004.start_db_sl

    @property
    def rule(self) -> UpDownRule:
        """Return the paper's rule from that start."""
        return replace(IMECE2004, start_db_sl=self.start_db_sl)

    @property
    def typical_trials(self) -> float:
        """Return the number of trials that runs have on average."""
        return IMECE2004.typical_trials

    def build(self, guess: float, playable: Playable) -> UpDown:
        """Return a fresh track by the paper's rule."""
        return UpDown(self.rule)


@dataclass
class UpDown:
    """One up-down track by a rule."""

    rule: UpDownRule
    level_db_sl: float = field(init=False)
    levels: list[float] = field(init=False, default_factory=list)
    outcomes: list[bool] = field(init=False, default_factory=list)
    reversal_levels: list[float] = field(init=False, default_factory=list)
    _streak: int = field(init=False, default=0)
    _direction: int = field(init=False, default=0)
    _limits: set[str] = field(init=False, default_factory=set)

    def __post_init__(self) -> None:
        self.level_db_sl = self.rule.start_db_sl

    @property
    def finished(self) -> bool:
        """Return whether the run is over."""
        return len(self.reversal_levels) >= self.rule.reversals or self.trials >= self.rule.trial_limit

    @property
    def point(self) -> float:
        """Return the share correct at which the track balances."""
        return self.rule.target

    @property
    def trials(self) -> int:
        """Return the number of trials recorded so far."""
        return len(self.outcomes)

    @property
    def progress(self) -> float:
        """Return the share of the reversals seen, or of the trial limit used up where that is more."""
        return min(1.0, max(len(self.reversal_levels) / self.rule.reversals, self.trials / self.rule.trial_limit))

    @property
    def flags(self) -> tuple[str, ...]:
        """Return `floor` or `ceiling` where the track was to go beyond, `trial-limit` if it ended short."""
        short = self.finished and len(self.reversal_levels) < self.rule.reversals
        return tuple(sorted(self._limits | ({"trial-limit"} if short else set())))

    def placement(self) -> Placement | None:
        """Return the level of the next trial, or None when the run is over."""
        return None if self.finished else Placement(self.level_db_sl)

    def record(self, correct: bool) -> None:
        """Move the level by the outcome. Raises BadInput once the run is over."""
        if self.finished:
            raise BadInput(f"the run was over after {self.trials} trials", "no further response")
        self.levels.append(self.level_db_sl)
        self.outcomes.append(bool(correct))
        self._streak = max(self._streak, 0) + 1 if correct else min(self._streak, 0) - 1
        simple = self.rule.initial_rule and not self.reversal_levels
        down, up = (1, 1) if simple else (self.rule.down, self.rule.up)
        if self._streak >= down:
            self._move(-1)
        elif self._streak <= -up:
            self._move(+1)

    def _move(self, direction: int) -> None:
        if self._direction == -direction:
            self.reversal_levels.append(self.level_db_sl)
        self._direction, self._streak = direction, 0
        wanted = self.level_db_sl + direction * self.rule.step_db(len(self.reversal_levels))
        if wanted < self.rule.floor_db_sl - _LEVEL_TOLERANCE_DB:
            self._limits.add("floor")
        if wanted > self.rule.ceiling_db_sl + _LEVEL_TOLERANCE_DB:
            self._limits.add("ceiling")
        self.level_db_sl = min(max(wanted, self.rule.floor_db_sl), self.rule.ceiling_db_sl)

    def estimate(self) -> Estimate | None:
        """Return the mean of the last `averaged` reversals, or of mid-runs, in dB; None before it has them.

        The standard error is the levels' standard deviation over the root of their number.
        """
        levels = np.array(self.reversal_levels[-self.rule.averaged :])
        if len(self.reversal_levels) < self.rule.reversals:
            return None
        if self.rule.average == "mid-runs":
            levels = 0.5 * (levels[:-1] + levels[1:])[::2]
        error = float(np.std(levels, ddof=1) / np.sqrt(levels.size)) if levels.size > 1 else None
        return Estimate(float(np.mean(levels)), error)


Probability = Callable[[FloatArray, NDArray[np.intp], int], FloatArray]
"""A function of levels in dB SL, the numbers of their runs, and the number of the trial in its run: probability of a
correct response, elementwise."""


@dataclass(frozen=True)
class Tracks:
    """Tracks that were run to their ends.

    levels_db_sl, correct: (runs, trials), NaN (False) after a run's end. trials, estimates_db_sl: (runs,), the estimate
    NaN where a run has none.
    """

    levels_db_sl: FloatArray
    correct: NDArray[np.bool_]
    trials: NDArray[np.int64]
    estimates_db_sl: FloatArray


def run_tracks(rule: UpDownRule, start_db_sl: FloatArray, probability: Probability, rng: np.random.Generator) -> Tracks:
    """Run one track for each element of start_db_sl until all are over.

    Raises BadInput for a rule that does not average reversals.
    """
    if rule.average != "reversals":
        raise BadInput(f"batch of up-down tracks: average {rule.average!r}", "reversals")
    state = _State(rule, start_db_sl)
    levels, outcomes = list[FloatArray](), list[NDArray[np.bool_]]()
    numbers = np.arange(start_db_sl.size)
    while state.alive.any():
        correct = rng.random(state.level.size) < probability(state.level, numbers, len(levels))
        levels.append(np.where(state.alive, state.level, np.nan))
        outcomes.append(correct & state.alive)
        state.record(correct)
    estimates = np.where(state.reversals >= rule.reversals, state.reversal_sum / rule.averaged, np.nan)
    return Tracks(np.array(levels).T, np.array(outcomes).T, state.trials, estimates)


class _State:
    def __init__(self, rule: UpDownRule, start_db_sl: FloatArray) -> None:
        runs = start_db_sl.size
        self.rule = rule
        self.level = np.array(start_db_sl, dtype=np.float64)
        self.streak = np.zeros(runs, dtype=np.int64)
        self.direction = np.zeros(runs, dtype=np.int64)
        self.reversals = np.zeros(runs, dtype=np.int64)
        self.trials = np.zeros(runs, dtype=np.int64)
        self.reversal_sum = np.zeros(runs)
        self.alive = np.ones(runs, dtype=np.bool_)
        self.steps = np.array(rule.steps_db)

    def record(self, correct: NDArray[np.bool_]) -> None:
        rule = self.rule
        self.trials += self.alive
        self.streak = np.where(correct, np.maximum(self.streak, 0) + 1, np.minimum(self.streak, 0) - 1)
        simple = (self.reversals == 0) if rule.initial_rule else np.zeros_like(self.alive)
        down = self.streak >= np.where(simple, 1, rule.down)
        up = self.streak <= -np.where(simple, 1, rule.up)
        move = np.where(self.alive, up.astype(np.int64) - down, 0)
        turned = (move != 0) & (move == -self.direction)
        counted = turned & (self.reversals >= rule.reversals - rule.averaged)
        self.reversal_sum += np.where(counted, self.level, 0.0)
        self.reversals += turned
        self.direction = np.where(move != 0, move, self.direction)
        self.streak[move != 0] = 0
        step = self.steps[np.minimum(self.reversals, self.steps.size - 1)]
        self.level = np.clip(self.level + move * step, rule.floor_db_sl, rule.ceiling_db_sl)
        self.alive &= (self.reversals < rule.reversals) & (self.trials < rule.trial_limit)
