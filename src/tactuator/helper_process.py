"""Helper processes: they leave interrupts to the process that started them, and end when it ends."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from multiprocessing.connection import wait
from multiprocessing.context import BaseContext


def helper_context(module: str) -> BaseContext:
    """Return a context whose processes start from one that has loaded `module`, where the system can do that.

    They are not forked from this process, in which a progress bar's thread may hold a lock at that moment.
    """
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([module])
    return context


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
