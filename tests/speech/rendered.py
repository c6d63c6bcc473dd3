"""A short file rendered at once; samples cut into blocks."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.model.controller import Controller
from tactuator.speech.band_codings import DirectCoding
from tactuator.speech.coding import Coding
from tactuator.speech.limiter import FingerLimiting, Limiter
from tactuator.speech.options import LEVEL_DB_SL
from tactuator.speech.spoken import speech_signal


def render_array(
    path: Path, controller: Controller, coding: Coding | None = None, level_db_sl: float = LEVEL_DB_SL
) -> tuple[FloatArray, tuple[FingerLimiting, ...]]:
    """The reference (n, channels) in threshold units, and what the limiter did."""
    limiter = Limiter(controller)
    with speech_signal(path, controller, coding or DirectCoding(), level_db_sl) as signal:
        blocks = [block.astype(np.float32).astype(float) for block in limiter.process(signal.blocks)]
    return np.concatenate(blocks), limiter.report


def cut(samples: FloatArray, lengths: Sequence[int]) -> Iterator[FloatArray]:
    at = turn = 0
    while at < len(samples):
        yield samples[at : at + lengths[turn % len(lengths)]]
        at, turn = at + lengths[turn % len(lengths)], turn + 1
