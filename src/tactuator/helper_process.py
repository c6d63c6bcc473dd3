"""Helper processes: they leave interrupts to the process that started them, and end when it ends."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from multiprocessing.connection import wait


def begin_helper(nicer: int = 0) -> None:
    """Begin the life of a helper process, by so much nicer to others; it is the initializer of a pool.

    Ctrl-C at the terminal is for the process that started it. Where that one is killed, nobody would ever tell the
    helper that no more work comes: it ends by itself.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if nicer and hasattr(os, "nice"):
        os.nice(nicer)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)
