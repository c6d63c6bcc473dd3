"""Traces: the samples that a rig gives back of a block that it has run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput


@dataclass(frozen=True, eq=False)
class Trace:
    """Record of n samples of every channel, as the processor knows them; arrays of shape (n, channels).

    Row k is the instant k / rate_hz of the block: position_v (volts of y) is what the A/D reads then, command_v (volts
    at the motor) what the D/A begins to put out then and holds for one period; it was computed delay_samples earlier.
    reference: threshold units; zero where the motors were driven directly. saturated: a converter or the command's
    limit was reached.
    """

    rate_hz: float
    channels: tuple[str, ...]
    reference: FloatArray
    command_v: FloatArray
    position_v: FloatArray
    saturated: NDArray[np.bool_]

    def __post_init__(self) -> None:
        shape = (self.reference.shape[0], len(self.channels))
        if shape == self.reference.shape == self.command_v.shape == self.position_v.shape == self.saturated.shape:
            return
        for name in ("reference", "command_v", "position_v", "saturated"):
            if getattr(self, name).shape != shape:
                raise BadInput(f"trace: {name} has shape {getattr(self, name).shape}", f"{shape}")

    def __len__(self) -> int:
        return int(self.reference.shape[0])

    @property
    def duration_s(self) -> float:
        """Return the length of the trace, seconds."""
        return len(self) / self.rate_hz

    @property
    def time_s(self) -> FloatArray:
        """Return the time of each sample in seconds from the block's first instant, shape (n,)."""
        return np.arange(len(self)) / self.rate_hz

    def part(self, start: int, stop: int) -> Trace:
        """Return the part from sample start to sample stop."""
        rows = slice(start, stop)
        columns = (self.reference[rows], self.command_v[rows], self.position_v[rows], self.saturated[rows])
        return Trace(self.rate_hz, self.channels, *columns)

    def channel(self, name: str) -> int:
        """Return the column of a channel. Raises BadInput if there is none of that name."""
        if name not in self.channels:
            raise BadInput(f"trace: channel {name!r} is not there", f"{', '.join(self.channels)}")
        return self.channels.index(name)


def recut_traces(traces: Iterable[Trace], lengths: Iterable[int]) -> Iterator[Trace]:
    """Yield traces that follow one another, cut into pieces of these lengths (1 or more); what is left over is left
    out.
    """
    source = iter(traces)
    kept: list[Trace] = []
    for length in lengths:
        while sum(len(trace) for trace in kept) < length:
            following = next(source, None)
            if following is None:
                return
            kept.append(following)
        whole = kept[0] if len(kept) == 1 else join_traces(kept, kept[0].rate_hz, kept[0].channels)
        yield whole.part(0, length)
        kept = [whole.part(length, len(whole))] if len(whole) > length else []


def join_traces(traces: Iterable[Trace], rate_hz: float, channels: tuple[str, ...]) -> Trace:
    """Return traces that follow one another as one; a trace without samples if there is none."""
    parts = list(traces)
    if not parts:
        nothing = np.zeros((0, len(channels)))
        return Trace(rate_hz, channels, nothing, nothing, nothing, np.zeros(nothing.shape, dtype=np.bool_))
    names = ("reference", "command_v", "position_v", "saturated")
    return Trace(rate_hz, channels, *(np.concatenate([getattr(part, name) for part in parts]) for name in names))
