"""Batches of QUEST+ runs, computed side by side for simulation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.experiment.procedure.quest_plus import QuestPlusRule, tables
from tactuator.experiment.procedure.up_down_batch import Probability, Tracks

_BATCH_RUNS = 64
"""Runs that are computed side by side: their posteriors stay in the processor's own memory."""
_DRAWN_RUNS = 1024
"""Runs whose answers are drawn one trial after the other for all of them; another number would be other runs."""


def run_quests(rule: QuestPlusRule, runs: int, probability: Probability, rng: np.random.Generator) -> Tracks:
    """Run `runs` simulated runs of QUEST+ to their ends."""
    parts = []
    for drawn in _parts(np.arange(runs), _DRAWN_RUNS):
        chance = rng.random((rule.trials, drawn.size))
        for numbers in _parts(drawn, _BATCH_RUNS):
            parts.append(_batch(rule, numbers, probability, chance[:, numbers - drawn[0]]))
    levels, correct, estimates = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Tracks(levels, correct, np.full(runs, rule.trials), estimates)


def _parts(numbers: NDArray[np.intp], most: int) -> list[NDArray[np.intp]]:
    return [numbers[first : first + most] for first in range(0, numbers.size, most)]


def _batch(
    rule: QuestPlusRule, numbers: NDArray[np.intp], probability: Probability, chance: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_], FloatArray]:
    """Run those runs, whose answers are right where chance (trials, runs) is below their probability."""
    table = tables(rule)
    runs = numbers.size
    posterior = np.broadcast_to(table.prior, (runs, table.prior.size))
    levels = np.empty((runs, rule.trials))
    outcomes = np.empty((runs, rule.trials), dtype=np.bool_)
    for trial in range(rule.trials):
        place = table.most_telling(posterior)
        levels[:, trial] = table.levels[place]
        outcomes[:, trial] = chance[trial] < probability(levels[:, trial], numbers, trial)
        posterior = table.learn(posterior, place, outcomes[:, trial])
    return levels, outcomes, table.threshold(posterior)[0]


def estimates(
    rule: QuestPlusRule, levels_db_sl: FloatArray, correct: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation of the threshold after these trials, (runs,) each; arguments (runs, trials).

    The posterior is the same as trial by trial, computed in one product of counts with log psi.
    """
    table = tables(rule)
    place = np.clip(np.round((levels_db_sl - rule.low_db_sl) / rule.step_db).astype(np.int64), 0, table.levels.size - 1)
    found = [np.empty(levels_db_sl.shape[0]), np.empty(levels_db_sl.shape[0])]
    log_right, log_wrong = np.log(table.psi), np.log1p(-table.psi)
    for first in range(0, levels_db_sl.shape[0], _BATCH_RUNS):
        part, hit = place[first : first + _BATCH_RUNS], correct[first : first + _BATCH_RUNS]
        rows = np.arange(part.shape[0])[:, None]
        right, wrong = np.zeros((2, part.shape[0], table.levels.size))
        np.add.at(right, (rows, part), hit)
        np.add.at(wrong, (rows, part), ~hit)
        log_posterior = right @ log_right.T + wrong @ log_wrong.T + np.log(table.prior)
        posterior = np.exp(log_posterior - log_posterior.max(axis=1, keepdims=True))
        posterior /= posterior.sum(axis=1, keepdims=True)
        for column, values in zip(found, table.threshold(posterior), strict=True):
            column[first : first + _BATCH_RUNS] = values
    return found[0], found[1]
