"""Rendering of a speech file to a reference: coded, set to a level, limited; streamed from the first sample to the
last.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.controller import Controller
from tactuator.perception.curve import check_level
from tactuator.speech.coding.coding import Coding
from tactuator.speech.coding.direct import DirectCoding
from tactuator.speech.level import LevelMeter
from tactuator.speech.limiter.limiter import FingerLimiting, Limiter
from tactuator.speech.reading import SpeechFile, scan_speech, speech_blocks

LEVEL_DB_SL = 35.0
QUIETEST_DB = -90.0
"""Of full scale: a coding that leaves less than this of a file has found nothing in it."""
RAMP_S = 0.02
BLOCK_S = 4.0
PIECE_FRAMES = 1 << 12
"""Samples that go on together: few enough that what is made of them stays in the cache."""


@dataclass(frozen=True, eq=False)
class Rendering:
    """A speech file on its way to a reference; made by `rendering`. gain: threshold units per full scale."""

    speech: SpeechFile
    controller: Controller
    level_db_sl: float
    gain: float
    frames: int
    _coded: IO[bytes]
    _placement: FloatArray
    _limiter: Limiter

    @property
    def channels(self) -> tuple[str, ...]:
        """Return the display's channels, in the order of the blocks' columns."""
        return tuple(channel.name for channel in self.controller.display.channels)

    @property
    def limiting(self) -> tuple[FingerLimiting, ...]:
        """Return the limiting so far, finger by finger."""
        return self._limiter.report

    def blocks(self) -> Iterator[FloatArray]:
        """Yield the reference in blocks (n, channels), threshold units, float32 numbers; once only."""
        for stretch in self._limiter.process(self._levelled()):
            for start in range(0, len(stretch), PIECE_FRAMES):
                yield stretch[start : start + PIECE_FRAMES].astype(np.float32).astype(np.float64)

    def _levelled(self) -> Iterator[FloatArray]:
        ramp = min(round(RAMP_S * self.controller.rate_hz), self.frames // 2)
        rise = 0.5 - 0.5 * np.cos(np.pi * (np.arange(ramp) + 0.5) / max(ramp, 1))
        matrix, width = self.gain * self._placement, len(self._placement)
        length, at = round(BLOCK_S * self.controller.rate_hz), 0
        self._coded.seek(0)
        while data := self._coded.read(4 * width * length):
            block = np.frombuffer(data, dtype=np.float32).reshape(-1, width).astype(np.float64)
            last = self.frames - at
            if at < ramp:
                count = min(ramp - at, len(block))
                block[:count] *= rise[at : at + count, None]
            if len(block) > last - ramp:
                index = last - 1 - np.arange(max(0, last - ramp), len(block))
                block[max(0, last - ramp) :] *= rise[index, None]
            at += len(block)
            yield block * matrix if width == 1 else block @ matrix


@contextmanager
def rendering(
    path: str | Path,
    controller: Controller,
    coding: Coding | None = None,
    level_db_sl: float = LEVEL_DB_SL,
    workspace: str | Path | None = None,
) -> Iterator[Rendering]:
    """Read and code a speech file, and find its level; then `.blocks()` gives the reference.

    What is coded waits in an unnamed file in the folder `workspace` (the system's by default), so that memory does not
    grow with the speech. Raises BadInput for a file that is refused (see `scan_speech`), a level that is not below
    comfort, a rate that is not a whole number of hertz, or speech in which the coding finds nothing.
    """
    coding = DirectCoding() if coding is None else coding
    check_level(level_db_sl)
    rate = controller.rate_hz
    if rate != int(rate):
        raise BadInput(f"display runs at {rate:g} Hz; allowed for speech: a whole number of hertz")
    placement = coding.placement(tuple(channel.finger for channel in controller.display.channels))
    speech = scan_speech(path)
    with _room(workspace) as coded:
        meter, frames = LevelMeter(rate), 0
        try:
            for block in coding.signals(speech_blocks(speech), speech.rate_hz, int(rate)):
                coded.write(block.astype(np.float32).tobytes())
                meter.push(block if len(placement) == 1 else block @ placement)
                frames += len(block)
        except OSError as error:
            raise BadInput(f"{path}: no room to work in ({error.strerror})", "a disk with room") from None
        level = meter.level_db()
        if level < QUIETEST_DB:
            raise BadInput(
                f"{path}: coding {coding.kind!r} leaves {level:.0f} dB re full scale of it", f"{QUIETEST_DB:g} dB"
            )
        gain = float(10.0 ** ((level_db_sl - level) / 20.0))
        yield Rendering(speech, controller, level_db_sl, gain, frames, coded, placement, Limiter(controller))


def _room(workspace: str | Path | None) -> IO[bytes]:
    try:
        return tempfile.TemporaryFile(dir=workspace)
    except OSError as error:
        raise BadInput(f"{workspace}: {error.strerror}", "a folder that can be written") from None


def render_array(
    path: str | Path, controller: Controller, coding: Coding | None = None, level_db_sl: float = LEVEL_DB_SL
) -> tuple[FloatArray, SpeechFile, tuple[FingerLimiting, ...]]:
    """Render a short file at once: return the reference (n, channels) in threshold units, the file, and what the
    limiter did.
    """
    with rendering(path, controller, coding, level_db_sl) as making:
        blocks = list(making.blocks())
        return np.concatenate(blocks), making.speech, making.limiting
