"""Loud catch trials among the trials of simulated runs, drawn by lot as in a session."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.experiment.result.catch import inattentive
from tactuator.perception.curve import COMFORT_DB_SL

_ABOVE_DB = 20.0
"""Level of a loud trial above the procedure's next level, as protocols have it unless they say otherwise."""


@dataclass(frozen=True)
class WithLoud:
    """Order of all trials of several runs, each (runs, trials).

    own: index of the procedure's trial that is played or, at a loud trial, is next. loud: True at loud trials. there:
    False where a run was over.
    """

    own: NDArray[np.intp]
    loud: NDArray[np.bool_]
    there: NDArray[np.bool_]

    def levels(self, own_db: FloatArray, highest_db: FloatArray | float = COMFORT_DB_SL) -> FloatArray:
        """Return the level of every trial, NaN where a run was over; own_db: of the procedure's, (runs, own trials)."""
        level = np.take_along_axis(own_db, self.own, axis=1)
        return np.where(self.there, np.where(self.loud, np.minimum(level + _ABOVE_DB, highest_db), level), np.nan)

    def outcomes(self, own: NDArray[np.bool_], loud: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return the outcome of every trial: the procedure's, (runs, own trials), or a loud one's, (runs, trials)."""
        found = np.where(self.loud, loud, np.take_along_axis(own, self.own, axis=1))
        return np.asarray(found & self.there)

    def attention(self, run: int, correct: NDArray[np.bool_]) -> tuple[str, ...]:
        """Return the flag `attention` where the run missed too many of its loud trials; correct: (runs, trials)."""
        loud = self.loud[run]
        return ("attention",) if inattentive(int(np.sum(loud & ~correct[run])), int(loud.sum())) else ()


def with_loud_trials(trials: NDArray[np.int64], share: float, rng: np.random.Generator) -> WithLoud:
    """Return runs of the procedure's trials (their number in each run, (runs,)) with loud ones among them.

    share: probability that a trial is loud. A run ends with the last trial of its procedure.
    """
    runs, most = trials.size, int(trials.max())
    before = np.zeros((runs, most), dtype=np.int64) if share == 0.0 else rng.geometric(1.0 - share, (runs, most)) - 1
    played = np.where(np.arange(most) < trials[:, None], before + 1, 0)
    total = played.sum(axis=1)
    own = np.zeros((runs, int(total.max())), dtype=np.intp)
    loud = np.zeros(own.shape, dtype=np.bool_)
    for run in range(runs):
        order = np.repeat(np.arange(most), played[run])
        own[run, : total[run]] = order
        loud[run, : total[run] - 1] = order[1:] == order[:-1]
    return WithLoud(own, loud, np.arange(own.shape[1]) < total[:, None])
