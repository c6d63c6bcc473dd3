"""What an adaptive display has learnt of a finger: its weights and the time until they stay, and the felt level while a
finger lands.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.model.controller import Controller
from tactuator.model.description import Channel
from tactuator.rig.rig import Rig, with_felt
from tactuator.rig.simulated import SimulatedRig
from tactuator.signals.decibels import db, from_db
from tactuator.signals.multisine import multisine, odd_lines

STAYS = 0.3
"""A weight has settled once its mean over 0.1 s stays this near to that over the end of the play; a third of a weight
is felt as 0.8 dB at most."""
_PLAYED_S, _LAST_S, _PIECE_S, _SMOOTHED = 3.0, 1.0, 0.02, 5
"""Of the play: its length, the end that is averaged, and pieces between two looks; five of them are 0.1 s."""
_BAND_HZ, _LINES = (5.0, 250.0), 16
"""To separate mass from spring: lines on both sides of their resonance, about 9 Hz."""


@runtime_checkable
class LearningRig(Protocol):
    """A rig that reports the finger weights of its channels, at the end of a block if it waits there."""

    def weights(self) -> FloatArray:
        """Return the weights of the finger's mass and of its damping with stiffness, (channels, 2)."""
        ...


@dataclass(frozen=True)
class Learnt:
    """Weights of a channel after settling: the mean over the last second, (mass, damping with stiffness).

    settled_s: seconds of sound until the mean over 0.1 s of both stays within 0.3 of it; None if they never did, or if
    the rig does not report weights or does not wait meanwhile.
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
    adaptive = [k for k, channel in enumerate(controller.channels) if channel.feed_forward is not None]
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
    current, waits = rig.weights, rig.waits
    piece = round(_PIECE_S * rig.rate_hz)
    pieces = [reference[start : start + piece] for start in range(0, len(reference), piece)]
    traces = (rig.play(part) for part in pieces) if waits else rig.stream(pieces)
    weights = np.array([current() for _ in traces])
    return tuple(_learnt(rig.channels[k], weights[:, k], waits) for k in adaptive)


def _learnt(channel: str, weights: FloatArray, waits: bool) -> Learnt:
    """Return what a channel has learnt by weights (pieces, 2); where the rig does not wait, without the time."""
    last = weights[-round(_LAST_S / _PIECE_S) :]
    mean = last.mean(axis=0)
    sums = np.cumsum(np.vstack([np.zeros((1, 2)), weights]), axis=0)
    smooth = (sums[_SMOOTHED:] - sums[:-_SMOOTHED]) / _SMOOTHED
    away = np.flatnonzero(np.any(np.abs(smooth - mean) > STAYS, axis=1))
    settled = _SMOOTHED if away.size == 0 else int(away[-1]) + 1 + _SMOOTHED
    weight = (float(mean[0]), float(mean[1]))
    return Learnt(channel, weight, settled * _PIECE_S if waits and settled < weights.shape[0] else None)


LANDS_S, LIFTED_S, _ENDS_S = 1.0, 2.0, 3.0
"""When the finger lands and is lifted, and when the play ends."""
_WINDOW_S, _STEP_S = 0.1, 0.005
"""Windows in which what is felt is averaged, and from one to the next."""


@dataclass(frozen=True, eq=False)
class Landing:
    """Change of the felt level against the same run free, dB, at the middles time_s (n,) of windows of 0.1 s."""

    channel: str
    load: str
    time_s: FloatArray
    adaptive_db: FloatArray
    fixed_db: FloatArray


def landing(controller: Controller, channel: str, seed: int = 0, level_db_sl: float = 30.0) -> Landing:
    """Play five tones (those inside the band) at `level_db_sl` each while the channel's first load lands after 1 s and
    is lifted after 2 s; return what is felt of it with the channel's feed-forward, and without.

    Felt is the displacement through the threshold's curve over its band.
    """
    shown = controller.display.channel(channel)
    rate, load = controller.rate_hz, shown.loads[0].name
    low, high = shown.threshold.band_hz
    time = np.arange(round(_ENDS_S * rate)) / rate
    # over the band, each three times the one before
    tones = [hertz for hertz in (3.0, 9.0, 27.0, 85.0, 250.0) if low <= hertz <= high]
    asked = float(from_db(level_db_sl)) * np.sum(
        [np.sin(2.0 * np.pi * hertz * time + hertz) for hertz in tones], axis=0
    )
    fixed = replace(controller, channels=tuple(replace(each, feed_forward=None) for each in controller.channels))
    runs = [_felt(played, shown, asked, on, seed) for played, on in ((fixed, None), (fixed, load), (controller, load))]
    free, still, learnt = runs
    middle = np.asarray(np.arange(free.size) * _STEP_S + 0.5 * _WINDOW_S, dtype=np.float64)
    return Landing(channel, load, middle, db(learnt / free), db(still / free))


def _felt(controller: Controller, channel: Channel, asked: FloatArray, load: str | None, seed: int) -> FloatArray:
    """Return the felt rms, threshold units, in windows of 0.1 s every 5 ms, (n,)."""
    rate = controller.rate_hz
    moved: list[FloatArray] = []
    with SimulatedRig(controller.display, seed) as rig:
        column = rig.channels.index(channel.name)
        rig.load(controller)
        reference = np.zeros((asked.size, len(rig.channels)))
        reference[:, column] = asked
        cuts = [0, round(LANDS_S * rate), round(LIFTED_S * rate), asked.size]
        for on, start, stop in zip((None, load, None), cuts, cuts[1:], strict=False):
            rig.finger(channel.name).touch(on)
            moved += [felt[:, column] for _, felt in with_felt(rig, rig.stream([reference[start:stop]]))]
    volts = channel.sensor_gain_v_per_mm * np.concatenate(moved)
    frequency = np.fft.rfftfreq(volts.size, 1.0 / rate)
    low, high = channel.threshold.band_hz
    inside = (frequency >= low) & (frequency <= high)
    weight = np.zeros(frequency.size)
    weight[inside] = 1.0 / channel.threshold_voltage(frequency[inside])
    sums = np.concatenate([[0.0], np.cumsum(np.fft.irfft(np.fft.rfft(volts) * weight, volts.size) ** 2)])
    window, step = round(_WINDOW_S * rate), max(1, round(_STEP_S * rate))
    return np.asarray(np.sqrt((sums[window:] - sums[:-window]) / window)[::step])
