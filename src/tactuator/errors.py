"""Errors that tactuator raises on purpose, each with the exit status that the command line ends with.

    TactuatorError
    ├── BadInput       2   input that cannot be used
    │   └── UnstableLoop   a loop is unstable, so the question has no answer (loop)
    ├── NoDesign       2   no controller keeps what was asked for
    │   └── NoEqualiser    for what was measured; it holds that (measure/open_loop)
    ├── DeviceFault    3   a rig, a link or a sound card failed
    │   ├── LinkDown       the other end of a link does not answer (rig/transport)
    │   ├── LinkGarbled    malformed reply from a board (rig/board)
    │   ├── RigFault       the guard of a board ended the run (rig/board)
    │   ├── RigLocked      a board is locked out until its faults are acknowledged (rig/board)
    │   ├── CardGone       a sound card does not call back any more (rig/sound)
    │   └── TimingMissed   a stretch of time was not what was asked for, and may be asked for again
    │       ├── StreamDry      a stream ran dry (rig/board)
    │       └── SoundGap       a run on a sound card had a gap (rig/sound)
    ├── StoreFault     2   the database of an experiment cannot be read or written
    └── Interrupted  130   a person stopped a command that writes files

An error is data: where it is (outermost first), which key, what was got and what is allowed. `str` makes the sentence
of them, one line, and it is the only place that does; nothing reads a sentence.
"""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path
from typing import Any, Self, TypeVar

_T = TypeVar("_T")
_LOG = logging.getLogger(__name__)
_UNSEEN = re.compile("[\\x00-\\x08\\x0b-\\x1f\\x7f-\\x9f\\u061c\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069]")
"""Control characters but for tab and line end, and marks that turn the direction of what is read."""
_LONGEST = 1000
"""Characters of each part of a sentence: a cell may have a hundred thousand, and a table as many names."""


def visible(text: str) -> str:
    """Return a text with its control characters and marks of direction as escapes: a terminal obeys the one, and the
    other lets a name be read as a different one.
    """
    return _UNSEEN.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def _bounded(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


class TactuatorError(Exception):
    """An error for the person who asked; `exit_status` is the command line's.

    got: what is wrong, with the value. allowed: what would be taken instead. where: file, table or object, outermost
    first. key: the parameter at fault, by its name in the file or the call. file: one that a document names, whose
    words the error may repeat (see `named_file`).
    """

    exit_status = 2

    def __init__(self, got: str, allowed: str = "", *, where: tuple[str, ...] = (), key: str = "") -> None:
        super().__init__(got)
        self.got, self.allowed, self.where, self.key = got, allowed, where, key
        self.file = ""

    def within(self, *where: str) -> Self:
        """Return the same error, located within `where`, outermost first."""
        self.where = (*where, *self.where)
        return self

    def __str__(self) -> str:
        where, got, allowed = _bounded(": ".join(self.where)), _bounded(self.got), _bounded(self.allowed)
        sentence = f"{where}: " if self.where else ""
        sentence += f"{_bounded(self.key)} is {got}" if self.key else got
        if allowed:
            sentence = f"{sentence}; {'it must be' if self.key else 'expected'} {allowed}"
        return visible(sentence).replace("\n", "\\n")

    @property
    def lines(self) -> list[str]:
        """Return the sentence, and a short line for each of its notes (`add_note`): why, and what helps."""
        return [str(self), *map(visible, getattr(self, "__notes__", ()))]

    def document(self) -> Mapping[str, Any]:
        """Return the error as data, for a page."""
        where, key = [_bounded(place) for place in self.where], _bounded(self.key)
        return {"where": where, "key": key, "got": _bounded(self.got), "allowed": _bounded(self.allowed)}


class BadInput(TactuatorError, ValueError):
    """Input that cannot be used. The message says what was got and what is allowed.

    >>> try:
    ...     tt.read_display("model.json")
    ... except tt.BadInput as error:
    ...     print(type(error).__name__)
    BadInput
    """


@contextmanager
def within(*where: str) -> Iterator[None]:
    """Locate input that the block refuses within `where`, outermost first."""
    try:
        yield
    except BadInput as error:
        raise error.within(*where) from None


@contextmanager
def given_as(key: str, parameter: str) -> Iterator[None]:
    """Name the parameter of a call in place of the key that it stands for, where the block refuses that."""
    try:
        yield
    except BadInput as error:
        if error.key != key:
            raise
        raise BadInput(error.got, error.allowed, key=parameter) from None


@contextmanager
def named_file(path: str | Path, use: str) -> Iterator[None]:
    """Mark what is refused in the block as said of a file that is there and that a document names. use: as what."""
    try:
        yield
    except BadInput as error:
        if os.path.isfile(path):  # noqa: PTH113  (False for any text)
            error.file = error.file or f"{use} {path}"
        raise


@lru_cache(maxsize=100)
def _log_once(words: str) -> None:
    """Log a refusal; the same one, asked for again and again, is one line."""
    _LOG.warning("%s", words)


@contextmanager
def unquoted() -> Iterator[None]:
    """Refuse a file that a document names without a word of it, for a reader who may not read that file."""
    try:
        yield
    except BadInput as error:
        if not error.file:
            raise
        _log_once(str(error))
        raise BadInput(f"{error.file} cannot be used: the server's terminal says why") from None


class NoDesign(TactuatorError, ValueError):
    """No controller keeps the limits that were asked for; the message names the binding limits."""


class DeviceFault(TactuatorError):
    """A device failed while it was in use; the input was not at fault."""

    exit_status = 3


class TimingMissed(DeviceFault):
    """A rig did not play on time; the same may be requested again."""


class StoreFault(TactuatorError):
    """The database of an experiment cannot be read or written; nothing was changed."""


class Interrupted(TactuatorError):
    """A person stopped a command; it says what of its files was written by then."""

    exit_status = 130


def unknown(what: str, name: object, known: Iterable[str], *, where: tuple[str, ...] = ()) -> BadInput:
    """Return the refusal of an unknown name, with the one that was likely meant, or with all."""
    names = list(known)
    meant = likely(name, names) if isinstance(name, str) else ""
    return BadInput(f"no {what} {name!r}{meant}", "" if meant else ", ".join(names), where=where)


def agreed(
    stated: Mapping[str, _T], alike: Callable[[_T, _T], bool], shown: Callable[[_T], str], allowed: str
) -> _T | None:
    """Return the one value of several statements, by who makes them, or None without any. Raises BadInput for two that
    are not alike, with both.
    """
    items = list(stated.items())
    for name, other in items[1:]:
        first, value = items[0]
        if not alike(value, other):
            raise BadInput(f"{first} says {shown(value)}, {name} says {shown(other)}", allowed)
    return items[0][1] if items else None


def reason_of(error: OSError) -> str:
    """Return why a file cannot be read or written."""
    return "file not found" if isinstance(error, FileNotFoundError) else error.strerror or "it cannot be read"


def likely(word: str, known: Iterable[str], alike: float = 0.6) -> str:
    """Return the known word that was likely meant by another, as a question to add; empty where none is so alike."""
    near = get_close_matches(word, list(known), 1, alike)
    return f" (did you mean {near[0]!r}?)" if near else ""
