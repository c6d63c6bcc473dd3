"""Speech as a signal in dB SL: a file read, coded, and set to a level, streamed from the first sample to the last.

The level of an utterance is its active level (speech/active_level.py), in dB SL. As everywhere, a level is that of the
sinusoid of the same rms: a sinusoid of amplitude 1 threshold unit is at 0 dB SL, so a rms of x is at
20 log10(sqrt(2) x).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import SpooledTemporaryFile
from typing import IO

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.controller import Controller
from tactuator.perception.curve import check_level
from tactuator.signals.decibels import db
from tactuator.speech.active_level import active_level
from tactuator.speech.coding import Coding
from tactuator.speech.reading import scan_speech, speech_blocks
from tactuator.speech.signal import Signal

QUIETEST_DB, LEAST_DB = -90.0, -60.0
"""Of full scale, and of a file's peak: a coding that leaves less than either of a file has found nothing in it."""
RAMP_S = 0.02
KEPT_BYTES = 1 << 22
"""So much of what is coded waits in memory."""
BLOCK_S = 4.0


def _ramped(blocks: Iterable[FloatArray], frames: int, rate_hz: float) -> Iterator[FloatArray]:
    """Yield blocks, `frames` samples in all, that rise from zero at their beginning and fall to zero at their end."""
    ramp, at = min(round(RAMP_S * rate_hz), frames // 2), 0
    rise = 0.5 - 0.5 * np.cos(np.pi * (np.arange(ramp) + 0.5) / max(ramp, 1))
    for block in blocks:
        gain, last = rise.reshape(-1, *[1] * (block.ndim - 1)), frames - at
        if at < ramp:
            count = min(ramp - at, len(block))
            block[:count] *= gain[at : at + count]
        if len(block) > last - ramp:
            index = last - 1 - np.arange(max(0, last - ramp), len(block))
            block[max(0, last - ramp) :] *= gain[index]
        at += len(block)
        yield block


@contextmanager
def speech_signal(
    path: str | Path, controller: Controller, coding: Coding, level_db_sl: float, workspace: Path | None = None
) -> Iterator[Signal]:
    """Read and code a speech file, and find its level: yield what it asks of the display.

    What is coded of a long file waits in an unnamed one in the folder `workspace` (the system's by default), so that
    memory does not grow with the speech. Raises BadInput for a file that is refused (see `scan_speech`), a level that
    is not below comfort, a rate that is not a whole number of hertz, or speech in which the coding finds nothing.
    """
    check_level(level_db_sl)
    rate = controller.rate_hz
    if rate != int(rate):
        raise BadInput(f"display runs at {rate:g} Hz; allowed for speech: a whole number of hertz")
    placement = coding.placement(tuple(channel.finger for channel in controller.display.channels))
    speech = scan_speech(path)
    with SpooledTemporaryFile(KEPT_BYTES, dir=None if workspace is None else str(workspace)) as coded:
        frames = 0
        try:
            # where a sound is cut, it has all frequencies: what lies outside of the band would be a click in it
            sound = _ramped(speech_blocks(speech), speech.frames, speech.rate_hz)
            for block in coding.signals(sound, speech.rate_hz, int(rate)):
                coded.write(np.ascontiguousarray(block, dtype=np.float32).data)
                frames += len(block)
        except OSError as error:
            raise BadInput(f"{path}: no room to work in ({error.strerror})", "a disk with room") from None
        spread = placement if len(placement) > 1 else np.ones((1, 1))
        active = active_level(lambda: (block @ spread for block in _read_back(coded, len(placement), rate)), rate)
        level, least = active.level_db, max(QUIETEST_DB, float(db(speech.peak)) + LEAST_DB)
        if level < least:
            said = f"coding {coding.kind!r} leaves {level:.0f} dB re full scale of it"
            raise BadInput(f"{path}: nothing of this sound lies in the band: {said}", f"{least:.0f} dB or more")
        gain = float(10.0 ** ((level_db_sl - level) / 20.0))
        about = {
            "encoding": speech.encoding,
            "duration_s": speech.duration_s,
            "threshold_units_per_speech_full_scale": gain,
            "active_share": active.share,
        }
        yield Signal(frames, _levelled(coded, gain * placement, frames, rate), about, (*speech.notes, *active.notes))


def _read_back(coded: IO[bytes], width: int, rate_hz: float) -> Iterator[FloatArray]:
    """Yield what was coded, (n, width), from its beginning."""
    length = 4 * width * round(BLOCK_S * rate_hz)
    coded.seek(0)
    for data in iter(lambda: coded.read(length), b""):
        yield np.frombuffer(data, dtype=np.float32).reshape(-1, width).astype(np.float64)


def _levelled(coded: IO[bytes], matrix: FloatArray, frames: int, rate_hz: float) -> Iterator[FloatArray]:
    """Yield what was coded, (n, signals), by the gains (signals, channels), with ramps at both ends."""
    width = len(matrix)
    for block in _ramped(_read_back(coded, width, rate_hz), frames, rate_hz):
        # finger by finger in memory, as the limiter looks at them
        yield np.multiply.outer(matrix[0], block[:, 0]).T if width == 1 else block @ matrix
