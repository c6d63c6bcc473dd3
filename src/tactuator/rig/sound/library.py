"""PortAudio, by way of sounddevice: found when it is first asked for, and kept from writing over the terminal."""

from __future__ import annotations

import atexit
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from tactuator.errors import BadInput


def sounddevice() -> Any:
    """Return the module sounddevice with PortAudio initialised. Raises BadInput, with the remedy, where one of them is
    missing.
    """
    try:
        with quiet():
            return import_module("sounddevice")
    except ImportError:
        raise BadInput(
            "sound cards need sounddevice, which is not there; allowed: pip install 'tactuator[sound]'"
        ) from None
    except OSError:
        raise BadInput(
            "PortAudio's library is not there; allowed: where it is installed (Debian: apt-get install libportaudio2)"
        ) from None


@contextmanager
def quiet() -> Iterator[None]:
    """Keep the audio libraries, which write warnings of their own, off standard error for the block."""
    sys.stderr.flush()
    kept = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def leave_library() -> None:
    """Let PortAudio be as it is at the end of the program: after its server has died, ending it would abort us."""
    module = sys.modules.get("sounddevice")
    if module is not None:
        atexit.unregister(module._exit_handler)


__all__ = ["leave_library", "quiet", "sounddevice"]
