"""Playing a reference on a rig: with progress, pause, a stop that ramps, and at rest on any fault."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.reference import ReferenceFile
from tactuator.perception.curve import COMFORT_DB_SL
from tactuator.rig.rig import COMFORT_TOLERANCE, Rig
from tactuator.signals.decibels import from_db

BLOCK_S = 0.05
"""A wish is heard between two blocks: later by 50 ms is as at once for a person who presses a key."""
RAMP_S = 0.1
"""A pause and a stop fade so long, which makes no click."""

Wish = Literal["run", "pause", "stop"]


@dataclass(frozen=True)
class Played:
    """Extent of a playing. saturated_s: time in which a limit was reached (`Trace.saturated`)."""

    duration_s: float
    played_s: float
    paused_s: float
    stopped: bool
    saturated_s: float


def check_reference(reference: ReferenceFile, rig: Rig) -> tuple[int, ...]:
    """Return the reference's columns in the rig's order.

    Raises BadInput where rates differ, a channel of the rig is missing, or a sample is beyond comfort (read through).
    """
    head, where = reference.head, (f"{reference.path}",)
    if head.rate_hz != rig.rate_hz:
        raise BadInput(f"{head.rate_hz:g} Hz", f"{rig.rate_hz:g} Hz on this rig", where=where)
    if set(head.channels) != set(rig.channels):
        raise BadInput(f"channels {', '.join(head.channels)}", f"{', '.join(rig.channels)} on this rig", where=where)
    peak = max((float(np.abs(block).max()) for block in reference.blocks()), default=0.0)
    if peak > COMFORT_TOLERANCE * float(from_db(COMFORT_DB_SL)):
        level = 20.0 * np.log10(peak)
        raise BadInput(f"peak at {level:.1f} dB SL", f"comfort, {COMFORT_DB_SL:g} dB SL at most", where=where)
    return tuple(head.channels.index(name) for name in rig.channels)


def play_reference(
    rig: Rig,
    reference: ReferenceFile,
    wish: Callable[[], Wish] = lambda: "run",
    progress: Callable[[float], None] = lambda done_s: None,
) -> Played:
    """Play `reference` on a loaded rig; however it ends, by its end, a stop or a fault, the rig is put to rest.

    wish is asked before every 50 ms that are fed: at "pause" the signal is ramped down over 100 ms and the display held
    until "run" ramps it up again where it was; at "stop" it is ramped down and that is the end. A board is fed ahead of
    what it plays (STREAM_LEAD_S of rig.board.rig), and a wish comes later by that. progress is called with the seconds
    that are done.
    """
    columns = check_reference(reference, rig)
    player = _Player(rig, reference, columns)
    try:
        return player.run(wish, progress)
    finally:
        rig.rest()


class _Player:
    def __init__(self, rig: Rig, reference: ReferenceFile, columns: tuple[int, ...]) -> None:
        self._rig, self._reference = rig, reference
        self._length = max(1, round(BLOCK_S * rig.rate_hz))
        self._step = 1.0 / (RAMP_S * rig.rate_hz)
        self._blocks = self._cut(columns)
        self._gain = 1.0
        self._played = self._paused = 0
        self._stopped = False

    def run(self, wish: Callable[[], Wish], progress: Callable[[float], None]) -> Played:
        rate = self._rig.rate_hz
        gone = saturated = 0
        done = 0.0
        for trace in self._rig.stream(self._wished(wish)):
            gone += len(trace)
            saturated += int(trace.saturated.any(axis=1).sum())
            done = max(done, min(self._played, gone - self._paused) / rate)
            progress(done)
        times = (self._reference.duration_s, self._played / rate, self._paused / rate)
        return Played(*times, self._stopped, saturated / rate)

    def _wished(self, wish: Callable[[], Wish]) -> Iterator[FloatArray]:
        held = np.zeros((self._length, len(self._rig.channels)))
        while True:
            wanted = wish()
            if self._gain == 0.0 and wanted == "pause":
                self._paused += self._length
                yield held
            elif self._gain == 0.0 and wanted == "stop":
                self._stopped = True
                return
            else:
                block = next(self._blocks, None)
                if block is None:
                    return
                self._played += len(block)
                yield self._faded(block, 1.0 if wanted == "run" else 0.0)

    def _faded(self, block: FloatArray, towards: float) -> FloatArray:
        if self._gain == towards == 1.0:
            return block
        sign = 1.0 if towards > self._gain else -1.0
        line = np.clip(self._gain + sign * self._step * np.arange(1, len(block) + 1), 0.0, 1.0)
        self._gain = float(line[-1])
        return np.asarray(block * (0.5 - 0.5 * np.cos(np.pi * line))[:, None])

    def _cut(self, columns: tuple[int, ...]) -> Iterator[FloatArray]:
        for block in self._reference.blocks():
            ordered = block[:, columns]
            for start in range(0, len(ordered), self._length):
                yield ordered[start : start + self._length]
