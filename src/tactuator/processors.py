"""Helper processes, which leave interrupts to the process that started them and end when it ends; and one thread for
matrices of a few dozen columns, whatever the machine has.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import wait
from multiprocessing.context import BaseContext
from threading import Lock
from types import FrameType

import scipy
from threadpoolctl import threadpool_limits

_TIDYING_S = 0.5


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

    Ctrl-C at the terminal is for the process that started it. Where it is terminated, it leaves through the `finally`
    clauses of its work. Where the process that started it is killed, nothing would ever end it: it ends by itself, in
    the same way.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _leave)
    if nicer and hasattr(os, "nice"):
        os.nice(nicer)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _leave(number: int, frame: FrameType | None) -> None:
    raise SystemExit(1)


def _end_with(sentinel: int) -> None:
    wait([sentinel])
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(_TIDYING_S)
    os._exit(1)


_changing = Lock()
_within: list[threadpool_limits] = []
"""The limits of those who are at work, the first to come first."""


@contextmanager
def single_threaded(*, scipys: bool = True) -> Iterator[None]:
    """Keep BLAS to one thread: sums that it splits over threads round differently, and its threads wait for each other.

    SciPy has its own BLAS, loaded with the first module that needs it: an earlier limit does not hold for it. scipys:
    does the work use it? The limit is the whole process's: of several threads at work, the last to end takes it away.
    """
    _ = scipy.linalg.blas if scipys else None
    with _changing:
        _within.append(threadpool_limits(limits=1))
    try:
        yield
    finally:
        with _changing:
            ended = _within.pop()
            if not _within:
                ended.restore_original_limits()
