"""A short file rendered at once; samples cut into blocks."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.model.controller import Controller
from tactuator.speech.coding import Coding
from tactuator.speech.limiter import FingerLimiting
from tactuator.speech.options import LEVEL_DB_SL
from tactuator.speech.reading import SpeechFile
from tactuator.speech.render import rendering


def render_array(
    path: Path, controller: Controller, coding: Coding | None = None, level_db_sl: float = LEVEL_DB_SL
) -> tuple[FloatArray, SpeechFile, tuple[FingerLimiting, ...]]:
    """The reference (n, channels) in threshold units, the file, and what the limiter did."""
    with rendering(path, controller, coding, level_db_sl) as rendered:
        blocks = list(rendered.blocks())
        return np.concatenate(blocks), rendered.speech, rendered.limiting


def cut(samples: FloatArray, lengths: Sequence[int]) -> Iterator[FloatArray]:
    at = turn = 0
    while at < len(samples):
        yield samples[at : at + lengths[turn % len(lengths)]]
        at, turn = at + lengths[turn % len(lengths)], turn + 1
