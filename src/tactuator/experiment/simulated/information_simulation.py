"""Confusion matrices of a simulated subject who knows most answers and spreads the others evenly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactuator.errors import BadInput


def uniform_error_matrices(
    stimuli: int, error: float, trials_per_stimulus: int, runs: int, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Draw confusion matrices, (runs, stimuli, stimuli), of a subject who is right with probability 1 - error.

    All wrong answers are equally probable. Raises BadInput for fewer than two stimuli, a share outside [0, 1] or no
    trials.
    """
    if stimuli < 2 or not 0.0 <= error <= 1.0 or trials_per_stimulus < 1 or runs < 1:
        raise BadInput(
            f"{stimuli} stimuli, errors {error:g}, {trials_per_stimulus} trials, {runs} runs",
            "two or more, a share from 0 to 1, one or more, one or more",
        )
    chances = np.full((stimuli, stimuli), error / (stimuli - 1))
    np.fill_diagonal(chances, 1.0 - error)
    return np.asarray(rng.multinomial(trials_per_stimulus, chances, size=(runs, stimuli)))


def uniform_error_bits(stimuli: int, error: float) -> float:
    """Return the true information transfer of that subject: log2 k - H(e) - e log2(k - 1)."""
    shares = np.array([error, 1.0 - error])
    entropy = -float(np.sum(shares * np.log2(np.where(shares > 0.0, shares, 1.0))))
    return float(np.log2(stimuli)) - entropy - error * float(np.log2(stimuli - 1))
