"""PortAudio, by way of sounddevice: found when it is first asked for, and kept from writing over the terminal."""

from __future__ import annotations

import atexit
import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from ctypes.util import find_library
from functools import cache
from importlib import import_module
from typing import Any

from tactuator.errors import BadInput, DeviceFault
from tactuator.rig.sound.audio_thread import AudioThread

PORTAUDIO = AudioThread()
"""The thread in which PortAudio is called, from the moment it is initialised."""


def sounddevice() -> Any:
    """Return the module sounddevice with PortAudio initialised. Raises BadInput, with the remedy, where one of them is
    missing; DeviceFault where the system does not answer.
    """
    try:
        with quiet():
            return PORTAUDIO.answer(_initialised, "looking for sound cards")
    except ImportError:
        raise BadInput("sound cards need sounddevice, which is not there", "pip install 'tactuator[sound]'") from None
    except OSError:
        raise BadInput(
            "PortAudio's library is not there", "where it is installed (Debian: apt-get install libportaudio2)"
        ) from None


def _initialised() -> Any:
    name_jack_client()
    known = "sounddevice" in sys.modules
    module = import_module("sounddevice")
    if not known:  # at the end of the program it is left in the thread in which it began
        atexit.unregister(module._exit_handler)
        atexit.register(_leave_in_order, module)
    return module


def _leave_in_order(module: Any) -> None:
    with suppress(DeviceFault), quiet():
        PORTAUDIO.answer(module._exit_handler, "leaving the sound cards")


@cache
def name_jack_client() -> bytes | None:
    """Give PortAudio's client of JACK a name that no other program has, and return it; None where PortAudio is without
    JACK. It has to come before PortAudio is initialised, and the name has to stay in memory.

    Every client listens on a socket named after the client alone: of two with one name, on whichever servers, the
    second takes the first one's socket away, and PortAudio then lists no JACK device.
    """
    name = f"tactuator-{os.getpid()}".encode()
    try:
        ctypes.CDLL(find_library("portaudio")).PaJack_SetClientName(name)
    except (OSError, AttributeError):
        return None
    return name


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
    """Let PortAudio be as it is at the end of the program: its server has died, and ending it would wait for that."""
    PORTAUDIO.lost = True
    atexit.unregister(_leave_in_order)


__all__ = ["PORTAUDIO", "leave_library", "name_jack_client", "quiet", "sounddevice"]
