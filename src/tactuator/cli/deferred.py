"""Verbs whose signature is read at once and whose work is imported when they are run.

A signature stands in `cli/<group>/verbs.py` without anything heavy: no NumPy, no SciPy, no pydantic. `does` binds it to
the function that does the work; a test holds the parameters of both together.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from tactuator.errors import BadInput

Verb = Callable[..., None]
Verbs = Mapping[str, Verb]
"""Verbs of a group by name; of a verb with parts, "verb part"."""

SOLE_PROCESSOR = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")
"""How the libraries beneath NumPy are told to use one thread."""


def does(target: str, reads: Sequence[str] = ()) -> Callable[[Verb], Verb]:
    """Return what turns a signature into a verb that is done by `target`, "module:function" below tactuator.cli.

    Parameters in `reads` are files or folders that must be there: they are looked for before anything is imported.
    """

    def bind(signature: Verb) -> Verb:
        @functools.wraps(signature)
        def verb(**given: Any) -> None:
            for name in reads:
                _look_for(name, given[name])
            done_by(verb)(**given)

        vars(verb).update(target=target, reads=tuple(reads))
        return verb

    return bind


def done_by(verb: Verb) -> Verb:
    """Return the function that does the verb's work; its module is imported."""
    # The matrices here are small: a second thread would spin for nothing, and change last digits.
    for name in SOLE_PROCESSOR:
        os.environ.setdefault(name, "1")
    module, _, function = str(vars(verb)["target"]).partition(":")
    found: Verb = getattr(import_module(f"tactuator.cli.{module}"), function)
    return found


def _look_for(name: str, paths: Path | Sequence[Path] | None) -> None:
    """Raise BadInput, in one line, where a file is not there."""
    for path in [paths] if isinstance(paths, Path) else paths or ():
        try:
            path.stat()
        except OSError as error:
            raise BadInput(f"{name} {path}: {error.strerror}", "one that can be read") from None
