"""Catch trials: loud ones that anyone attentive gets right, blank ones that nobody can."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom

from tactuator.experiment.store.stored_runs import StoredRun

_LAPSE_RATE = 0.03
_FALSE_ALARM_RATE = 0.02
"""A run is flagged where the errors in loud trials have a probability below _FALSE_ALARM_RATE at a lapse rate of
_LAPSE_RATE, or the right answers in blank ones have a probability below _FALSE_ALARM_RATE by chance."""


def catch_kinds(run: StoredRun) -> NDArray[np.str_]:
    """Return the kind of each trial, shape (trials,): "loud", "blank", or "" for trials that the procedure placed."""
    trials = run.correct.size
    each = run.intervals.saturated.size // max(trials, 1)
    if each == 0:
        return np.full(trials, "", dtype="<U5")
    seen = run.intervals
    loud, tone = (of[: trials * each].reshape(trials, each).any(axis=1) for of in (seen.is_loud, seen.is_tone))
    return np.where(loud, "loud", np.where(tone, "", "blank"))


def inattentive(missed: int, loud: int) -> bool:
    """Return whether more of the loud trials were missed than a lapse rate of 3 % explains."""
    return bool(loud and binom.sf(missed - 1, loud, _LAPSE_RATE) < _FALSE_ALARM_RATE)


def attention(run: StoredRun) -> tuple[str, ...]:
    """Return the flags of the catch trials.

    `attention` stands for too many errors in loud trials, `cue` for too many right answers where nothing was played.
    """
    kinds = catch_kinds(run)
    loud, blank = run.correct[kinds == "loud"], run.correct[kinds == "blank"]
    found = []
    if inattentive(int(np.sum(~loud)), loud.size):
        found.append("attention")
    if blank.size and binom.sf(np.sum(blank) - 1, blank.size, run.protocol.forced_choice().guess) < _FALSE_ALARM_RATE:
        found.append("cue")
    return tuple(found)
