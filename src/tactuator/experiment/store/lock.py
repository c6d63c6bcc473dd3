"""A lock that lets one process at a time run the sessions of a store."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tactuator.errors import BadInput


@contextmanager
def sessions_of(store: str | Path) -> Iterator[None]:
    """Hold the sessions of the store at that path for the length of the context.

    The lock is the operating system's, on a file beside the store, so that it ends with the process, however that ends.
    Raises BadInput, naming the process that has it, where another one runs the sessions.
    """
    path = Path(f"{store}.lock")
    if not path.parent.is_dir():
        raise BadInput(f"store {store}: its folder is not there", "a place in a folder that exists")
    handle = _locked(path, store)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(handle)


def _locked(path: Path, store: str | Path) -> int:
    """Open and lock the file at the path; one that its last holder removed meanwhile is opened anew."""
    while True:
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError as error:
            raise BadInput(f"store {store}: {path.name}: {error.strerror}", "a folder that can be written") from None
        try:
            _lock(handle, store)
            with suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(handle), path.stat()):
                    return handle
        except BadInput:
            os.close(handle)
            raise
        os.close(handle)


def _lock(handle: int, store: str | Path) -> None:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        who = os.read(handle, 200).decode(errors="replace").strip() or "another process"
        raise BadInput(f"store {store}: its sessions are run by {who}", "one at a time") from None
    os.ftruncate(handle, 0)
    with suppress(OSError):  # a full disk: it is locked all the same, by "another process"
        os.pwrite(handle, f"process {os.getpid()} on {os.uname().nodename}\n".encode(), 0)
