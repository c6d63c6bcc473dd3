"""One thread for matrices of a few dozen columns, whatever the machine has."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock

import scipy
from threadpoolctl import threadpool_limits

_changing = Lock()
_within: list[threadpool_limits] = []
"""The limits of those who are at work, the first to come first."""


@contextmanager
def single_threaded() -> Iterator[None]:
    """Keep BLAS to one thread: sums that it splits over threads round differently, and its threads wait for each other.

    SciPy brings a BLAS of its own, which comes with the first of its parts that needs it: a limit that was set before
    does not hold for it. The limit is the whole process's: of several threads at work, the last to end takes it away.
    """
    _ = scipy.linalg.blas
    with _changing:
        _within.append(threadpool_limits(limits=1))
    try:
        yield
    finally:
        with _changing:
            ended = _within.pop()
            if not _within:
                ended.restore_original_limits()
