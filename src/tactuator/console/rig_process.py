"""The rig's process seen from the server: calls to it, its newest samples and their levels, and its status."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

import numpy as np

from tactuator.console.levels import ChannelLevel, Levels
from tactuator.console.rig_calls import Points, Presented, RigStatus
from tactuator.console.rig_worker import SWITCH_S, hold_rig
from tactuator.console.scope import KEPT_S, ScopeSamples
from tactuator.errors import BadInput, DeviceFault
from tactuator.model.description import Display
from tactuator.speech.live.meter import LiveBlock

_ENDED = ("the process that holds the rig has ended", "open the rig again")
_END_S = 8.0
"""Time for the rig to come to rest; then its process is killed."""


class RigProcess:
    """A rig held by a separate process, which brings it to rest when this one ends, however that happens.

    Both sides call the other's methods by name: `call` those of RigWorker, which calls those named `take_...` here, on
    a thread.

    spec: as of --rig. changed, refused: called, on that thread, where the status or the points have changed, and where
    a call was refused, with the reason. presented: with what an experiment has played; None: the process has ended.
    """

    def __init__(self, spec: str, display: Display, seed: int = 0) -> None:
        self.spec, self.display, self.seed = spec, display, seed
        self.status = RigStatus()
        self.points: Points | None = None
        self.heard: LiveBlock | None = None
        self.samples = ScopeSamples(len(display.channels), round(KEPT_S * display.rate_hz))
        self.levels = Levels(display)
        self.changed: Callable[[], None] = lambda: None
        self.refused: Callable[[str], None] = lambda text: None
        self.presented: Callable[[Presented | None], None] = lambda piece: None
        self._before = 0
        self._felt: tuple[int, list[ChannelLevel] | None] = (-1, None)
        self._sending = threading.Lock()
        self._pipe: Connection
        self._process: BaseProcess
        self._thread: threading.Thread
        self._begin()

    def _begin(self) -> None:
        """Begin the process and wait until the rig is open. Raises BadInput with its reason where it cannot be, and
        DeviceFault where a device is the reason.
        """
        sys.setswitchinterval(SWITCH_S)  # for the thread that passes a stop on
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=hold_rig, args=(theirs, self.spec, self.display, self.seed))
        self._process.start()
        theirs.close()
        self._before = self.samples.end
        try:
            _, (first,) = self._pipe.recv()
            if first.mode == "gone":
                raise BadInput(first.fault) if first.refused else DeviceFault(first.fault)
        except BaseException as error:  # or interrupted or terminated while the rig was being opened
            self._end()
            if isinstance(error, EOFError | OSError):
                raise DeviceFault(*_ENDED) from None
            raise
        self.status = first
        self._thread = threading.Thread(target=self._read, args=(self._pipe,), daemon=True)
        self._thread.start()

    def call(self, name: str, *arguments: Any) -> None:
        """Call a method of RigWorker in the rig's process; it is run in its turn."""
        with suppress(OSError), self._sending:
            self._pipe.send((name, arguments))

    def reopen(self) -> None:
        """Open the rig anew, in another process where that one has ended."""
        if self._process.is_alive():
            self.call("reopen")
        else:
            self._begin()
            self.changed()

    def felt(self) -> list[ChannelLevel] | None:
        """Return the levels of the last second; computed at most once for the same samples."""
        end = self.samples.end
        if end - self._felt[0] >= 0.1 * self.display.rate_hz or end < self._felt[0]:
            wave = self.status.wave
            tone_hz = wave.frequency_hz if wave is not None and wave.kind == "tone" else None
            self._felt = (end, self.levels.of(self.samples, tone_hz))
        return self._felt[1]

    def close(self) -> None:
        """Bring the rig to rest, and end the process."""
        self.changed = lambda: None
        self._end()

    def _end(self) -> None:
        self.call("quit")
        self._process.join(_END_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._pipe.close()

    def _read(self, pipe: Connection) -> None:
        try:
            while True:
                name, arguments = pipe.recv()
                getattr(self, name)(*arguments)
        except (EOFError, OSError):
            if self.status.mode != "gone":  # else it has said why
                self.take_status(RigStatus(mode="gone", fault=str(DeviceFault(*_ENDED))))
            self.presented(None)

    def take_samples(self, first: int, content: bytes, saturated: int) -> None:
        """Keep samples from row `first` on: float32 rows (n, series) as bytes, and the rows in which a limit was
        reached.
        """
        rows = np.frombuffer(content, dtype=np.float32).reshape(-1, self.samples.series)
        self.samples.add(self._before + first, rows, saturated)

    def take_presented(self, piece: Presented) -> None:
        """Pass a piece on to the experiment that plays."""
        self.presented(piece)

    def take_status(self, status: RigStatus) -> None:
        """Take another status."""
        self.status = status
        self.changed()

    def take_points(self, points: Points) -> None:
        """Take another point of a measurement."""
        self.points = points
        self.changed()

    def take_heard(self, block: LiveBlock) -> None:
        """Take another block of live sound."""
        self.heard = block

    def take_refusal(self, text: str) -> None:
        """Pass on why a call was refused."""
        self.refused(text)
