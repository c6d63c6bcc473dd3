"""HDF5 files: those of others are tried by a child process before they are read, ours survive a full disk.

On a damaged file the library may loop for ever or crash, out of the reach of any exception; the child shows
it beforehand.
"""

from __future__ import annotations

import faulthandler
import io
import os
import resource
import signal
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from types import FrameType
from typing import Any

import h5py

from tactuator.errors import BadInput

_CPU_S, _WALL_S = 4, 9
_MEMORY_BYTES = 640 << 20
"""Memory that a file may take up in the child: well over MOST_VALUES numbers of a record."""
_TOO_LARGE, _ELSEWHERE, _TOO_MANY = 3, 4, 5
_MOST_ITEMS = 2000
"""Datasets and groups; a record has ten, a MATLAB file some hundreds."""


@contextmanager
def opened_hdf5(path: Path) -> Iterator[h5py.File]:
    """Yield the file, open for reading.

    Raises BadInput, without the file's name, for one on which the library crashes or comes to no end; OSError and
    whatever else the library raises on a file that is not sound.
    """
    if path.is_dir():
        raise BadInput("it is a folder", "a file")
    state = path.stat()
    _require_survived(path, state.st_ino, state.st_size, state.st_mtime_ns)
    with h5py.File(path, "r") as file:
        yield file


@lru_cache(maxsize=8)
def _require_survived(path: Path, *state: int) -> None:
    """Try a file out, once as long as its state is the same: its kind is asked for before it is read."""

    def look_through() -> None:
        with h5py.File(path, "r") as file:
            names: list[str] = []

            def keep(name: str) -> bool | None:
                names.append(name)
                return len(names) > _MOST_ITEMS or None

            if file.visit(keep):
                os._exit(_TOO_MANY)
            if _links_elsewhere(file) or any(_is_elsewhere(file, name) for name in names):
                os._exit(_ELSEWHERE)
            _look(file)
            file.visititems(lambda _, item: _look(item))

    require_survivable(look_through)


class _Disk(io.FileIO):
    """A file that keeps the first failure of a write to itself: the HDF5 library does not survive an error."""

    failure: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all the bytes, or nothing more after a failure, and return how many were given."""
        size, rest = memoryview(data).nbytes, memoryview(data).cast("B")
        try:
            while rest and self.failure is None:
                rest = rest[super().write(rest) or 0 :]
        except OSError as error:
            self.failure = error
        return size

    def truncate(self, size: int | None = None) -> int:
        """Set the length, or leave it after a failure."""
        try:
            return self.tell() if self.failure else super().truncate(size)
        except OSError as error:
            self.failure = error
            return self.tell()


class EndsHeld:
    """Ctrl-C and SIGTERM, held within the context of this and let go at its end; on another thread than the main one,
    where neither is raised, nothing is held.
    """

    def __init__(self) -> None:
        self._handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}
        self._came: int | None = None

    def __enter__(self) -> EndsHeld:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                handler = signal.getsignal(number)
                if callable(handler):
                    self._handlers[number] = handler
                    signal.signal(number, self._hold)
        return self

    def __exit__(self, kind: object, *more: object) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        if kind is None:
            self.let_go()

    def let_go(self) -> None:
        """Do what the signal that came would have done."""
        came, self._came = self._came, None
        if came is not None:
            self._handlers[came](came, None)

    def _hold(self, number: int, frame: FrameType | None) -> None:
        self._came = number


class WrittenHdf5:
    """An HDF5 file that is being written, and the check that all of it so far got there."""

    def __init__(self, file: h5py.File, disk: _Disk, ends: EndsHeld) -> None:
        self.file, self._disk, self._ends = file, disk, ends

    def check(self) -> None:
        """Raise the OSError of the first write that failed, where one did, or the end that came meanwhile."""
        if self._disk.failure is not None:
            raise self._disk.failure
        self._ends.let_go()


@contextmanager
def written_hdf5(path: Path) -> Iterator[WrittenHdf5]:
    """Yield a new HDF5 file at the path; the OSError of a full disk is raised at the end, and by `check`.

    Left to itself the library ends in a segmentation fault on a full disk, and takes a write that Ctrl-C has kept from
    being made for one that was: an end is held until the next check.
    """
    with EndsHeld() as ends, _Disk(path, "w+") as disk:
        with h5py.File(disk, "w") as file:
            written = WrittenHdf5(file, disk, ends)
            yield written
        written.check()


def require_survivable(trial: Callable[[], object]) -> None:
    """Raise BadInput where a library that reads a file crashes on it, or comes to no end, in a child process."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # the child of a process with threads only reads and ends
        child = os.fork()
    if child == 0:
        _try_out(trial)
    status = os.waitpid(child, 0)[1]
    if os.WIFSIGNALED(status):
        raise BadInput("it is damaged: the library breaks down over it", "a whole file")
    if os.WEXITSTATUS(status) == _ELSEWHERE:
        raise BadInput("it takes numbers from other files", "a file that holds its own numbers")
    if os.WEXITSTATUS(status) == _TOO_MANY:
        raise BadInput(f"it has more than {_MOST_ITEMS} datasets and groups", "a smaller file")
    if os.WEXITSTATUS(status) == _TOO_LARGE:
        raise BadInput(f"it takes up more than {_MEMORY_BYTES >> 20} MB of memory", "a smaller file")


def _try_out(trial: Callable[[], object]) -> None:
    """Read the file, and end the process: by a signal where the library does not survive it."""
    status = 0
    try:
        faulthandler.disable()
        for number in (signal.SIGALRM, signal.SIGXCPU, signal.SIGTERM, signal.SIGINT):
            signal.signal(number, signal.SIG_DFL)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        used = resource.getrusage(resource.RUSAGE_SELF)
        limit = int(used.ru_utime + used.ru_stime) + _CPU_S
        resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
        signal.alarm(_WALL_S)
        _limit_memory()
        with suppress(Exception):
            try:
                trial()
            except MemoryError:
                status = _TOO_LARGE
    finally:
        os._exit(status)


def _limit_memory() -> None:
    """Let this process take no more than _MEMORY_BYTES besides what it has, where the system reports how much that
    is.
    """
    statm = Path("/proc/self/statm")
    if statm.exists():
        most = int(statm.read_text().split()[0]) * resource.getpagesize() + _MEMORY_BYTES
        resource.setrlimit(resource.RLIMIT_AS, (most, most))


def _is_elsewhere(file: h5py.File, name: str) -> bool:
    """Return whether a dataset, or a link in a group, leads to another file, which may be any that we can read."""
    item = file[name]
    if isinstance(item, h5py.Dataset):
        return bool(item.external) or item.is_virtual
    return _links_elsewhere(item)


def _links_elsewhere(group: h5py.Group) -> bool:
    return any(isinstance(group.get(name, getlink=True), h5py.ExternalLink) for name in group)


def _look(item: Any) -> None:
    for look in (
        lambda: dict(item.attrs),
        lambda: item[(slice(0, 1),) * item.ndim],  # a group has no ends
        lambda: item[(slice(-1, None),) * item.ndim],
    ):
        try:
            look()
        except MemoryError:
            raise
        except Exception:  # refused when the file is read
            continue
