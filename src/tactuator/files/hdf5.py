"""HDF5 files of others, tried by a child process before they are read.

On a damaged file the library may loop for ever or crash, out of the reach of any exception; what happens to the child
tells beforehand.
"""

from __future__ import annotations

import faulthandler
import os
import resource
import signal
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py

from tactuator.errors import BadInput

_CPU_S, _WALL_S = 4, 9


@contextmanager
def opened_hdf5(path: Path) -> Iterator[h5py.File]:
    """Yield the file, open for reading.

    Raises BadInput, without the file's name, for one on which the library crashes or comes to no end; OSError and
    whatever else the library raises on a file that is not sound.
    """
    _require_survivable(path)
    with h5py.File(path, "r") as file:
        yield file


def _require_survivable(path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # the child of a process with threads only reads and ends
        child = os.fork()
    if child == 0:
        _try_out(path)
    status = os.waitpid(child, 0)[1]
    if os.WIFSIGNALED(status):
        raise BadInput("it is damaged: the HDF5 library breaks down over it; allowed: a sound file")


def _try_out(path: Path) -> None:
    """Look at everything in the file, and end the process: by a signal where the library does not survive it."""
    try:
        faulthandler.disable()
        for number in (signal.SIGALRM, signal.SIGXCPU, signal.SIGTERM, signal.SIGINT):
            signal.signal(number, signal.SIG_DFL)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        used = resource.getrusage(resource.RUSAGE_SELF)
        limit = int(used.ru_utime + used.ru_stime) + _CPU_S
        resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
        signal.alarm(_WALL_S)
        with suppress(Exception), h5py.File(path, "r") as file:
            _look(file)
            file.visititems(lambda _, item: _look(item))
    finally:
        os._exit(0)


def _look(item: Any) -> None:
    with suppress(Exception):
        dict(item.attrs)
    with suppress(Exception):
        if isinstance(item, h5py.Dataset):
            item[(slice(0, 1),) * item.ndim]
            item[(slice(-1, None),) * item.ndim]
