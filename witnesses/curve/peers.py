"""Two other ways to measure a curve, written anew: independent Bayesian tracks, and a parametric two-channel curve.

Both keep a posterior on a grid and place a trial where their own estimate is; neither uses anything of the program.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from witnesses.curve.people import BAND_HZ, GUESS, TARGET, Floats

Answers = Callable[[Floats, Floats, int], NDArray[np.bool_]]
"""Frequency, level (people,) each, and the trial's number to who is right."""

_LAPSE, _SLOPES = 0.02, np.array([1.2, 2.0, 3.2])
_PLACED_DB = np.array([2.0, -1.0, 4.0])
"""Levels above the estimate at which trials are put in turn."""


def _psi(above_db: Floats, slope: Floats) -> Floats:
    at_threshold = (TARGET - GUESS) / (1.0 - GUESS - _LAPSE)
    rise = -np.expm1(np.log1p(-at_threshold) * 10.0 ** (np.clip(slope * above_db, -200.0, 60.0) / 20.0))
    return np.asarray(GUESS + (1.0 - GUESS - _LAPSE) * rise)


def _normalised(posterior: Floats) -> Floats:
    flat = posterior.reshape(len(posterior), -1)
    return np.asarray(posterior / flat.sum(axis=1).reshape(-1, *[1] * (posterior.ndim - 1)))


def tracks(answers: Answers, people: int, trials: int, asked_hz: Floats) -> tuple[Floats, Floats]:
    """Return mean and standard deviation at the frequencies asked, (people, n) each, of twelve tracks of their own.

    Between the tracks the curve is a line over log frequency.
    """
    hertz = np.geomspace(*BAND_HZ, 12)
    level = np.arange(-40.0, 70.0, 1.0)
    prior = np.exp(-0.5 * (level / 15.0) ** 2)
    posterior = np.tile(prior[:, None], (people, hertz.size, 1, _SLOPES.size))
    row = np.arange(people)
    for trial in range(trials):
        track = trial % hertz.size
        mine = _normalised(posterior[:, track])
        at = mine.sum(axis=2) @ level + _PLACED_DB[trial // hertz.size % 3]
        right = answers(np.full(people, hertz[track]), at, trial)
        psi = _psi(at[:, None, None] - level[:, None], _SLOPES)
        posterior[row, track] = mine * np.where(right[:, None, None], psi, 1.0 - psi)
    each = posterior / posterior.sum(axis=(2, 3), keepdims=True)
    marginal = each.sum(axis=3)
    mean = marginal @ level
    sd = np.sqrt(np.maximum(marginal @ level**2 - mean**2, 0.0))
    where = np.log(asked_hz), np.log(hertz)
    between = [np.array([np.interp(*where, row) for row in table]) for table in (mean, sd)]
    return between[0], between[1]


def two_channels(answers: Answers, people: int, trials: int, asked_hz: Floats) -> tuple[Floats, Floats]:
    """Return mean and standard deviation, (people, n) each, of a curve that has a loss above a knee, and one below.

    The loss above the knee of 40 Hz rises by 12 dB an octave until it meets its size, or the loss below, if greater.
    """
    below, above = np.arange(-12.0, 46.0, 2.0), np.arange(-12.0, 46.0, 2.0)

    def curves(hertz: Floats) -> Floats:
        """(below, above, n)"""
        gap = 12.0 * np.maximum(np.log2(hertz / 40.0), 0.0)
        most = below[:, None, None] + gap
        shape = np.where(hertz > 40.0, np.minimum(above[None, :, None], most), below[:, None, None])
        return np.asarray(shape)

    posterior = np.ones((people, below.size, above.size, _SLOPES.size))
    hertz = np.geomspace(*BAND_HZ, 12)
    at_tracks = curves(hertz)
    for trial in range(trials):
        track = (5 * trial) % hertz.size
        curve = at_tracks[:, :, track]
        posterior = _normalised(posterior)
        at = np.einsum("pbas,ba->p", posterior, curve) + _PLACED_DB[trial % 3]
        right = answers(np.full(people, hertz[track]), at, trial)
        psi = _psi(at[:, None, None, None] - curve[..., None], _SLOPES)
        posterior = posterior * np.where(right[:, None, None, None], psi, 1.0 - psi)
    marginal, shape = _normalised(posterior).sum(axis=3), curves(asked_hz)
    mean = np.einsum("pba,ban->pn", marginal, shape)
    square = np.einsum("pba,ban->pn", marginal, shape**2)
    return mean, np.sqrt(np.maximum(square - mean**2, 0.0))
