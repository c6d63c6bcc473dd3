"""Where live sound comes from: a file at its own pace, standard input, a microphone."""

from __future__ import annotations

from collections.abc import Iterator
from os import PathLike
from pathlib import Path
from typing import Protocol

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.speech.reading import scan_speech, speech_blocks

LARGEST = 8.0
"""Times full scale: what is beyond is held there."""


class Source(Protocol):
    """Mono sound as it comes.

    rate_hz: of its own clock. ended: nothing more comes. piece_s: length of the pieces in which it comes. notes: what
    was done to it, one line each.
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


class FileSource:
    """A sound file at its own pace; drift: by how much its clock is faster than the display's."""

    piece_s = 0.0

    def __init__(self, path: str | PathLike[str], drift: float = 0.0) -> None:
        speech = scan_speech(Path(path))
        self.rate_hz, self.notes, self.ended = speech.rate_hz, speech.notes, False
        self._pace = speech.rate_hz * (1.0 + drift)
        self._blocks: Iterator[FloatArray] = speech_blocks(speech)
        self._rest, self._given, self._begun_s = np.zeros(0), 0, -1.0

    def read(self, now_s: float) -> FloatArray:
        """Return what of the file is due: its first sample at the first call."""
        if self._begun_s < 0.0:
            self._begun_s = now_s
        count = int((now_s - self._begun_s) * self._pace) - self._given
        while len(self._rest) < count and not self.ended:
            block = next(self._blocks, None)
            self.ended = block is None
            self._rest = self._rest if block is None else np.concatenate((self._rest, block))
        taken, self._rest = self._rest[: max(0, count)], self._rest[max(0, count) :]
        self._given += len(taken)
        return taken

    def close(self) -> None:
        """Let go of the file."""
        self._blocks, self.ended = iter(()), True


def open_source(name: str | PathLike[str] | None) -> Source:
    """Return the source of that name: a file. Raises BadInput for what is no sound."""
    if name is None:
        raise BadInput("no --input", "a sound file")
    return FileSource(name)


def cleaned(samples: FloatArray) -> tuple[FloatArray, int]:
    """Return samples within LARGEST, with zeros for those that are no numbers, and how many these were."""
    bad = ~np.isfinite(samples)
    return np.clip(np.where(bad, 0.0, samples), -LARGEST, LARGEST), int(np.count_nonzero(bad))
