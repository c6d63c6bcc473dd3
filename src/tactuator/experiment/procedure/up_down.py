"""Transformed up-down tracks (Levitt 1971): any n-down-m-up, any steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import pairwise
from math import dist, sqrt
from statistics import fmean
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import GUESS, PLAYABLE, Estimate, Playable, Procedure, Runs
from tactuator.parameters import Flag, Positive, Whole, table
from tactuator.perception.curve import COMFORT_DB_SL, LOWEST_DB_SL, Level

_LEVEL_TOLERANCE_DB = 1e-9  # levels are sums of steps, so a level at a limit may differ from it by rounding


_TRIALS_PER_REVERSAL = 5.3
"""Trials for a reversal of the paper's procedure, by simulation (79 for 15)."""


@table("[procedure]")
class UpDown(Procedure):
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

    def begin(self, guess: float = GUESS, playable: Playable = PLAYABLE, count: int = 1) -> Tracks:
        return Tracks(self, count)

    @property
    def point(self) -> float:
        """Proportion correct at which the track balances: 0.5^(1/n) for n-down-1-up.

        In general it is where a run of n correct responses comes before a run of m incorrect ones half of the time
        (Feller, vol. 1, XIII.8).
        """
        return _balance(self.down, self.up)

    @property
    def fewest_trials(self) -> int:
        """Return the fewest trials in which a run can have all of its reversals: every step turns."""
        steps = range(self.reversals + 1)  # the first step turns nothing
        lasting = {
            first: sum(
                1 if self.initial_rule and step < 2 else (self.down, self.up)[(step + first) % 2] for step in steps
            )
            for first in (0, 1)
        }
        return min(lasting.values())

    def faults(self, guess: float) -> Iterator[BadInput]:
        yield from super().faults(guess)
        if self.trial_limit < self.fewest_trials:
            got = f"{self.trial_limit}, where {self.reversals} reversals take {self.fewest_trials} trials or more"
            yield BadInput(got, f"{self.fewest_trials} or more", key="trial_limit")
        width, step = self.ceiling_db_sl - self.floor_db_sl, self.steps_db[-1]
        if width < 2.0 * step:
            yield BadInput(
                f"levels over {width:g} dB in steps of {step:g} dB", "two steps or more from floor to ceiling"
            )

    @property
    def typical_trials(self) -> float:
        """Return the number of trials that runs have on average, by simulation of the paper's rule."""
        return _TRIALS_PER_REVERSAL * self.reversals

    def below(self, ceiling_db_sl: float) -> UpDown:
        ceiling = min(self.ceiling_db_sl, ceiling_db_sl)
        return replace(self, ceiling_db_sl=ceiling, start_db_sl=min(self.start_db_sl, ceiling))


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


@table("[procedure]")
class Imece2004(Procedure):
    """Key of `imece2004`, the procedure of the paper: 3-down-1-up; 4 dB until the third reversal, then 1 dB.

    The threshold is the mean of the 12 reversals at 1 dB.
    """

    start_db_sl: Annotated[Level, Field(description="level of the first trial")] = UpDown.start_db_sl

    @property
    def typical_trials(self) -> float:
        return UpDown().typical_trials

    def begin(self, guess: float = GUESS, playable: Playable = PLAYABLE, count: int = 1) -> Tracks:
        return Tracks(UpDown(start_db_sl=self.start_db_sl), count)


class Tracks(Runs):
    """Up-down tracks side by side.

    reversals: number seen. reversal_db_sl: their levels, (count, most). streak: right answers in a row, or wrong ones,
    negative. direction: of the last step.
    """

    def __init__(self, rule: UpDown, count: int) -> None:
        super().__init__(count, rule.trial_limit)
        self.rule = rule
        self._level: FloatArray = np.full(count, rule.start_db_sl)
        self._streak: NDArray[np.int64] = np.zeros(count, dtype=np.int64)
        self._direction: NDArray[np.int64] = np.zeros(count, dtype=np.int64)
        self.reversals: NDArray[np.int64] = np.zeros(count, dtype=np.int64)
        self.reversal_db_sl: FloatArray = np.full((count, rule.reversals), np.nan)
        self._limits: dict[str, NDArray[np.bool_]] = {
            name: np.zeros(count, dtype=np.bool_) for name in ("floor", "ceiling")
        }

    @property
    def level_db_sl(self) -> FloatArray:
        return self._level

    @property
    def over(self) -> NDArray[np.bool_]:
        return np.asarray((self.reversals >= self.rule.reversals) | (self.trials >= self.limit))

    def progress(self, run: int = 0) -> float:
        """Return the share of the reversals seen, or of the trial limit used up where that is more."""
        return min(1.0, max(float(self.reversals[run] / self.rule.reversals), super().progress(run)))

    def flags(self, run: int = 0) -> tuple[str, ...]:
        """Return `floor` or `ceiling` where the track was to go beyond, `trial-limit` if it ended short."""
        short = bool(self.over[run] and self.reversals[run] < self.rule.reversals)
        limits = [name for name, reached in self._limits.items() if reached[run]]
        return tuple(sorted([*limits, *(["trial-limit"] if short else [])]))

    def learn(self, correct: NDArray[np.bool_]) -> None:
        rule, alive = self.rule, ~self.over
        self._streak = np.where(correct, np.maximum(self._streak, 0) + 1, np.minimum(self._streak, 0) - 1)
        simple = (self.reversals == 0) & rule.initial_rule
        down = self._streak >= np.where(simple, 1, rule.down)
        up = self._streak <= -np.where(simple, 1, rule.up)
        move = np.where(alive, up.astype(np.int64) - down, 0)
        turned = np.flatnonzero((move != 0) & (move == -self._direction))
        self.reversal_db_sl[turned, self.reversals[turned]] = self._level[turned]
        self.reversals[turned] += 1
        self._direction = np.where(move != 0, move, self._direction)
        self._streak[move != 0] = 0
        steps = np.array(rule.steps_db)
        wanted = self._level + move * steps[np.minimum(self.reversals, steps.size - 1)]
        self._limits["floor"] |= wanted < rule.floor_db_sl - _LEVEL_TOLERANCE_DB
        self._limits["ceiling"] |= wanted > rule.ceiling_db_sl + _LEVEL_TOLERANCE_DB
        self._level = np.clip(wanted, rule.floor_db_sl, rule.ceiling_db_sl)

    def estimate(self, run: int = 0) -> Estimate | None:
        """Return the mean of the last `averaged` reversals, or of mid-runs, in dB; None before it has them."""
        if self.reversals[run] < self.rule.reversals:
            return None
        levels = self.reversal_db_sl[run, -self.rule.averaged :].tolist()
        if self.rule.average == "mid-runs":
            levels = [0.5 * (one + next_one) for one, next_one in pairwise(levels)][::2]
        mean, others = fmean(levels), len(levels) - 1
        spread = dist(levels, [mean] * len(levels)) / sqrt(others) if others else None
        return Estimate(mean, None, spread)
