"""Transformed up-down tracks (Levitt 1971): any n-down-m-up, any steps, with or without an initial rule."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import Literal

import numpy as np

from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Estimate, Placement
from tactuator.perception.curve import COMFORT_DB_SL, LOWEST_DB_SL

_LEVEL_TOLERANCE_DB = 1e-9  # levels are sums of steps, so a level at a limit may differ from it by rounding


_TRIALS_PER_REVERSAL = 5.3
"""Trials for a reversal of the paper's procedure, by simulation (79 for 15)."""


@dataclass(frozen=True)
class UpDownRule:
    """Rule by which an up-down track moves and ends.

    down, up: consecutive correct (incorrect) responses that lower (raise) the level. steps_db: the step after 0, 1 ...
    reversals; the last one stays. reversals: number of reversals that end the run. averaged: number of the last
    reversals that make the threshold. initial_rule: True for 1-down-1-up until the first reversal. average:
    `reversals`, the mean of the averaged reversals' levels in dB, or `mid-runs`, Levitt's mean of the midpoints of
    every second run among them. floor_db_sl, ceiling_db_sl: limits of the level. trial_limit: number of trials after
    which the run ends in any case. Raises BadInput for a rule that cannot be.
    """

    down: int = 3
    up: int = 1
    steps_db: tuple[float, ...] = (4.0, 4.0, 4.0, 1.0)
    reversals: int = 15
    averaged: int = 12
    initial_rule: bool = False
    average: Literal["reversals", "mid-runs"] = "reversals"
    floor_db_sl: float = LOWEST_DB_SL
    ceiling_db_sl: float = COMFORT_DB_SL
    trial_limit: int = 1000

    def __post_init__(self) -> None:
        if min(self.down, self.up) < 1:
            raise BadInput(f"up-down rule: {self.down}-down-{self.up}-up", "1 or more of each")
        if not self.steps_db or min(self.steps_db) <= 0.0:
            raise BadInput(f"up-down rule: steps_db {list(self.steps_db)}", "one or more positive steps")
        if not 1 <= self.averaged <= self.reversals:
            raise BadInput(f"up-down rule: averages {self.averaged} of {self.reversals} reversals", "1 to all")
        if self.average not in ("reversals", "mid-runs"):
            raise BadInput(f"up-down rule: average {self.average!r}", "reversals, mid-runs")
        if self.average == "mid-runs" and self.averaged < 2:
            raise BadInput(f"up-down rule: mid-runs of {self.averaged} reversals", "2 or more")
        if not self.floor_db_sl < self.ceiling_db_sl:
            raise BadInput(
                f"up-down rule: floor {self.floor_db_sl:g} dB SL is not below the ceiling {self.ceiling_db_sl:g}"
            )
        if self.trial_limit < 1:
            raise BadInput(f"up-down rule: trial_limit is {self.trial_limit}", "1 or more")

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


@dataclass
class UpDown:
    """One up-down track that starts at start_db_sl. Raises BadInput for a start outside the rule's limits."""

    rule: UpDownRule
    start_db_sl: float
    level_db_sl: float = field(init=False)
    levels: list[float] = field(init=False, default_factory=list)
    outcomes: list[bool] = field(init=False, default_factory=list)
    reversal_levels: list[float] = field(init=False, default_factory=list)
    _streak: int = field(init=False, default=0)
    _direction: int = field(init=False, default=0)
    _limits: set[str] = field(init=False, default_factory=set)

    def __post_init__(self) -> None:
        rule = self.rule
        if not rule.floor_db_sl <= self.start_db_sl <= rule.ceiling_db_sl:
            raise BadInput(f"start level {self.start_db_sl:g} dB SL", f"{rule.floor_db_sl:g} to {rule.ceiling_db_sl:g}")
        self.level_db_sl = self.start_db_sl

    @property
    def finished(self) -> bool:
        """Return whether the run is over."""
        return len(self.reversal_levels) >= self.rule.reversals or self.trials >= self.rule.trial_limit

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
        """Return `floor` or `ceiling` where the track was to go beyond, `trial-limit` where it ended without its
        reversals.
        """
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
        """Return the mean of the last `averaged` reversals, or of mid-runs, in dB; None before the run has its
        reversals.

        The standard error is the levels' standard deviation over the root of their number.
        """
        levels = np.array(self.reversal_levels[-self.rule.averaged :])
        if len(self.reversal_levels) < self.rule.reversals:
            return None
        if self.rule.average == "mid-runs":
            levels = 0.5 * (levels[:-1] + levels[1:])[::2]
        error = float(np.std(levels, ddof=1) / np.sqrt(levels.size)) if levels.size > 1 else None
        return Estimate(float(np.mean(levels)), error)
