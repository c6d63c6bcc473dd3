"""The rig that the console's process holds, as an experiment uses it."""

import itertools
import queue
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import ArrayLike

from tactuator.console.rig_calls import Presented
from tactuator.console.rig_process import RigProcess
from tactuator.errors import BadInput, DeviceFault, TimingMissed
from tactuator.model.controller import Controller
from tactuator.rig.rig import Finger, Rig, Trace, join_traces

_SILENT_S = 30.0
"""Time after which a silent process counts as gone."""
_REST_S = 8.0


class ConsoleRig(Rig):
    """The rig that `process` holds, for one experiment at a time; it stays with the console when this is closed."""

    def __init__(self, process: RigProcess) -> None:
        super().__init__(process.display)
        self._process = process
        self.speed = 1.0 if process.status.touchable else None  # a simulated display is played in real time
        self._controller: Controller | None = None
        self._told: queue.SimpleQueue[Presented | None] = queue.SimpleQueue()
        self._numbers = itertools.count(1)
        process.presented = self._told.put

    @property
    def has_finger_ports(self) -> bool:
        """Return True where the display is simulated."""
        return self._process.status.touchable

    def finger(self, channel: str) -> Finger:
        """Raise BadInput: the finger ports are those of another process."""
        raise BadInput(f"the finger port of {channel} is the console's", "a touch in the scope")

    def load(self, controller: Controller) -> None:
        """Make the controller the one that runs. Raises BadInput if it is not for this rig."""
        controller.require_runs(self.display)
        self._controller = controller
        if self._process.status.loaded != controller.content_hash:
            self._process.call("load", controller)

    def play(self, reference: ArrayLike) -> Trace:
        """Play a reference (n, channels), threshold units."""
        return join_traces(self.stream([reference]), self.rate_hz, self.channels)

    def stream(self, blocks: Iterable[ArrayLike]) -> Iterator[Trace]:
        """Play blocks of reference as one stream; yield the traces as they come. The blocks are handed over at once.

        Raises DeviceFault with its reason where the rig stopped, or has gone; TimingMissed where it may be tried again.
        """
        if self._controller is None:
            raise BadInput("no controller is loaded: load one before playing a reference")
        if self._process.status.loaded != self._controller.content_hash:
            self._process.call("load", self._controller)  # the rig was opened anew
        number = next(self._numbers)
        while not self._told.empty():  # of before
            self._told.get()
        self.began_at, self.rows_played = None, 0
        if self._process.status.mode == "gone":
            fault = self._process.status.fault
            raise DeviceFault(fault) if fault else DeviceFault("the rig has gone: open it again")
        self._process.call("present", number, tuple(np.asarray(block, dtype=np.float64) for block in blocks))
        for piece in self._answers(number, _SILENT_S):
            if piece.fault:
                raise (TimingMissed if piece.missed else DeviceFault)(piece.fault)
            if piece.began_at is not None:
                self.began_at = piece.began_at
            if piece.trace is not None:
                count = self.rows_played + len(piece.trace)
                self.rows_played = count if piece.rows_played is None else piece.rows_played
                yield piece.trace

    def drive(self, command_v: ArrayLike) -> Trace:
        """Raise BadInput: an experiment plays through the controller only."""
        raise BadInput("the console's rig is not driven without its controller", "playing a reference")

    def rest(self) -> None:
        """End what plays, and return when the output is at rest, or the rig has gone. Raises DeviceFault where its
        process does not answer.
        """
        number = next(self._numbers)
        self._process.call("rest", number)
        try:
            for _ in self._answers(number, _REST_S):
                pass
        except DeviceFault:
            if self._process.status.mode != "gone":  # a process that has ended has brought it to rest
                raise

    def close(self) -> None:
        """Bring the output to rest; the console goes on holding the rig."""
        self.rest()
        self._process.presented = lambda piece: None

    def _answers(self, number: int, patience_s: float) -> Iterator[Presented]:
        """Yield the pieces of the call of that number, to its end; those of others came late."""
        while True:
            try:
                piece = self._told.get(timeout=patience_s)
            except queue.Empty:
                raise DeviceFault(f"no reply from the rig's process for {patience_s:g} s") from None
            if piece is None:
                raise DeviceFault("the process that holds the rig has ended: open the rig again")
            if piece.number == number:
                yield piece
                if piece.over:
                    return
