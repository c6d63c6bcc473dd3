"""Batches of up-down tracks for simulation: the rule of `up_down`, one array element for each track."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.procedure.up_down import UpDownRule

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
    """State of all tracks between two trials."""

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
        """Move every track that is not over by its outcome."""
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
