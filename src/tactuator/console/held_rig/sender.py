"""Sending what the process that holds the rig tells, without holding it up."""

from __future__ import annotations

import queue
import threading
from contextlib import suppress
from multiprocessing.connection import Connection

from tactuator.console.held_rig import orders

_LAST_S = 1.0


class Sender:
    """Sends through `pipe` in a thread of its own: a slow server holds nothing up, and no sample is dropped."""

    def __init__(self, pipe: Connection) -> None:
        self._waiting: queue.SimpleQueue[orders.Told | None] = queue.SimpleQueue()
        self._pipe = pipe
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def tell(self, told: orders.Told) -> None:
        """Send it after all that came before; return at once."""
        self._waiting.put(told)

    def close(self) -> None:
        """Wait until everything is sent, a second at most."""
        self._waiting.put(None)
        self._thread.join(_LAST_S)

    def _work(self) -> None:
        with suppress(OSError):
            while (told := self._waiting.get()) is not None:
                self._pipe.send(told)
