"""Speech as a live stream makes it, as a signal to be kept: items for experiments on listening live."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tactuator.model.controller import Controller
from tactuator.speech.coding import Coding
from tactuator.speech.live.level import LevelSettings
from tactuator.speech.live.source import FileSource
from tactuator.speech.live.stream import LiveStream
from tactuator.speech.signal import Signal


def live_signal(path: Path, controller: Controller, coding: Coding, level_db_sl: float) -> Signal:
    """Return what `listen` makes of a speech file at its own pace, delay, gain, gate and limiter included.

    Gain and gate begin anew with the file. Raises BadInput for a file that is refused, a level that is not below
    comfort, or a coding that cannot be causal.
    """
    source = FileSource(path)
    stream = LiveStream(source, controller, coding, LevelSettings(level_db_sl))
    rows = np.concatenate(list(stream.blocks()))
    return Signal(len(rows), iter([rows]), {"live": True}, source.notes)
