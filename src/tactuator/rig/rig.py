"""Rigs, under one protocol, and the trace of what they played: simulated, on boards, on sound cards, of other packages.

What a rig may have besides is a protocol of its own: `Ticking` tells its time, `PartlyDeaf` has channels without
sensor.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.controller import Controller
from tactuator.model.description import Display


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


@runtime_checkable
class Rig(Protocol):
    """Something that runs a controller at a fixed rate on one or more channels.

    Its state carries on from block to block. Where time waits for the next block (simulated displays), two blocks are
    one long block cut in two; on a real board the reference is zero between them, and what must not be cut is streamed.
    """

    @property
    def rate_hz(self) -> float:
        """Return the sampling rate, hertz: `4000.0`."""
        ...

    @property
    def channels(self) -> tuple[str, ...]:
        """Return the names of the channels in the order of every array's columns: `("index", "thumb", "middle")`."""
        ...

    def load(self, controller: Controller) -> None:
        """Make the controller the one that runs, from rest. Raises BadInput if it is not for this rig."""
        ...

    def play(self, reference: ArrayLike) -> Trace:
        """Play a reference (n, channels), threshold units, through the loaded controller. Raises BadInput if none is
        loaded.
        """
        ...

    def stream(self, blocks: Iterable[ArrayLike]) -> Iterator[Trace]:
        """Play blocks of reference (n, channels), threshold units, one after another without a gap; yield the trace of
        every sample, in pieces as they come.

        A block is asked for when it is needed, which is some time before it is played (none where time waits for it).
        A piece may be empty: where time goes on, one comes whenever the rig has told of its time (Ticking).
        Ask for the traces as fast as they come. Left before its end, the stream goes on to the end of what was fed;
        `rest` ends it at once. Raises as `play` does, and DeviceFault if the stream ran dry: there is no silent gap.
        """
        ...

    def drive(self, command_v: ArrayLike) -> Trace:
        """Drive the motors with a command (n, channels), volts: no controller, no computing delay."""
        ...

    def rest(self) -> None:
        """Bring the output to rest."""
        ...

    def close(self) -> None:
        """Bring the output to rest and let go of the device; nothing else may be called afterwards."""
        ...

    def __enter__(self) -> Self:
        """Return the rig itself, for the block."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the rig at the end of the block."""
        ...


@runtime_checkable
class Ticking(Protocol):
    """A rig that tells by its own clock when it began what it played last, and how far it has come since."""

    @property
    def began_at(self) -> int | None:
        """Return the tick (sample of its run) of the first row of the last block or stream; None before the first."""
        ...

    @property
    def rows_played(self) -> int:
        """Return the number of rows of the stream that the rig has played, as far as it has told.

        On a board whose time goes on that is more than the rows of which the trace has been read.
        """
        ...


@runtime_checkable
class PartlyDeaf(Protocol):
    """A rig that may have channels without a sensor."""

    @property
    def without_sensor(self) -> tuple[str, ...]:
        """Return the names of the channels that have none: `("thumb",)`."""
        ...


def require_sensors(rig: Rig, names: Iterable[str]) -> None:
    """Raise BadInput, naming the first, where one of the channels has no sensor."""
    deaf = rig.without_sensor if isinstance(rig, PartlyDeaf) else ()
    for name in names:
        if name in deaf:
            raise BadInput(
                f"channel {name!r} has no sensor, and there is nothing to measure with",
                "an input of the card ([sound] input), or `play`, which needs none",
            )


class ClosingRig:
    """A rig as a context: it is closed at the end of the block. Rigs inherit from it."""

    def close(self) -> None:
        """Let go of the device; a rig that holds none has nothing to do."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class DisplayRig(ClosingRig):
    """A rig made for one display, whose rate and channels it has."""

    def __init__(self, display: Display) -> None:
        self._display = display

    @property
    def display(self) -> Display:
        """Return the display that the rig was made for."""
        return self._display

    @property
    def rate_hz(self) -> float:
        """Return the sampling rate, hertz."""
        return self._display.rate_hz

    @property
    def channels(self) -> tuple[str, ...]:
        """Return the names of the channels, in the order of every array's columns."""
        return tuple(channel.name for channel in self._display.channels)


class WrappedRig(ClosingRig):
    """A rig around another, whose rate, channels, controller and rest it has."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig

    @property
    def rate_hz(self) -> float:
        """Return the sampling rate, hertz."""
        return self._rig.rate_hz

    @property
    def channels(self) -> tuple[str, ...]:
        """Return the names of the channels."""
        return self._rig.channels

    def load(self, controller: Controller) -> None:
        """Make the controller the one that runs, as the rig does."""
        self._rig.load(controller)

    def rest(self) -> None:
        """Bring the output to rest."""
        self._rig.rest()
