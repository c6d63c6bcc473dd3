"""Many QUEST+ runs at once, for simulation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactuator.experiment.procedure.quest_plus import QuestPlusRule, tables
from tactuator.experiment.procedure.up_down_batch import Probability, Tracks

_BATCH = 1024


def run_quests(rule: QuestPlusRule, runs: int, probability: Probability, rng: np.random.Generator) -> Tracks:
    """Run `runs` of them."""
    numbers = np.arange(runs)
    parts = [_batch(rule, numbers[first : first + _BATCH], probability, rng) for first in range(0, runs, _BATCH)]
    levels, correct, estimates = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Tracks(levels, correct, np.full(runs, rule.trials), estimates)


def _batch(
    rule: QuestPlusRule, numbers: NDArray[np.intp], probability: Probability, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
    table = tables(rule)
    runs = numbers.size
    posterior = np.broadcast_to(table.prior, (runs, table.prior.size))
    levels = np.empty((runs, rule.trials))
    outcomes = np.empty((runs, rule.trials), dtype=np.bool_)
    for trial in range(rule.trials):
        place = table.most_telling(posterior)
        levels[:, trial] = table.levels[place]
        outcomes[:, trial] = rng.random(runs) < probability(levels[:, trial], numbers)
        posterior = table.learn(posterior, place, outcomes[:, trial])
    return levels, outcomes, table.threshold(posterior)[0]
