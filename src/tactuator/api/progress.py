"""Progress of a function of the API, shown by the command line's bars, by the console, or not at all."""

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from typing import Protocol

from tactuator.errors import visible


class Step(Protocol):
    """Called with the progress of a stretch of work."""

    def __call__(self, done: float | None = None, total: float | None = None, text: str | None = None) -> None:
        """Report what is done of `total` (None: as before), and the current step."""


Watcher = Callable[[str, float | None], AbstractContextManager[Step]]
"""Given the name of a stretch of work and its length (None: nobody knows it), the context in which it is shown."""


def _nothing(done: float | None = None, total: float | None = None, text: str | None = None) -> None:
    pass


@contextmanager
def _nobody(text: str, total: float | None) -> Iterator[Step]:
    yield _nothing


_WATCHER: ContextVar[Watcher] = ContextVar("watcher", default=_nobody)


@contextmanager
def watched(watcher: Watcher) -> Iterator[None]:
    """Let `watcher` show the progress of the verbs that are called in the context."""
    token = _WATCHER.set(watcher)
    try:
        yield
    finally:
        _WATCHER.reset(token)


def working(text: str, total: float | None = None) -> AbstractContextManager[Step]:
    """Return the context of a stretch of work; it yields the function to call with its progress."""
    return _WATCHER.get()(text, total)


def say(text: str) -> None:
    """Print, at once, what the person at the terminal must do or know while a function runs."""
    sys.stderr.write(f"tactuator: {visible(text)}\n")
    sys.stderr.flush()
