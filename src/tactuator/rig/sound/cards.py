"""Sound cards by name, and PortAudio, which lists them: called in one thread, and never waited for without end.

PortAudio waits for its host without a limit, or for ten minutes: a driver that hangs, or a server that has stopped,
would hold the whole program. Where a server dies while it is talked to, PortAudio calls abort, which would end the
program without a word: then its thread alone is stopped. The calls have one thread because some hosts (WASAPI, ASIO)
want all of them from the same one.
"""

from __future__ import annotations

import atexit
import ctypes
import os
import queue
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, wait
from contextlib import contextmanager, suppress
from ctypes.util import find_library
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any, TypeVar

from tactuator.errors import BadInput, DeviceFault
from tactuator.runtime._core import ffi, lib

ANSWER_S = 20.0
"""A call that takes longer has failed. A card that is far away (Bluetooth) takes some seconds to open."""
LOOK_S = 0.05
"""Pause between two looks at whether the library has given up."""
_T = TypeVar("_T")


class AudioThread:
    """Calls in a thread of its own, which begins with the first one. After one that did not come back, each fails.

    lost: a call did not come back, or whoever is called has gone: the program ends without ending what is called.
    """

    def __init__(self) -> None:
        self._calls: queue.SimpleQueue[tuple[Callable[[], Any], Future[Any]]] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._parked = ffi.new("int *")
        self._hung: tuple[str, str] | None = None
        self.lost = False

    def answer(self, job: Callable[[], _T], what: str, undo: Callable[[_T], object] | None = None) -> _T:
        """Return what `job` returns, or raise what it raises. what: the job in words, for the error.

        undo: called with the result where nobody waits for it any more. Raises DeviceFault after ANSWER_S, and where
        the library has called abort.
        """
        if self._hung:
            raise DeviceFault(*self._hung)
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="audio", daemon=True)
            self._thread.start()
        future: Future[_T] = Future()
        self._calls.put((job, future))
        try:
            self._wait(future)
        except BaseException:
            _undo_when_done(future, undo)
            raise
        if future.done():
            return future.result()
        _undo_when_done(future, undo)
        self.lost = True
        complaint = f"the sound system has not answered for {ANSWER_S:g} s"
        if lib.tact_parking_taken(self._parked):
            complaint = "the sound system has failed, as it does where its server ends"
        self._hung = f"{what}: {complaint}", "one whose driver and server answer, in a program begun anew"
        raise DeviceFault(*self._hung)

    def _wait(self, future: Future[Any]) -> None:
        until = time.monotonic() + ANSWER_S
        while not future.done() and not lib.tact_parking_taken(self._parked):
            left_s = until - time.monotonic()
            if left_s <= 0.0:
                return
            wait([future], timeout=min(LOOK_S, left_s))

    def _work(self) -> None:
        while True:
            job, future = self._calls.get()
            lib.tact_parking_begin(self._parked)
            try:
                future.set_result(job())
            except BaseException as error:
                future.set_exception(error)
            finally:
                lib.tact_parking_end()


def _undo_when_done(future: Future[_T], undo: Callable[[_T], object] | None) -> None:
    def undone(done: Future[_T]) -> None:
        if undo is not None and done.exception() is None:
            undo(done.result())

    future.add_done_callback(undone)


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


@dataclass(frozen=True)
class Card:
    """A device as PortAudio lists it. host: the interface of the system that it is reached by (ALSA, JACK, WASAPI)."""

    index: int
    name: str
    host: str
    outputs: int
    inputs: int
    rate_hz: float

    @property
    def full_name(self) -> str:
        """Return the name by which no other device is meant: "JACK Audio Connection Kit/system"."""
        return f"{self.host}/{self.name}"


def list_cards() -> tuple[Card, ...]:
    """Return every device, in PortAudio's order. Raises BadInput without PortAudio, and DeviceFault where it does
    not answer.
    """
    library = sounddevice()
    with quiet():
        hosts_listed, devices = PORTAUDIO.answer(
            lambda: (library.query_hostapis(), list(library.query_devices())), "listing sound cards"
        )
    hosts = [str(host["name"]) for host in hosts_listed]
    return tuple(
        Card(
            index,
            str(device["name"]),
            hosts[device["hostapi"]],
            int(device["max_output_channels"]),
            int(device["max_input_channels"]),
            float(device["default_samplerate"]),
        )
        for index, device in enumerate(devices)
    )


def find_card(name: str, cards: Sequence[Card]) -> Card:
    """Return the card of that name, "host/name" or part of a name that only one has. Raises BadInput for none or
    several.
    """
    if not cards:
        raise BadInput("there is no sound card", "one that the system lists")
    for matches in (
        [card for card in cards if name in (card.name, card.full_name)],
        [card for card in cards if name.lower() in card.full_name.lower()],
    ):
        if len(matches) == 1:
            return matches[0]
        if matches:
            raise BadInput(f"sound card {name!r} may be {_listed(matches)}", "one of these names in full")
    raise BadInput(f"there is no sound card {name!r}", f"{_listed(cards)}")


def _listed(cards: Sequence[Card]) -> str:
    return ", ".join(repr(card.full_name) for card in cards)


def sound_name(spec: str) -> tuple[str, float | None]:
    """Return device and rate (hertz, None: not said) of DEVICE[@RATE]. Raises BadInput for a rate that is none."""
    name, at, rate = spec.rpartition("@")
    if not at:
        return spec, None
    try:
        rate_hz = float(rate)
    except ValueError:
        return spec, None  # a device may have an @ in its name
    if not 0.0 < rate_hz < 1e6:
        raise BadInput(f"sound card {spec!r}: a rate of {rate_hz:g} Hz", "a positive number of hertz")
    return name, rate_hz
