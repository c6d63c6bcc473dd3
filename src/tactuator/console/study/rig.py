"""The console's rig as an experiment sees it: a rig like any other, whose samples another process plays."""

from __future__ import annotations

import itertools
import queue
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import ArrayLike

from tactuator.console.held_rig import orders
from tactuator.console.scope.host import RigHost
from tactuator.errors import BadInput, DeviceFault, TimingMissed
from tactuator.model.controller import Controller
from tactuator.rig.finger import Finger
from tactuator.rig.rig import Rig, Trace, join_traces

_SILENT_S = 30.0
"""Time after which a process that tells nothing counts as gone."""
_REST_S = 8.0


class ConsoleRig(Rig):
    """The rig that `host` holds, for one experiment at a time; it stays with the console when this is closed."""

    def __init__(self, host: RigHost) -> None:
        super().__init__(host.display)
        self._host = host
        self._controller: Controller | None = None
        self._told: queue.SimpleQueue[orders.Presented | None] = queue.SimpleQueue()
        self._numbers = itertools.count(1)
        self._began_at: int | None = None
        self._rows_played = 0
        host.presented = self._told.put

    @property
    def began_at(self) -> int | None:
        """Return the tick at which the last stream began, where the rig tells it."""
        return self._began_at

    @property
    def rows_played(self) -> int:
        """Return the number of rows of the stream that have been played, as far as that has been told."""
        return self._rows_played

    @property
    def speed(self) -> float | None:
        """Return 1 for a simulated display, which is played in real time; None for one with a time of its own."""
        return 1.0 if self.has_finger_ports else None

    @property
    def has_finger_ports(self) -> bool:
        """Return True where the display is simulated."""
        return self._host.standing.touchable

    def finger(self, channel: str) -> Finger:
        """Raise BadInput: the finger ports are those of another process."""
        raise BadInput(f"the finger port of {channel} is the console's", "a touch in the scope")

    def load(self, controller: Controller) -> None:
        """Make the controller the one that runs. Raises BadInput if it is not for this rig."""
        controller.require_runs(self.display)
        self._controller = controller
        if self._host.standing.loaded != controller.content_hash:
            self._host.order(orders.LoadOrder(controller))

    def play(self, reference: ArrayLike) -> Trace:
        """Play a reference (n, channels), threshold units."""
        return join_traces(self.stream([reference]), self.rate_hz, self.channels)

    def stream(self, blocks: Iterable[ArrayLike]) -> Iterator[Trace]:
        """Play blocks of reference as one stream; yield the traces as they come. The blocks are handed over at once.

        Raises DeviceFault with its reason where the rig stopped, or has gone; TimingMissed where it may be tried again.
        """
        if self._controller is None:
            raise BadInput("no controller is loaded", "load one before playing a reference")
        if self._host.standing.loaded != self._controller.content_hash:
            self._host.order(orders.LoadOrder(self._controller))  # the rig was opened anew
        number = next(self._numbers)
        while not self._told.empty():  # of before
            self._told.get()
        self._began_at, self._rows_played = None, 0
        self._order(orders.PresentOrder(number, tuple(np.asarray(one, dtype=np.float64) for one in blocks)))
        for told in self._answers(number, _SILENT_S):
            if told.fault:
                raise (TimingMissed if told.missed else DeviceFault)(told.fault)
            if told.began_at is not None:
                self._began_at = told.began_at
            if told.trace is not None:
                count = self._rows_played + len(told.trace)
                self._rows_played = count if told.rows_played is None else told.rows_played
                yield told.trace

    def drive(self, command_v: ArrayLike) -> Trace:
        """Raise BadInput: an experiment plays through the controller only."""
        raise BadInput("the console's rig is not driven without its controller", "playing a reference")

    def rest(self) -> None:
        """End what plays, and return when the output is at rest, or the rig has gone. Raises DeviceFault where its
        process does not answer.
        """
        number = next(self._numbers)
        self._host.order(orders.RestOrder(number))
        try:
            for _ in self._answers(number, _REST_S):
                pass
        except DeviceFault:
            if self._host.standing.mode != "gone":  # a process that has ended has brought it to rest
                raise

    def close(self) -> None:
        """Bring the output to rest; the console goes on holding the rig."""
        self.rest()
        self._host.presented = lambda piece: None

    def _order(self, order: orders.Order) -> None:
        if self._host.standing.mode == "gone":
            raise DeviceFault(self._host.standing.fault or "the rig has gone; allowed: open it again")
        self._host.order(order)

    def _answers(self, number: int, patience_s: float) -> Iterator[orders.Presented]:
        """Yield what is told of the order of that number, to its end; what is told of others came late."""
        while True:
            try:
                told = self._told.get(timeout=patience_s)
            except queue.Empty:
                raise DeviceFault(f"the rig's process has told nothing for {patience_s:g} s") from None
            if told is None:
                raise DeviceFault("the process that holds the rig has ended", "open the rig again")
            if told.number == number:
                yield told
                if told.over:
                    return
