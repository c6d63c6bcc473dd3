"""A rig that takes as long as the stimuli last: the simulated display computes faster than a person feels."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray
from tactuator.rig.rig import Rig, Trace, WrappedRig
from tactuator.rig.simulated import ComputedRig

_PIECE_S = 0.002
"""Time for which a computed stream cannot be taken back: what is computed is felt."""
_FADE_S, _QUIET_S = 0.004, 0.06
"""A stream that is ended fades in the first, and the loop is held closed for the second: a motor that is let go
in mid-swing moves on, which is felt."""


class PacedRig(WrappedRig):
    """The given `rig`, slowed down: each block takes its own duration over `speed` (1: real time)."""

    def __init__(self, rig: Rig, speed: float = 1.0) -> None:
        super().__init__(rig)
        self._speed = speed
        self._coming: Iterator[FloatArray] = iter(())  # what a computed stream that goes on has not played yet

    @property
    def speed(self) -> float:
        """Return the speed of presentation: 1 is real time."""
        return self._speed

    def play(self, reference: ArrayLike) -> Trace:
        """Play, and wait until the block would be over."""
        return self._wait(self._rig.play(reference), time.monotonic(), np.shape(reference)[0])

    def stream(self, blocks: Iterable[ArrayLike]) -> Iterator[Trace]:
        """Stream, and wait with each piece of the trace until it would have been played."""
        began_s, self._rows_played = time.monotonic(), 0
        if isinstance(self._rig, ComputedRig):
            blocks = self._coming = self._pieces(blocks)
        for trace in self._rig.stream(blocks):
            count = self._rows_played + len(trace)
            self._wait(trace, began_s, count)
            self._rows_played = count
            yield trace

    def _pieces(self, blocks: Iterable[ArrayLike]) -> Iterator[FloatArray]:
        step = max(1, round(_PIECE_S * self._speed * self.rate_hz))
        for block in blocks:
            rows = np.asarray(block, dtype=np.float64)
            yield from (rows[start : start + step] for start in range(0, len(rows), step))

    def rest(self) -> None:
        """Bring the output to rest; a computed stream that goes on is faded out first."""
        fall, coming, count = 0.5 + 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, round(_FADE_S * self.rate_hz))), [], 0
        while count < fall.size and (piece := next(self._coming, None)) is not None:
            coming.append(piece)
            count += len(piece)
        self._coming = iter(())
        if coming:
            rows = np.concatenate([*coming, np.zeros((fall.size, len(self.channels)))])[: fall.size]
            self.play(np.concatenate([fall[:, None] * rows, np.zeros((round(_QUIET_S * self.rate_hz), rows.shape[1]))]))
        self._rig.rest()

    def drive(self, command_v: ArrayLike) -> Trace:
        """Drive, and wait until the block would be over."""
        return self._wait(self._rig.drive(command_v), time.monotonic(), np.shape(command_v)[0])

    def close(self) -> None:
        """Close the rig that is paced."""
        self._rig.close()

    def _wait(self, trace: Trace, began_s: float, count: int) -> Trace:
        left_s = count / self.rate_hz / self._speed - (time.monotonic() - began_s)
        if left_s > 0.0:
            time.sleep(left_s)
        return trace
