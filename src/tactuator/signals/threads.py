"""One thread for matrices of a few dozen columns, whatever the machine has."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import scipy
from threadpoolctl import threadpool_limits


@contextmanager
def single_threaded() -> Iterator[None]:
    """Keep BLAS to one thread: sums that it splits over threads round differently, and its threads wait for each other.

    SciPy brings a BLAS of its own, which comes with the first of its parts that needs it: a limit that was set before
    does not hold for it.
    """
    _ = scipy.linalg.blas
    with threadpool_limits(limits=1):
        yield
