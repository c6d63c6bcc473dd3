"""The server's side of the rig: the process that holds it, its newest samples, and where it stands."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

import numpy as np

from tactuator.console.held_rig import orders
from tactuator.console.held_rig.worker import hold_rig
from tactuator.console.scope.levels import Felt, Levels
from tactuator.console.scope.samples import ScopeSamples
from tactuator.errors import BadInput, DeviceFault
from tactuator.model.description import Display

KEPT_S = 60.0
_ENDED = "the process that holds the rig has ended; allowed: open the rig again"
_END_S = 8.0


class RigHost:
    """A rig held by a process of its own, which brings it to rest when this one ends, however that comes about.

    spec: as of --rig. changed: called, from another thread, whenever something but samples has come; set it to be told.
    presented: called with what an experiment has played, and with None where the process has ended.
    """

    def __init__(self, spec: str, display: Display, seed: int = 0) -> None:
        self.spec, self.display, self.seed = spec, display, seed
        self.standing = orders.Standing()
        self.points: orders.Points | None = None
        self.samples = ScopeSamples(len(display.channels), round(KEPT_S * display.rate_hz))
        self.levels = Levels(display)
        self.changed: Callable[[orders.Told], None] = lambda told: None
        self.taken: Callable[[orders.Piece], None] = lambda piece: None
        self.presented: Callable[[orders.Presented | None], None] = lambda piece: None
        self._before = 0
        self._felt: tuple[int, list[Felt] | None] = (-1, None)
        self._pipe: Connection
        self._process: BaseProcess
        self._thread: threading.Thread
        self._begin()

    def _begin(self) -> None:
        """Begin the process and wait until the rig is open. Raises BadInput with its reason where it cannot be, and
        DeviceFault where a device is the reason.
        """
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=hold_rig, args=(theirs, self.spec, self.display, self.seed))
        self._process.start()
        theirs.close()
        self._before = self.samples.end
        try:
            first = self._pipe.recv()
            if first.mode == "gone":
                raise BadInput(first.fault) if first.refused else DeviceFault(first.fault)
        except (BadInput, DeviceFault):
            self._end()
            raise
        except (EOFError, OSError):
            self._end()
            raise DeviceFault(_ENDED) from None
        except BaseException:  # interrupted or told to end while the rig was being opened
            self._end()
            raise
        self.standing = first
        self._thread = threading.Thread(target=self._read, args=(self._pipe,), daemon=True)
        self._thread.start()

    def order(self, order: orders.Order) -> None:
        """Hand an order to the process; after the process has ended, the order to open the rig begins another."""
        if isinstance(order, orders.ReopenOrder) and not self._process.is_alive():
            self._begin()
            self.changed(self.standing)
            return
        with suppress(OSError):
            self._pipe.send(order)

    def felt(self) -> list[Felt] | None:
        """Return the levels of the last second; computed at most once for the same samples."""
        end = self.samples.end
        if end - self._felt[0] >= 0.1 * self.display.rate_hz or end < self._felt[0]:
            wave = self.standing.wave
            tone_hz = wave.frequency_hz if wave is not None and wave.kind == "tone" else None
            self._felt = (end, self.levels.of(self.samples, tone_hz))
        return self._felt[1]

    @property
    def process_id(self) -> int | None:
        """Return the id of the process that holds the rig."""
        return self._process.pid

    def close(self) -> None:
        """Bring the rig to rest, and end the process."""
        self.changed = lambda told: None
        self._end()

    def _end(self) -> None:
        with suppress(OSError):
            self._pipe.send(orders.QuitOrder())
        self._process.join(_END_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._pipe.close()

    def _read(self, pipe: Connection) -> None:
        try:
            while True:
                self._take(pipe.recv())
        except (EOFError, OSError):
            if self.standing.mode != "gone":  # else it has said why
                self._take(orders.Standing(mode="gone", fault=_ENDED))
            self.presented(None)

    def _take(self, told: orders.Told) -> None:
        match told:
            case orders.Piece():
                rows = np.frombuffer(told.content, dtype=np.float32).reshape(-1, self.samples.series)
                self.samples.add(self._before + told.first, rows, told.saturated)
                self.taken(told)
                return
            case orders.Presented():
                self.presented(told)
                return
            case orders.Standing():
                self.standing = told
            case orders.Points():
                self.points = told
            case orders.Refused():
                pass
        self.changed(told)
