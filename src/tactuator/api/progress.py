"""Progress of a function of the API, shown by whoever watches: the command line's bars, the console, or nobody."""

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from typing import Protocol


class Step(Protocol):
    """Told how far a stretch of work is."""

    def __call__(self, done: float | None = None, total: float | None = None, text: str | None = None) -> None:
        """Tell what is done of `total` (None: as before), and what is at hand."""


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
    """Return the context of a stretch of work; it yields the function to be told how far it is."""
    return _WATCHER.get()(text, total)


def say(text: str) -> None:
    """Tell the person at the terminal, at once, what is to be done or known while a verb is at work."""
    sys.stderr.write(f"tactuator: {text}\n")
    sys.stderr.flush()
