"""The protocol that every rig follows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from types import TracebackType
from typing import Protocol, Self, runtime_checkable

from numpy.typing import ArrayLike

from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.rig.trace import Trace


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
