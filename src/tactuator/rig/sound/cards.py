"""Sound cards by name, and PortAudio, which lists them: called in one thread, and never waited for without end.

PortAudio waits for its host without a limit, or for ten minutes: a driver that hangs, or a server that has stopped,
would hold the whole program. Where a server dies while it is talked to, PortAudio calls abort, which would end the
program without a word: then its thread alone is stopped. The calls have one thread because some hosts (WASAPI, ASIO)
want all of them from the same one.

An output, and perhaps an input that a wire joins to it, are measured: delay, and volts at full scale.
"""

from __future__ import annotations

import atexit
import ctypes
import os
import queue
import re
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

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, DeviceFault
from tactuator.model.description import Channel, Converter, Display, Threshold
from tactuator.model.requirements import FeedbackRequirements, SoundCard, Wires
from tactuator.rig.rig import Rig
from tactuator.runtime._core import ffi, lib
from tactuator.signals.systems import ContinuousSystem

ANSWER_S = 20.0
"""A call that takes longer has failed. A card that is far away (Bluetooth) takes some seconds to open."""
LOOK_S = 0.05
"""Pause between two looks at whether the library has given up."""
_T = TypeVar("_T")


class AudioThread:
    """Calls in a separate thread, started by the first one. After a call that did not return, each fails.

    lost: a call did not come back, or its server has gone: the program ends without ending what is called.
    """

    def __init__(self) -> None:
        self._calls: queue.SimpleQueue[tuple[Callable[[], Any], Future[Any]]] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._parked = ffi.new("int *")
        self._hung: tuple[str, str] | None = None
        self.lost = False

    def answer(self, job: Callable[[], _T], what: str, undo: Callable[[_T], object] | None = None) -> _T:
        """Return what `job` returns, or raise what it raises. what: the job in words, for the error.

        undo: called with the result once it is no longer waited for. Raises DeviceFault after ANSWER_S, and where
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
        raise BadInput("sound cards need sounddevice, which is not there: pip install 'tactuator[sound]'") from None
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
    """Keep the warnings of the audio libraries off standard error for the block."""
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
    """Return every device, in PortAudio's order. Raises BadInput without PortAudio, DeviceFault if it is silent."""
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
    """Return the card "host/name", or the only one with that part of a name. Raises BadInput for none or several."""
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


def lasting_name(card: Card, cards: Sequence[Card]) -> str:
    """Return the name by which `card` is found again: without ALSA's "(hw:1,0)", which counts cards anew at each start,
    unless two cards are alike without it.
    """
    name = re.sub(r"[:\s-]*\(hw:\d+,\d+\)$", "", card.full_name)
    alike = [other for other in cards if name.lower() in other.full_name.lower()]
    return name if alike == [card] else card.full_name


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


LEAST_RATE_HZ = 1000.0
"""No card has less; above it a quarter of the rate holds a band."""
BURSTS, BURST_S = 5, 1.0
"""Bursts of noise of a second each, looked at in halves: ten delays, whose spread shows a clock that jumps."""
_SURE = 0.5
"""Least correlation of what comes back with what was put out."""
_UNHEARD = (
    "what was put out does not come back at the input",
    "a wire from that output to that input, with its gain turned up",
)


def wire_display(rate_hz: float, output: int, input_number: int) -> Display:
    """Return a display that is a wire from an output to an input (0: none), whose volts are shares of full scale.

    Raises BadInput for a rate below LEAST_RATE_HZ.
    """
    if not (np.isfinite(rate_hz) and rate_hz >= LEAST_RATE_HZ):
        raise BadInput(f"a rate of {rate_hz:g} Hz", f"{LEAST_RATE_HZ:g} Hz or more, as the card has it")
    sound = SoundCard((Wires(output, input_number, 1.0, 1.0),), lead_s=0.5)
    channel = Channel(
        name="wire",
        sensor_gain_v_per_mm=1.0,
        travel_mm=1.0,
        plant=ContinuousSystem(np.empty(0), np.empty(0), 1.0),
        threshold=Threshold(band_hz=(1.0, min(300.0, rate_hz / 4.0))),
        converter=Converter(range_v=1.0),
        feedback=FeedbackRequirements(structure="none"),
    )
    return Display(rate_hz, (channel,), 0, "wire", sound=sound)


@dataclass(frozen=True)
class Delay:
    """Delay through a wire, samples. spread: between bursts and within them; gain: what comes back for 1."""

    samples: int
    spread: int
    gain: float


def measure_delay(rig: Rig, level: float, rng: np.random.Generator) -> Delay:
    """Return the delay through a wire on the rig of a `wire_display`, by bursts of noise at a share of full scale.

    Raises BadInput for a level out of range, and where nothing of the bursts comes back.
    """
    if not 0.0 < level <= 0.9:
        raise BadInput(f"level {level:g}", "above 0, at most 0.9 of full scale")
    count = round(BURST_S * rig.rate_hz)
    delays: list[int] = []
    gains: list[float] = []
    for _ in range(BURSTS):
        burst = np.zeros((2 * count, 1))
        burst[:count, 0] = level * rng.uniform(-1.0, 1.0, count)
        trace = rig.drive(burst)
        asked, heard = trace.command_v[:, 0], trace.position_v[:, 0]
        for part in (slice(0, count // 2), slice(count // 2, count)):
            delay, gain = _delay(asked, heard, part)
            delays.append(delay)
            gains.append(gain)
    return Delay(round(float(np.median(delays))), max(delays) - min(delays), float(np.mean(gains)))


def _delay(asked: FloatArray, heard: FloatArray, part: slice) -> tuple[int, float]:
    """Return by how much `heard` comes after a part of `asked`, and the gain there."""
    burst = np.zeros(asked.size)
    burst[part] = asked[part]
    size = 2 * asked.size
    cross = np.fft.irfft(np.conj(np.fft.rfft(burst, size)) * np.fft.rfft(heard, size), size)[: asked.size // 2]
    delay = int(np.argmax(np.abs(cross)))
    there = heard[part.start + delay : part.stop + delay]
    power = float(np.sum(burst[part] ** 2))
    sure = abs(float(cross[delay])) / np.sqrt(power * float(np.sum(there**2)) + 1e-300)
    if sure < _SURE:
        raise BadInput(*_UNHEARD)
    return delay, float(cross[delay]) / power


def tone(rig: Rig, frequency_hz: float, level: float, duration_s: float) -> float:
    """Play a tone at a share of full scale and return its peak at the input, as a share of full scale; 0 without one.

    Raises BadInput for a level or frequency out of range, and where the tone does not come back at an input.
    """
    if not (0.0 < level <= 0.9 and 1.0 <= frequency_hz <= 0.4 * rig.rate_hz and 1.0 <= duration_s <= 600.0):
        raise BadInput(
            f"a tone of {frequency_hz:g} Hz at {level:g} for {duration_s:g} s",
            f"1 to {0.4 * rig.rate_hz:g} Hz, above 0 to 0.9 of full scale, 1 to 600 s",
        )
    time = np.arange(round(duration_s * rig.rate_hz)) / rig.rate_hz
    wave = level * np.sin(2.0 * np.pi * frequency_hz * time)
    heard = rig.drive(wave[:, None]).position_v[time.size // 2 :, 0]
    turn = np.exp(-2j * np.pi * frequency_hz * time[time.size // 2 :])
    peak = float(2.0 * np.abs(np.mean(heard * turn)))
    if rig.without_sensor:
        return 0.0
    if peak <= _SURE * np.sqrt(2.0 * float(np.mean(heard**2))):
        raise BadInput(*_UNHEARD)
    return peak


def full_scale_v(reading_v: float, level: float) -> float:
    """Return the volts at full scale for a positive reading, V rms, of a tone at a share of it, or raise BadInput."""
    if not (np.isfinite(reading_v) and reading_v > 0.0):
        raise BadInput(f"a reading of {reading_v:g} V rms", "a positive number")
    return float(np.sqrt(2.0) * reading_v / level)
