"""Where live sound comes from: a file at its own pace, standard input, a microphone."""

from __future__ import annotations

import queue
import struct
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from os import PathLike
from pathlib import Path
from typing import Any, BinaryIO, Protocol, runtime_checkable

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, DeviceFault
from tactuator.rig.sound.cards import PORTAUDIO, Card, find_card, list_cards, quiet, sound_name, sounddevice
from tactuator.rig.sound.stream import SILENT_S, CardGone, refusal
from tactuator.speech.reading import HIGHEST_RATE_HZ, LOWEST_RATE_HZ, scan_speech, speech_blocks

LARGEST = 8.0
"""Times full scale: what is beyond is held there."""
PIECE_S, KEPT_PIECES = 0.0025, 400
"""Length of a microphone's pieces, and pieces of standard input that may wait: a second."""
AHEAD_S = 0.5
"""Standard input that is so far ahead is no live sound: it is a file, and goes at its own pace."""
_FORMATS = {(1, 16): "<i2", (1, 32): "<i4", (3, 32): "<f4"}
"""Samples of a WAV by format and bits."""
_FORMAT_BYTES, _SKIPPED_BYTES = 40, 1 << 16
"""Length of a format; and of the pieces in which what comes before the samples, up to 4 GB, is passed over."""


@runtime_checkable
class Source(Protocol):
    """Mono sound as it comes.

    rate_hz: of its own clock. ended: nothing more comes. piece_s: length of the pieces in which it comes. notes: what
    was done to it, one line each. It may have `late_s`, by how much the sound has been late already, and `fault`, why
    it ended.
    """

    rate_hz: int
    ended: bool
    piece_s: float
    notes: tuple[str, ...]

    def read(self, now_s: float) -> FloatArray:
        """Return what has come until now, (n,), without waiting. now_s: by the display's clock."""
        ...

    def close(self) -> None:
        """Let go of the device."""


class _Paced:
    """Samples that are due at a pace, from the first look on."""

    def __init__(self, pace_hz: float) -> None:
        self.pace_hz, self._given, self._begun_s = pace_hz, 0, -1.0

    def due(self, now_s: float) -> int:
        """Return how many samples are due now that were not taken."""
        if self._begun_s < 0.0:
            self._begun_s = now_s
        return max(0, int((now_s - self._begun_s) * self.pace_hz) - self._given)

    def take(self, samples: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
        """Return up to `count` samples, and the rest."""
        self._given += min(count, len(samples))
        return samples[:count], samples[count:]


class FileSource:
    """A sound file at its own pace; drift: by how much its clock is faster than the display's."""

    piece_s = 0.0

    def __init__(self, path: str | PathLike[str], drift: float = 0.0) -> None:
        speech = scan_speech(Path(path))
        self.rate_hz, self.notes, self.ended = speech.rate_hz, speech.notes, False
        self._pace = _Paced(speech.rate_hz * (1.0 + drift))
        self._blocks: Iterator[FloatArray] = speech_blocks(speech)
        self._rest: FloatArray = np.zeros(0)

    def read(self, now_s: float) -> FloatArray:
        """Return what of the file is due: its first sample at the first call."""
        count = self._pace.due(now_s)
        while len(self._rest) < count and not self.ended:
            block = next(self._blocks, None)
            self.ended = block is None
            self._rest = self._rest if block is None else np.concatenate((self._rest, block))
        taken, self._rest = self._pace.take(self._rest, count)
        return taken

    def close(self) -> None:
        """Let go of the file."""
        self._blocks, self.ended = iter(()), True


class PipeSource:
    """A WAV, or raw samples (16 bits, little-endian, mono) at `rate_hz`, as they come through a pipe.

    What comes faster than it can be played, as from a file, goes at its own pace. Raises BadInput for a WAV that is not
    read here, and for raw samples without a rate.
    """

    piece_s = PIECE_S

    def __init__(self, pipe: BinaryIO, rate_hz: int | None = None) -> None:
        head = pipe.read(12)
        wav = head[:4] == b"RIFF" and head[8:] == b"WAVE"
        if not wav and rate_hz is None:
            raise BadInput(
                "standard input is no WAV", "a WAV, or `rate_hz` with raw samples (16 bits, little-endian, mono)"
            )
        dtype, channels, rate, left = _wav_head(pipe) if wav else ("<i2", 1, rate_hz, _ENDLESS)
        assert rate is not None
        if not LOWEST_RATE_HZ <= rate <= HIGHEST_RATE_HZ:
            raise BadInput(f"standard input at {rate} Hz", f"{LOWEST_RATE_HZ} to {HIGHEST_RATE_HZ} Hz")
        self.rate_hz, self.ended = rate, False
        self.notes: tuple[str, ...] = (f"{channels} channels mixed down to one (their mean)",) if channels > 1 else ()
        self._pace, self._paced = _Paced(float(rate)), False
        self._pieces: queue.Queue[FloatArray | None] = queue.Queue(KEPT_PIECES)
        self._rest: FloatArray = np.zeros(0)
        threading.Thread(
            target=self._listen, args=(pipe, dtype, channels, left, b"" if wav else head), daemon=True
        ).start()

    def _listen(self, pipe: BinaryIO, dtype: str, channels: int, left: int, begun: bytes) -> None:
        size = np.dtype(dtype).itemsize * channels
        full = 1.0 if dtype == "<f4" else 2.0 ** (8 * np.dtype(dtype).itemsize - 1)
        read: Callable[[int], bytes] = getattr(pipe, "read1", pipe.read)
        piece = max(1, round(PIECE_S * self.rate_hz)) * size
        while not self.ended and (content := read(min(piece, left))):
            begun += content
            left -= len(content) if left < _ENDLESS else 0
            whole = len(begun) // size * size
            rows = np.frombuffer(begun[:whole], dtype).astype(np.float64).reshape(-1, channels)
            begun = begun[whole:]
            self._pieces.put(rows.mean(axis=1) / full)
        self._pieces.put(None)

    def read(self, now_s: float) -> FloatArray:
        """Return what has come, or of a file what is due."""
        over = False
        while not self._pieces.empty() and len(self._rest) < 2 * AHEAD_S * self.rate_hz:
            piece = self._pieces.get()
            over = piece is None
            self._rest = self._rest if piece is None else np.concatenate((self._rest, piece))
        self._paced = self._paced or len(self._rest) > AHEAD_S * self.rate_hz
        taken, self._rest = self._pace.take(self._rest, self._pace.due(now_s) if self._paced else len(self._rest))
        if over:
            self._pieces.put(None)
        self.ended = over and not len(self._rest)
        return taken

    def close(self) -> None:
        """Take no more."""
        self.ended = True


_ENDLESS = 2**31 - 4096
"""Bytes of samples from which on a WAV's head means a stream without an end, as programs that write to a pipe do."""


def _wav_head(pipe: BinaryIO) -> tuple[str, int, int, int]:
    """Read a WAV up to its samples; return how they are stored, the channels, the rate and the bytes of samples."""
    stored = (0, 0, 0, 0)
    while len(chunk := pipe.read(8)) == 8:
        name, size = struct.unpack("<4sI", chunk)
        if name == b"data":
            kind, channels, rate, bits = stored
            if (kind, bits) not in _FORMATS or not 1 <= channels <= 64:
                raise BadInput(f"standard input: a WAV of format {kind}, {bits} bits, {channels} channels",
                               "16 or 32 bits, or floats of 32 bits")  # fmt: skip
            return _FORMATS[kind, bits], channels, rate, min(size or _ENDLESS, _ENDLESS)
        content = pipe.read(min(size + size % 2, _FORMAT_BYTES))
        rest = size + size % 2 - len(content)
        while rest and (skipped := pipe.read(min(rest, _SKIPPED_BYTES))):
            rest -= len(skipped)
        if name == b"fmt " and len(content) >= 16:
            kind, channels, rate, _, _, bits = struct.unpack("<HHIIHH", content[:16])
            stored = (struct.unpack("<H", content[24:26])[0] if kind == 0xFFFE and len(content) >= 26 else kind,
                      channels, rate, bits)  # fmt: skip
    raise BadInput("standard input: a WAV that ends before its samples", "a whole one")


class Microphone:
    """A microphone as PortAudio has it: DEVICE[@RATE], or the system's own.

    late_s: as PortAudio states it. Raises BadInput for a device that is not there or has no input, or not that rate;
    DeviceFault where it cannot be opened (no permission, in use).
    """

    piece_s = PIECE_S

    def __init__(self, spec: str | None, clock: Callable[[], float] = time.monotonic) -> None:
        name, rate_hz = sound_name(spec or "")
        library, card = sounddevice(), _input(name)
        self.rate_hz = round(rate_hz or card.rate_hz)
        self.ended = False
        self.notes: tuple[str, ...] = (f"from {card.full_name}",)
        self._pieces: deque[FloatArray] = deque()
        self._clock, self._heard_s = clock, clock()
        self.fault: DeviceFault | None = None

        def heard(content: Any, frames: int, at: Any, flags: Any) -> None:
            self._pieces.append(content.mean(axis=1).astype(np.float64))

        def started() -> Any:
            stream = library.InputStream(
                device=card.index, samplerate=self.rate_hz, channels=min(2, card.inputs), dtype="float32",
                blocksize=round(PIECE_S * self.rate_hz), latency="low", callback=heard,
            )  # fmt: skip
            stream.start()
            return stream

        try:
            with quiet():
                self._stream = PORTAUDIO.answer(started, f"opening microphone {card.full_name!r}", _ended)
        except library.PortAudioError as error:
            raise refusal(error, card, self.rate_hz) from None
        self.late_s = float(self._stream.latency)

    def read(self, now_s: float) -> FloatArray:
        """Return what has come. A microphone that gives nothing for a second is gone: it has ended."""
        pieces = [self._pieces.popleft() for _ in range(len(self._pieces))]
        if pieces:
            self._heard_s = self._clock()
        elif self._clock() - self._heard_s > SILENT_S and not self.ended:
            self.ended = True
            self.fault = CardGone("the microphone has stopped: not a sample for a second", "one that stays connected")
        return np.concatenate((np.zeros(0), *pieces))

    def close(self) -> None:
        """Let go of the microphone."""
        if self.fault is None:
            with quiet():
                PORTAUDIO.answer(lambda: _ended(self._stream), "letting go of the microphone")


def _ended(stream: Any) -> None:
    stream.abort(ignore_errors=True)
    stream.close(ignore_errors=True)


def _input(name: str) -> Card:
    """Return the microphone of that name, or the first that there is. Raises BadInput."""
    cards = [card for card in list_cards() if card.inputs]
    if not cards:
        raise BadInput("there is no microphone", "`input` FILE, or - for standard input")
    if name:
        return find_card(name, cards)
    return next((card for card in cards if "default" in card.name.lower()), cards[0])


def open_source(name: str | PathLike[str] | None, rate_hz: int | None = None) -> Source:
    """Return the source of that name: a file, "-" for standard input, a microphone's name, None for the system's own.

    rate_hz: of raw samples. Raises BadInput for what is no sound, and DeviceFault for a microphone that does not open.
    """
    if name is not None and str(name) == "-":
        return PipeSource(sys.stdin.buffer, rate_hz)
    if name is not None and (Path(name).exists() or Path(name).suffix):
        if rate_hz is not None:
            raise BadInput(
                f"`rate_hz` with {name}", "`rate_hz` with `input` - alone: a file has its own, a device has @RATE"
            )
        return FileSource(name)
    if rate_hz is not None:
        raise BadInput("`rate_hz` with a microphone", f"`input` {name or 'DEVICE'}@{rate_hz}")
    return Microphone(None if name is None else str(name))


def cleaned(samples: FloatArray) -> tuple[FloatArray, int]:
    """Return samples within LARGEST, with zeros for those that are no numbers, and how many these were."""
    if np.abs(samples).max(initial=0.0) <= LARGEST:  # not so for what is no number
        return samples, 0
    bad = ~np.isfinite(samples)
    return np.clip(np.where(bad, 0.0, samples), -LARGEST, LARGEST), int(np.count_nonzero(bad))
