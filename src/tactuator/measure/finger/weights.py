"""The weights that an adaptive display has learnt of a finger, and the time until they stay."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.model.controller import Controller
from tactuator.rig.rig import Rig
from tactuator.signals.decibels import from_db
from tactuator.signals.multisine import multisine, odd_lines

STAYS = 0.3
"""A weight has settled once its mean over 0.1 s stays this near to that over the end of the play; a third of a weight
is felt as 0.8 dB at most."""
_PLAYED_S, _LAST_S, _PIECE_S = 3.0, 1.0, 0.02
_SMOOTHED = 5
_BAND_HZ, _LINES = (5.0, 250.0), 16


@runtime_checkable
class LearningRig(Rig, Protocol):
    """A rig that tells the weights which its channels have learnt of a finger."""

    @property
    def waits(self) -> bool:
        """Return True where time stands still between blocks, so that weights are those at a block's end."""
        ...

    def weights(self) -> FloatArray:
        """Return the weights of the finger's mass and of its damping with stiffness, (channels, 2)."""
        ...


@dataclass(frozen=True)
class Learnt:
    """Weights of a channel after settling: the mean over the last second, (mass, damping with stiffness).

    settled_s: seconds of sound until the mean over 0.1 s of both stays within 0.3 of it; None where they never did, or
    the rig does not tell, or its time goes on while it is asked.
    """

    channel: str
    weight: tuple[float, float] | None
    settled_s: float | None


def settle_weights(
    rig: Rig, controller: Controller, level_db_sl: float, rng: np.random.Generator
) -> tuple[Learnt, ...]:
    """Play three seconds of a multisine, `level_db_sl` together, for the loaded controller to learn what touches.

    Return what each adaptive channel has learnt. Nothing is played where no channel is adaptive.
    """
    adaptive = [k for k, own in enumerate(controller.channels) if own.feed_forward is not None]
    if not adaptive:
        return ()
    period = round(rig.rate_hz)
    lines = odd_lines(_BAND_HZ, rig.rate_hz, period, _LINES, rng)
    peak = float(from_db(level_db_sl)) / np.sqrt(lines.size)
    wave = np.tile(multisine(rig.rate_hz, period, lines, peak, rng).one_period(), round(_PLAYED_S))
    reference = np.zeros((wave.size, len(rig.channels)))
    reference[:, adaptive] = wave[:, None]
    if not isinstance(rig, LearningRig):
        rig.play(reference)
        return tuple(Learnt(rig.channels[k], None, None) for k in adaptive)
    told = _told(rig, reference)
    return tuple(_learnt(rig.channels[k], told[:, k], rig.waits) for k in adaptive)


def _told(rig: LearningRig, reference: FloatArray) -> FloatArray:
    """Play a reference and return the weights that were told meanwhile, one for each piece: (pieces, channels, 2)."""
    piece = round(_PIECE_S * rig.rate_hz)
    pieces = [reference[start : start + piece] for start in range(0, len(reference), piece)]
    traces = (rig.play(each) for each in pieces) if rig.waits else rig.stream(pieces)
    return np.array([rig.weights() for _ in traces])


def _learnt(channel: str, told: FloatArray, waits: bool) -> Learnt:
    """Return what a channel has learnt by weights (pieces, 2); where the rig does not wait, without the time."""
    last = told[-round(_LAST_S / _PIECE_S) :]
    mean = last.mean(axis=0)
    sums = np.cumsum(np.vstack([np.zeros((1, 2)), told]), axis=0)
    smooth = (sums[_SMOOTHED:] - sums[:-_SMOOTHED]) / _SMOOTHED
    away = np.flatnonzero(np.any(np.abs(smooth - mean) > STAYS, axis=1))
    settled = _SMOOTHED if away.size == 0 else int(away[-1]) + 1 + _SMOOTHED
    weight = (float(mean[0]), float(mean[1]))
    return Learnt(channel, weight, settled * _PIECE_S if waits and settled < told.shape[0] else None)
