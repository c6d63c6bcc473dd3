"""Active speech level as in ITU-T P.56, method B, with the share of time that it counts; what is no speech is left out.

A click or thump would raise P.56's level of a whole utterance. Frames OUTSTANDING_DB above the level of all
others, and the two beside each, are taken for such, left out and reported. What may be one, or speech, is counted as in
P.56 and reported.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from tactuator.arrays import FloatArray

ENVELOPE_S, HANGOVER_S, MARGIN_DB = 0.03, 0.2, 15.9
"""Time constant of the envelope (twice), hangover and margin of P.56, method B."""
OUTSTANDING_DB, FRAME_S = 13.0, 0.025
"""Loudest frames of 25 ms of speech are 5 to 9 dB above its active level, and up to 12 below 290 Hz."""
TRIMMED_SHARE, MOST_SHARE = 0.1, 0.15
"""A thump may hide all speech from P.56: the first guess is of what the loudest tenth of the frames leaves. More than
15 % is no exception."""
LONGEST_KNOCK_S = 0.3
"""Frames above the rest for longer are words between pauses: a knock, and the two frames beside it, are shorter."""
STEADY_S, STEADY_DB = 2.0, 3.5
"""Reported: so long without a tenth of the frames that far below the level. Hum and noise as strong as the speech are
at most 3.5 dB below the level of both; within two seconds of thirty recordings of speech it falls by 4 and more."""
NEAR_DB, RAISED_DB, HIDES_DB, FAINT_DB = 9.5, 0.8, 8.0, 45.0
"""Reported: frames from the first on that, with the two beside each, raise the level by the second; a loudest tenth
without which the level is lower by the third, but by less than the last: below it is no speech."""
LOUDEST_S, WARNED_DB = 0.1, 15.0
_THRESHOLDS = 2.0 ** np.arange(-40, 31)
"""P.56 steps by 2; this many, since codings have different scales."""
_PASSES = 5
"""Until the same frames are left out twice; two of speech. Each leaves out fewer."""

Blocks = Callable[[], Iterator[FloatArray]]


@dataclass(frozen=True)
class ActiveLevel:
    """Level of a sinusoid of the active rms, dB re 1, of the loudest channel; -inf for silence. share: of the time that
    is active, 0 to 1. notes: what was left out, and what is far above the rest.
    """

    level_db: float
    share: float
    notes: tuple[str, ...] = ()


def active_level(blocks: Blocks, rate_hz: float) -> ActiveLevel:
    """Return the active level of a signal that is given anew, (n, channels) a block, at each call of `blocks`."""
    frame = round(FRAME_S * rate_hz)
    whole = np.concatenate(list(_frame_powers(blocks(), frame)))

    def level_without(left_out: NDArray[np.bool_]) -> tuple[float, float, FloatArray]:
        levels = _levels(_without(blocks(), left_out, frame), rate_hz)
        best = int(np.argmax([level for level, _ in levels]))
        return *levels[best], 10.0 * np.log10(np.maximum(2.0 * whole[:, best], 1e-300))

    loudest = whole.max(axis=1)
    tenth = np.sort(loudest)[-max(1, round(TRIMMED_SHARE * len(loudest)))]
    quiet_db, _, power_db = level_without(_and_beside(loudest >= tenth))
    left_out = _outstanding(power_db - quiet_db)
    for _ in range(_PASSES):
        level_db, share, power_db = level_without(left_out)
        still = left_out & _outstanding(power_db - level_db)
        if (still == left_out).all():
            break
        left_out = still
    else:
        left_out = np.zeros_like(left_out)
        level_db, share, power_db = level_without(left_out)
    notes = _notes(power_db - level_db, left_out, level_db - quiet_db) if np.isfinite(level_db) else ()
    return ActiveLevel(level_db, share, tuple(notes))


def _and_beside(frames: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return np.asarray(np.convolve(frames, np.ones(3), "same")[: len(frames)] > 0.0)


def _outstanding(above_db: FloatArray) -> NDArray[np.bool_]:
    """Return the frames that are no speech, by their dB above the level of the others."""
    frames = _and_beside(above_db > OUTSTANDING_DB)
    edges = np.flatnonzero(np.diff(np.r_[False, frames, False]))
    for begin, end in edges.reshape(-1, 2):
        if (end - begin) * FRAME_S > LONGEST_KNOCK_S:
            frames[begin:end] = False
    return frames if frames.mean() <= MOST_SHARE else np.zeros_like(frames)


def _notes(above_db: FloatArray, left_out: NDArray[np.bool_], quieter_db: float) -> Iterator[str]:
    """Yield what to know of a level. above_db: of each frame; quieter_db: by how much the first guess was lower."""
    power, run = 10.0 ** (above_db / 10.0), round(LOUDEST_S / FRAME_S)
    means = np.convolve(power, np.ones(run) / run, "valid") if len(power) >= run else power
    loudest_db, at_s = float(10.0 * np.log10(means.max(initial=1e-300))), float(np.argmax(means)) * FRAME_S
    counted = np.where(left_out, 0.0, power)
    near = _and_beside(counted > 10.0 ** (NEAR_DB / 10.0))
    raised_db = -10.0 * np.log10(max(1.0 - counted[near].sum() / counted.sum(), 1e-30))
    if left_out.any():
        seconds = FRAME_S * float(left_out.sum())
        yield f"{seconds:.3g} s are more than {OUTSTANDING_DB:g} dB above the rest, and were left out of its level"
    elif HIDES_DB < quieter_db < FAINT_DB:
        yield f"without its loudest tenth the level is {quieter_db:.0f} dB lower: a knock? cut it out"
    if raised_db > RAISED_DB:
        seconds = FRAME_S * float(near.sum())
        words = f"{seconds:.3g} s, the loudest at {at_s:.3g} s, raise its level by {raised_db:.1f} dB"
        yield f"{words}: a knock? cut it out"
    if loudest_db > WARNED_DB:
        words = f"the loudest {1e3 * LOUDEST_S:.0f} ms, at {at_s:.3g} s, are {loudest_db:.0f} dB above the level"
        yield f"{words}: a knock? cut it out"
    window = round(STEADY_S / FRAME_S)
    if len(above_db) >= window:
        least_db = np.percentile(
            np.lib.stride_tricks.sliding_window_view(above_db, window)[:: window // 10], 10, axis=1
        )
        if (steady := least_db > -STEADY_DB).any():
            at_s = float(np.argmax(steady)) * (window // 10) * FRAME_S
            yield f"from {at_s:.3g} s on it hardly falls for {STEADY_S:g} s: hum, noise or a tone in its level?"


def _frame_powers(blocks: Iterator[FloatArray], frame: int) -> Iterator[FloatArray]:
    """Yield the mean power of each frame, (frames, channels); the last may be a part of one."""
    rest: FloatArray | None = None
    for block in blocks:
        block = block if rest is None else np.concatenate((rest, block))
        whole = len(block) // frame
        parts = block[: whole * frame].reshape(whole, frame, block.shape[1])
        yield np.einsum("ijk,ijk->ik", parts, parts) / frame
        rest = block[whole * frame :]
    if rest is not None and len(rest):
        yield (rest**2).mean(axis=0, keepdims=True)


def _without(blocks: Iterator[FloatArray], left_out: NDArray[np.bool_], frame: int) -> Iterator[FloatArray]:
    """Yield the signal with silence in place of the frames left out."""
    at = 0
    for block in blocks:
        gone = left_out[np.minimum((at + np.arange(len(block))) // frame, len(left_out) - 1)]
        at += len(block)
        yield np.where(gone[:, None], 0.0, block)


def _levels(blocks: Iterator[FloatArray], rate_hz: float) -> list[tuple[float, float]]:
    """Return of each channel the active level, dB, and the share of time that is active."""
    smooth, hang = float(np.exp(-1.0 / (ENVELOPE_S * rate_hz))), round(HANGOVER_S * rate_hz)
    energy, frames, counts, last, states = np.zeros(1), 0, np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(1)
    for block in blocks:
        if not len(block):
            continue
        if not frames:
            width = block.shape[1]
            energy, states = np.zeros(width), np.zeros((2, 1, width))
            counts, last = np.zeros((width, len(_THRESHOLDS))), np.full((width, len(_THRESHOLDS)), -hang - 1)
        envelope = np.abs(block)
        for stage in range(2):
            state = states[stage]
            envelope, states[stage] = scipy.signal.lfilter([1.0 - smooth], [1.0, -smooth], envelope, axis=0, zi=state)
        for channel in range(block.shape[1]):
            _count(envelope[:, channel], frames, hang, counts[channel], last[channel])
        energy += np.einsum("ij,ij->j", block, block)
        frames += len(block)
    return [_crossing(power, count, frames) for power, count in zip(energy, counts, strict=True)]


def _count(envelope: FloatArray, begun: int, hang: int, counts: FloatArray, last: FloatArray) -> None:
    """Add to each threshold's count the samples at which the envelope reaches it, or did so less than the hangover ago.

    last: of each threshold, the sample at which it was reached last.
    """
    time, least, most = np.arange(begun, begun + len(envelope)), envelope.min(), envelope.max()
    for k, threshold in enumerate(_THRESHOLDS):
        if threshold > most:
            counts[k] += max(0, min(int(last[k]) + hang + 1 - begun, len(envelope)))
            continue
        if threshold <= least:
            counts[k] += len(envelope)
            last[k] = time[-1]
            continue
        since = np.maximum.accumulate(np.where(envelope >= threshold, time, last[k]))
        counts[k] += int(np.count_nonzero(time - since <= hang))
        last[k] = since[-1]


def _crossing(energy: float, counts: FloatArray, frames: int) -> tuple[float, float]:
    """Return the level at which it is MARGIN_DB above its threshold, between the two thresholds about it."""
    if energy <= 0.0 or not frames:
        return -np.inf, 0.0
    active = counts > 0
    levels = 10.0 * np.log10(2.0 * energy / counts[active])
    above = levels - 20.0 * np.log10(np.sqrt(2.0) * _THRESHOLDS[active]) - MARGIN_DB
    first = int(np.argmax(above <= 0.0)) if (above <= 0.0).any() else len(above) - 1
    pair = slice(max(first - 1, 0), first + 1)
    level = float(np.interp(0.0, above[pair][::-1], levels[pair][::-1]))
    return level, min(1.0, float(2.0 * energy / frames / 10.0 ** (level / 10.0)))
