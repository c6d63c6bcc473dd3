"""A limiter for a live signal: 5 ms of look-ahead, and limits that are kept by construction.

At every moment there is a plan, in which the signal fades out within the look-ahead, and a prediction of what the
display does under it: the felt signal, displacement and command of `all_limits`. No prediction of the plan is beyond
its limit. The next block is a mixture of that plan and of the signal at the gain that is wanted (with a fade of its own
behind it), with the greatest share of the latter that keeps every limit: the prediction is linear, the share follows
from a division, and without any the plan goes on, which is within all limits. A plan's responses are followed for some
tenths of a second; for what comes later, each limit is lower by the most that the greatest reference can make of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.model.controller import Controller
from tactuator.speech.limiter import MEMORY_S, RELEASE_DB_PER_MS, all_limits

Samples = NDArray[np.floating[Any]]
LOOK_AHEAD_S = 0.005
HORIZONS_S, LATER_SHARE, MOST_LATER_SHARE = (0.125, 0.25, 0.5, 1.0), 0.15, 0.5
"""Responses are followed for the shortest time after which no more than the first share of a limit is left to come; at
the longest, the greatest reference is lowered until no more than the second is."""
BEFORE_SHARE = 0.2
"""The threshold's weight has zero phase: so much of the horizon is followed before a sample."""
WAITING = 3
"""Blocks whose effect may wait, while the most that it can be keeps every limit: one transform then does for all."""
LEAST_GAIN = 0.01
"""A gain that comes back begins here, 40 dB down."""


@dataclass(frozen=True, eq=False)
class Horizon:
    """The limits of all channels, followed from `before` samples before a sample to `after` samples after it.

    peak: of the reference, (channels,). kernels: (constraints, before + after). limit: (constraints,). channel: of each
    constraint.
    """

    before: int
    after: int
    peak: FloatArray
    kernels: NDArray[np.float32]
    limit: FloatArray
    channel: NDArray[np.intp]


def horizon_of(controller: Controller) -> Horizon:
    """Return the limits of a controller's channels, those apart that no reference within its peak can reach."""
    rate_hz, size = controller.rate_hz, round(MEMORY_S * controller.rate_hz)
    each = [all_limits(controller, channel.name, size) for channel in controller.display.channels]
    peak = np.array([most for most, _ in each])
    channel = np.repeat(np.arange(len(each)), [len(asked) for _, asked in each])
    limit = np.array([constraint.limit for _, asked in each for constraint in asked])
    response = scipy.fft.irfft(np.stack([constraint.response for _, asked in each for constraint in asked]), size)
    whole = np.abs(response).sum(axis=1)
    for seconds in HORIZONS_S:
        after = round(seconds * rate_hz)
        before = round(BEFORE_SHARE * after)
        kernels = np.hstack((response[:, -before:], response[:, :after]))
        later = whole - np.abs(kernels).sum(axis=1)
        if (later * peak[channel] <= LATER_SHARE * limit).all():
            break
    np.minimum.at(peak, channel, MOST_LATER_SHARE * limit / np.maximum(later, 1e-300))
    reached = whole * peak[channel] > limit
    lowered = (limit - later * peak[channel])[reached]
    return Horizon(before, after, peak, kernels[reached].astype(np.float32), lowered, channel[reached])


class LiveLimiter:
    """Limits blocks of `block` rows (block, channels) for a controller; they come out LOOK_AHEAD_S later.

    max_reduction_db: of the peak of a block, so far; what is below threshold is not felt, and does not count. reduced:
    rows in which something felt was taken back.
    """

    def __init__(self, controller: Controller, block: int) -> None:
        self._limits = horizon_of(controller)
        self._block, self.look_ahead = block, round(LOOK_AHEAD_S * controller.rate_hz)
        self._rise = 10.0 ** (RELEASE_DB_PER_MS * 1e3 / controller.rate_hz / 20.0)
        length = self.look_ahead + (1 + WAITING) * block
        self._reach = self._limits.before + self._limits.after + length - 1
        self._size = int(scipy.fft.next_fast_len(self._reach, real=True))
        self._responses = scipy.fft.rfft(self._limits.kernels, self._size)
        sums = np.pad(np.abs(self._limits.kernels).cumsum(axis=1), ((0, 0), (length, 0)))
        self._most_effect = (sums[:, length:] - sums[:, :-length]).max(axis=1)
        fade = 0.5 + 0.5 * np.cos(np.pi * (np.arange(self.look_ahead) + 0.5) / self.look_ahead)
        self._window = np.concatenate((np.ones(block), fade))
        self._fresh = self._window - self._planned(self._window)
        self.max_reduction_db, self.reduced = 0.0, 0
        self.reset()

    def reset(self) -> None:
        """Begin again with a display at rest."""
        channels = len(self._limits.peak)
        self._waiting = np.zeros((channels, self.look_ahead))
        self._gains, self._untouched = np.tile(self._window, (channels, 1)), True
        self._predicted = np.zeros((len(self._limits.limit), self._reach), np.float32)
        self._most = np.zeros(len(self._limits.limit))
        self._forget_waiting()

    def _forget_waiting(self) -> None:
        self._late = np.zeros((len(self._gains), self.look_ahead + (1 + WAITING) * self._block))
        self._late_blocks = 0

    def _planned(self, gains: FloatArray) -> FloatArray:
        """Return the gains that a plan has for the next block and the look-ahead behind it."""
        return np.concatenate((gains[..., self._block :], np.zeros((*gains.shape[:-1], self._block))), axis=-1)

    def push(self, rows: FloatArray) -> FloatArray:
        """Return the rows of LOOK_AHEAD_S before, limited."""
        signal = np.concatenate((self._waiting, rows.T), axis=1)
        self._waiting = signal[:, self._block :]
        if self._untouched and self._passes(signal):
            return signal[:, : self._block].T
        if self._late_blocks:
            self._predict(self._predicted + self._effect(self._late), self._late_blocks)
        plan, now = self._planned(self._gains), np.maximum(self._gains[:, self._block - 1], LEAST_GAIN)[:, None]
        wanted = np.minimum(1.0, now * self._rise ** np.arange(1, signal.shape[1] + 1)) * self._window
        effect = self._effect(signal * (wanted - plan))
        excess = self._excess(signal * wanted, self._predicted + effect)
        if (excess > 1.0).any():  # less of it, before any of it is given up
            line = np.minimum(1.0, np.arange(1, signal.shape[1] + 1) / self._block)
            lower = now * (1.0 - line * (1.0 - 1.0 / excess[:, None])) * self._window
            wanted = np.where(excess[:, None] > 1.0, lower, wanted)
            effect = self._effect(signal * (wanted - plan))
        share = self._share(signal * plan, signal * (wanted - plan), effect)
        self._predict(self._predicted + share[self._limits.channel, None].astype(np.float32) * effect, 1)
        return self._commit(signal, np.where(share[:, None] == 1.0, wanted, plan + share[:, None] * (wanted - plan)))

    def _passes(self, signal: FloatArray) -> bool:
        """Return whether a block keeps every limit untouched; its effect is then predicted, now or later."""
        if (np.abs(signal).max(axis=1) > self._limits.peak).any():
            return False
        late, at = self._late.copy(), self._late_blocks * self._block
        late[:, at : at + signal.shape[1]] += signal * self._fresh
        most = self._most + np.abs(late).max(axis=1)[self._limits.channel] * self._most_effect
        if self._late_blocks < WAITING and (most <= self._limits.limit).all():
            self._late, self._late_blocks = late, self._late_blocks + 1
            return True
        predicted = self._predicted + self._effect(late)
        if (self._excess(signal, predicted) > 1.0).any():
            return False
        self._predict(predicted, self._late_blocks + 1)
        return True

    def _predict(self, predicted: Samples, blocks: int) -> None:
        """Take up a prediction, of which so many blocks are over."""
        over = blocks * self._block
        self._predicted[:, :-over] = predicted[:, over:]
        self._predicted[:, -over:] = 0.0
        self._most = np.maximum(self._predicted.max(axis=1), -self._predicted.min(axis=1))
        self._forget_waiting()

    def _effect(self, change: FloatArray) -> Samples:
        """Return what a change of the plan adds to each prediction."""
        spectrum = scipy.fft.rfft(change.astype(np.float32), self._size)[self._limits.channel] * self._responses
        effect: Samples = scipy.fft.irfft(spectrum, self._size)[:, : self._reach]
        return effect

    def _excess(self, reference: FloatArray, predicted: Samples) -> FloatArray:
        """Return, by channel, the greatest ratio to a limit."""
        excess = np.maximum(reference.max(axis=1), -reference.min(axis=1)) / self._limits.peak
        most = np.maximum(predicted.max(axis=1), -predicted.min(axis=1)) / self._limits.limit
        np.maximum.at(excess, self._limits.channel, most)
        return np.asarray(excess)

    def _share(self, planned: FloatArray, change: FloatArray, effect: Samples) -> FloatArray:
        """Return the greatest share of the change, from 0 to 1, with which each channel keeps its limits."""
        share = _room(planned, change, self._limits.peak)
        np.minimum.at(share, self._limits.channel, _room(self._predicted, effect, self._limits.limit))
        return share

    def _commit(self, signal: FloatArray, gains: FloatArray) -> FloatArray:
        block, self._gains, self._untouched = self._block, gains, bool((gains == self._window).all())
        came, out = np.abs(signal[:, :block]), (signal * gains)[:, :block]
        self.reduced += int(np.count_nonzero(((gains[:, :block] < 1.0) & (came > 1.0)).any(axis=0)))
        left = np.maximum(np.abs(out).max(axis=1), 1.0)
        taken = float((np.maximum(came.max(axis=1), 1.0) / left).max())
        self.max_reduction_db = max(self.max_reduction_db, 20.0 * float(np.log10(taken)))
        return np.asarray(out.T)


def _room(value: Samples, change: Samples, limit: FloatArray) -> FloatArray:
    """Return, row by row, the greatest share in 0 to 1 with which |value + share x change| <= limit."""
    room = np.ones(len(value))
    reached = value + change
    for row in np.flatnonzero((reached.max(axis=1) > limit) | (reached.min(axis=1) < -limit)):
        left = np.maximum(limit[row] - np.sign(change[row]) * value[row], 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = np.where(change[row] != 0.0, left / np.abs(change[row]), 1.0)
        room[row] = min(1.0, float(shares.min()))
    return room
