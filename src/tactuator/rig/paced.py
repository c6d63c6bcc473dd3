"""A rig that takes as long as the stimuli last: the simulated display computes faster than a person feels."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from tactuator.errors import BadInput
from tactuator.rig.finger import Finger, TouchableRig
from tactuator.rig.rig import Rig, Ticking, Trace, WrappedRig


@runtime_checkable
class Paced(Protocol):
    """A rig that may be slower than it could be."""

    @property
    def speed(self) -> float | None:
        """Return the speed of presentation, 1 being real time; None for a rig with a time of its own."""
        ...


class PacedRig(WrappedRig):
    """The given `rig`, slowed down: each block takes its own duration over `speed` (1: real time)."""

    def __init__(self, rig: Rig, speed: float = 1.0) -> None:
        super().__init__(rig)
        self._speed = speed
        self._rows_played = 0

    @property
    def began_at(self) -> int | None:
        """Return the tick that the rig itself tells."""
        return self._rig.began_at if isinstance(self._rig, Ticking) else None

    @property
    def rows_played(self) -> int:
        """Return the number of rows of the stream for which the rig has waited."""
        return self._rows_played

    @property
    def speed(self) -> float:
        """Return the speed of presentation: 1 is real time."""
        return self._speed

    @property
    def has_finger_ports(self) -> bool:
        """Return True where the rig itself has a simulated display."""
        return isinstance(self._rig, TouchableRig) and self._rig.has_finger_ports

    def finger(self, channel: str) -> Finger:
        """Return the finger port of a channel; BadInput where the display is real."""
        if not isinstance(self._rig, TouchableRig):
            raise BadInput("this display is real: a finger goes onto it by hand", "a simulated display")
        return self._rig.finger(channel)

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
