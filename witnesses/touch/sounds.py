"""Sounds under which a finger lands, is lifted and drums: references of one channel, threshold units."""

from __future__ import annotations

from contextlib import ExitStack
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfilt

from tactuator.arrays import FloatArray
from tactuator.model.controller import Controller
from tests.speech.rendered import render_array
from witnesses.touch import felt

LEVEL_DB_SL = 30.0
FIVE_HZ = (3.0, 9.0, 27.0, 85.0, 250.0)


def _levelled(sound: FloatArray) -> FloatArray:
    """Return the sound at 30 dB SL: its rms that of a tone."""
    return np.asarray(sound * 10.0 ** (LEVEL_DB_SL / 20.0) / np.sqrt(2.0 * np.mean(sound**2)))


def _band(rng: np.random.Generator, samples: int, low_hz: float, high_hz: float) -> FloatArray:
    sections = butter(4, (low_hz, high_hz), "band", fs=felt.example().rate_hz, output="sos")
    return np.asarray(sosfilt(sections, rng.standard_normal(samples)))


def noise(rng: np.random.Generator, samples: int) -> FloatArray:
    """Return noise of 2 to 290 Hz."""
    return _levelled(_band(rng, samples, 2.0, 290.0))


def five_tones(rng: np.random.Generator, samples: int) -> FloatArray:
    """Return five tones of 3 to 250 Hz, each at 30 dB SL, with phases drawn."""
    time = np.arange(samples) / felt.example().rate_hz
    phase = rng.uniform(0.0, 2.0 * np.pi, len(FIVE_HZ))
    tones = np.sin(2.0 * np.pi * np.outer(time, FIVE_HZ) + phase)
    return np.asarray(10.0 ** (LEVEL_DB_SL / 20.0) * tones.sum(axis=1))


def speech_like(rng: np.random.Generator, samples: int) -> FloatArray:
    """Return bursts of noise of 80 to 290 Hz, of 0.08 to 0.3 s that rise and die away, with pauses of up to 0.3 s."""
    rate_hz = felt.example().rate_hz
    envelope: list[FloatArray] = []
    while sum(piece.size for piece in envelope) < samples:
        burst = round(rng.uniform(0.08, 0.3) * rate_hz)
        loud = 10.0 ** (rng.uniform(-10.0, 0.0) / 20.0)
        envelope.append(loud * np.sin(np.pi * (np.arange(burst) + 0.5) / burst) ** rng.uniform(0.5, 2.0))
        envelope.append(np.zeros(round(rng.uniform(0.0, 0.3) * rate_hz)))
    return _levelled(_band(rng, samples, 80.0, 290.0) * np.concatenate(envelope)[:samples])


SOUNDS = {"noise": noise, "five tones": five_tones, "speech-like bursts": speech_like}


def spoken(folder: Path | None) -> dict[str, FloatArray]:
    """Return each recording of a folder (the shipped sample where none is given) as the product codes it: (n, 3)."""
    controller = Controller(felt.example(), felt.designed())
    with ExitStack() as stack:
        shipped = stack.enter_context(as_file(files("tactuator.speech") / "data" / "sample.wav"))
        paths = [shipped] if folder is None else sorted(folder.glob("*.wav"))
        return {path.stem: render_array(path, controller, level_db_sl=LEVEL_DB_SL)[0] for path in paths}
