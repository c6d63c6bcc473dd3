"""The live stream: from a source to the reference of a rig, block by block, as the rig asks for it.

source → resampler between two clocks → coding → gain and gate → fade of mute and end → limiter → rig
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.controller import Controller
from tactuator.signals.decibels import db
from tactuator.speech.coding import Coding, live_coding, stated_delay
from tactuator.speech.live.level import LevelSettings, LiveLevel
from tactuator.speech.live.limiter import LOOK_AHEAD_S, LiveLimiter
from tactuator.speech.live.resampling import ClockedResampler
from tactuator.speech.live.source import Source, cleaned

BLOCK_S = 0.004
BUFFER_S, PIECES = 0.0015, 1.5
"""Kept of the source at the earliest look: until the clocks' difference is known, and of its own pieces, which may be
late. A look of a busy machine is late as well, and finds more."""
FADE_S = 0.02
"""Of mute and end."""
HELD_S = 0.3
"""Time in which a level shown falls by 20 dB."""


USUAL = LevelSettings()


@dataclass(frozen=True)
class LiveState:
    """A live stream now.

    level_db_sl: peak of the reference by channel, falling slowly. fill_s, worst_s, drift, dropouts: see
    `ClockedResampler`. missed: how often the rig missed its time. not_numbers: samples of the source. taken_back_db,
    taken_back_s: by the limiter, so far.
    """

    seconds: float
    level_db_sl: Mapping[str, float]
    gain_db: float
    gate_open: bool
    muted: bool
    fill_s: float
    worst_s: float
    drift: float
    dropouts: int
    not_numbers: int
    taken_back_db: float
    taken_back_s: float
    missed: int = 0


class LiveStream:
    """A source as blocks of reference for a rig with `controller`.

    clock: seconds by the display's clock; None: the rows given so far, for a rig whose time waits for them. muted: to
    be set, at any time. stopped: whether `stop` was called. fault: of the source. Raises
    BadInput for a coding that cannot be causal, a display without its fingers, and a rate that is no whole number.
    """

    def __init__(
        self,
        source: Source,
        controller: Controller,
        coding: Coding,
        level: LevelSettings = USUAL,
        clock: Callable[[], float] | None = None,
    ) -> None:
        rate = controller.rate_hz
        if rate != int(rate):
            raise BadInput(f"display runs at {rate:g} Hz", "a whole number of hertz, for speech")
        self._names = tuple(channel.name for channel in controller.display.channels)
        self._placement = coding.placement(tuple(channel.finger for channel in controller.display.channels))
        self._source, self._clock, self._rate, self._block = source, clock, rate, max(1, round(BLOCK_S * rate))
        self._coding = live_coding(coding).live(int(rate), self._block)
        self.coding_delays = stated_delay(coding, self._coding)
        self._resampler = ClockedResampler(source.rate_hz, self._coding.rate_in_hz, BUFFER_S + PIECES * source.piece_s)
        self._level, self._limiter = LiveLevel(level, rate), LiveLimiter(controller, self._block)
        self._shown = np.zeros(len(self._names))
        self._rows = self._not_numbers = self._missed = 0
        self._fade, self._ending, self.stopped, self.muted = 1.0, False, False, False
        self.fault: Exception | None = None

    def delays(self) -> dict[str, float]:
        """Return the delay of each stage but the coding, seconds."""
        return {
            "source": getattr(self._source, "late_s", 0.0),
            "buffer": self._resampler.target_s,
            "resampler": self._resampler.delay_s,
            "block": self._block / self._rate,
            "limiter": self._limiter.look_ahead / self._rate,
        }

    def stop(self) -> None:
        """Fade out, and end."""
        self.stopped = True

    def lost(self) -> None:
        """Begin anew after the rig has missed its time: it is at rest."""
        self._missed += 1
        self._resampler.restart()
        self._limiter.reset()

    def blocks(self) -> Iterator[FloatArray]:
        """Yield blocks of reference (n, channels), threshold units, until the source has ended or `stop`."""
        left = self._tail_s()
        while left > 0.0:
            if self.stopped:
                left = min(left, FADE_S + LOOK_AHEAD_S)
            self._ending = left <= FADE_S + LOOK_AHEAD_S
            yield self._next()
            left -= self._block / self._rate if self._source.ended or self.stopped else 0.0

    def _tail_s(self) -> float:
        return sum(self.delays().values()) + max(self.coding_delays.values()) + FADE_S

    def _next(self) -> FloatArray:
        now_s = self._rows / self._rate if self._clock is None else self._clock()
        samples, bad = cleaned(self._read(now_s))
        self._not_numbers += bad
        self._resampler.push(samples)
        self._resampler.ended = self._source.ended
        sound = self._resampler.take(self._block * self._coding.rate_in_hz // int(self._rate))
        coded = self._coding.push(sound) @ self._placement
        if not np.isfinite(coded).all():  # a coding of another package
            coded = np.zeros(coded.shape)
        rows = self._limiter.push(self._faded(self._level.push(coded)))
        self._rows += len(rows)
        fall = 10.0 ** (-len(rows) / self._rate / HELD_S)
        self._shown = np.maximum(np.abs(rows).max(axis=0), fall * self._shown)
        return rows

    def _read(self, now_s: float) -> FloatArray:
        """Return what has come. Of a source that fails nothing comes any more, and the stream fades out."""
        if self.fault is None:
            try:
                return self._source.read(now_s)
            except Exception as fault:  # raised once the rig is at rest
                self.fault = fault
                self.stop()
        return np.zeros(0)

    def _faded(self, rows: FloatArray) -> FloatArray:
        towards = 0.0 if self.muted or self._ending else 1.0
        if self._fade == towards == 1.0:
            return rows
        step = np.sign(towards - self._fade) / (FADE_S * self._rate)
        line = np.clip(self._fade + step * np.arange(1, len(rows) + 1), 0.0, 1.0)
        self._fade = float(line[-1])
        return np.asarray(rows * (0.5 - 0.5 * np.cos(np.pi * line))[:, None])

    @property
    def state(self) -> LiveState:
        """Return the stream's state now."""
        with np.errstate(divide="ignore"):
            levels = dict(zip(self._names, db(self._shown).tolist(), strict=True))
        resampler, limiter = self._resampler, self._limiter
        return LiveState(
            self._rows / self._rate, levels, self._level.gain_db, self._level.open, self.muted, resampler.fill_s,
            resampler.worst_s, resampler.drift, resampler.dropouts, self._not_numbers, limiter.max_reduction_db,
            limiter.reduced / self._rate, self._missed,
        )  # fmt: skip
