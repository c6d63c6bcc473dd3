"""A rig that is left as soon as somebody wants it to stop, in the middle of whatever goes on."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from numpy.typing import ArrayLike

from tactuator.rig.rig import Rig, Trace, WrappedRig


class RigHalted(Exception):
    """Raised where what goes on at the rig is to stop."""


class WatchedRig(WrappedRig):
    """The given rig; `halted` is asked with every piece of a stream, and before anything begins."""

    def __init__(self, rig: Rig, halted: Callable[[], bool]) -> None:
        super().__init__(rig)
        self._halted = halted

    def play(self, reference: ArrayLike) -> Trace:
        """Play a block; a halt comes after it."""
        self._go_on()
        return self._rig.play(reference)

    def stream(self, blocks: Iterable[ArrayLike]) -> Iterator[Trace]:
        """Stream blocks. Raises RigHalted as soon as that is wanted."""
        self._go_on()
        for trace in self._rig.stream(blocks):
            self._go_on()
            yield trace

    def drive(self, command_v: ArrayLike) -> Trace:
        """Drive the motors; a halt comes after it."""
        self._go_on()
        return self._rig.drive(command_v)

    def _go_on(self) -> None:
        if self._halted():
            raise RigHalted
