"""A rig that takes as long as the stimuli last: the simulated display computes faster than a person feels."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import ArrayLike

from tactuator.rig.rig import Rig, Trace, WrappedRig


class PacedRig(WrappedRig):
    """The given `rig`, slowed down: each block takes its own duration over `speed` (1: real time)."""

    def __init__(self, rig: Rig, speed: float = 1.0) -> None:
        super().__init__(rig)
        self._speed = speed

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
        for trace in self._rig.stream(blocks):
            count = self._rows_played + len(trace)
            self._wait(trace, began_s, count)
            self._rows_played = count
            yield trace

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
