"""The sample that comes with tactuator: two short phrases by formant synthesis, nobody's voice.

`python tools/formant_synthesis.py OUT.wav` writes it anew. A glottal pulse train (or noise) runs through a cascade
of resonators whose centres glide from sound to sound (Klatt 1980, J. Acoust. Soc. Am. 67, 971-995, cascade branch);
formant frequencies are those of an adult male's vowels in Peterson & Barney (1952), rounded.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
import soundfile
from scipy import signal

from tactuator.arrays import FloatArray

RATE_HZ = 16000
FRAME_SAMPLES = 80
"""Samples for which the resonators stand still (5 ms)."""


@dataclass(frozen=True)
class Sound:
    """A sound of speech. formants_hz: three; voice and breath: amplitudes of the pulse train and of the noise; pitch_hz
    at its middle.
    """

    duration_s: float
    formants_hz: tuple[float, float, float]
    pitch_hz: float
    voice: float = 1.0
    breath: float = 0.0


PHRASE = (
    Sound(0.09, (250.0, 1100.0, 2300.0), 118.0, 0.45),  # m
    Sound(0.20, (730.0, 1090.0, 2440.0), 132.0),  # a
    Sound(0.06, (300.0, 1700.0, 2600.0), 130.0, 0.0),  # t, closed
    Sound(0.05, (400.0, 1800.0, 2600.0), 130.0, 0.0, 0.5),  # t, burst
    Sound(0.20, (270.0, 2290.0, 3010.0), 146.0),  # i
    Sound(0.14, (1500.0, 3800.0, 5200.0), 140.0, 0.0, 0.7),  # s
    Sound(0.18, (300.0, 870.0, 2240.0), 128.0),  # u
    Sound(0.10, (250.0, 1400.0, 2500.0), 116.0, 0.4),  # n
    Sound(0.18, (570.0, 840.0, 2410.0), 108.0),  # o
    Sound(0.22, (500.0, 1500.0, 2500.0), 100.0, 0.0),  # a pause
    Sound(0.08, (250.0, 1000.0, 2200.0), 140.0, 0.3),  # b, voiced closure
    Sound(0.20, (530.0, 1840.0, 2480.0), 168.0),  # e
    Sound(0.12, (350.0, 1500.0, 2600.0), 150.0, 0.5, 0.25),  # z
    Sound(0.22, (660.0, 1720.0, 2410.0), 138.0),  # ae
    Sound(0.09, (350.0, 1100.0, 2300.0), 120.0, 0.6),  # l
    Sound(0.26, (730.0, 1090.0, 2440.0), 104.0),  # a
)
BANDWIDTHS_HZ = (70.0, 100.0, 150.0)


def synthesise(sounds: tuple[Sound, ...] = PHRASE, seed: int = 1988) -> FloatArray:
    """Return mono speech at 16 kHz, shape (n,), peak 0.7 of full scale."""
    ends = np.cumsum([sound.duration_s for sound in sounds])
    count = round(float(ends[-1]) * RATE_HZ / FRAME_SAMPLES) * FRAME_SAMPLES
    middles = ends - 0.5 * np.array([sound.duration_s for sound in sounds])
    time = np.arange(count) / RATE_HZ
    track = {name: np.array([getattr(sound, name) for sound in sounds]) for name in ("pitch_hz", "voice", "breath")}
    pitch = np.interp(time, middles, track["pitch_hz"])
    voice, breath = (_steps(track[name], ends, count) for name in ("voice", "breath"))
    noise = np.random.default_rng(seed).standard_normal(count)
    source = voice * _glottal_flow_slope(pitch) + 0.12 * breath * noise
    formants = np.array([np.interp(time, middles, [sound.formants_hz[k] for sound in sounds]) for k in range(3)])
    spoken = _resonate(source, formants)
    return np.asarray(0.7 * spoken / np.max(np.abs(spoken)))


def _steps(values: FloatArray, ends: FloatArray, count: int) -> FloatArray:
    """Return a value for each sound, stepped at its ends and smoothed over 15 ms."""
    at = np.minimum(np.searchsorted(ends, np.arange(count) / RATE_HZ, side="right"), len(values) - 1)
    window = signal.windows.hann(2 * round(0.015 * RATE_HZ) + 1)
    padded = np.concatenate(([0.0] * (len(window) // 2), values[at], [0.0] * (len(window) // 2)))
    return np.asarray(signal.fftconvolve(padded, window / window.sum(), "valid"))


def _glottal_flow_slope(pitch_hz: FloatArray) -> FloatArray:
    """Return the slope of a glottal flow that opens as a raised cosine over 60 % of the period and is closed for the
    rest.
    """
    phase = np.cumsum(pitch_hz) / RATE_HZ % 1.0
    flow = np.where(phase < 0.6, 0.5 - 0.5 * np.cos(2.0 * np.pi * phase / 0.6), 0.0)
    return np.diff(flow, prepend=flow[0]) * 10.0 + 0.1 * (flow - 0.3)


def _resonate(source: FloatArray, formants_hz: FloatArray) -> FloatArray:
    """Return the source through three resonators in series, each of gain 1 at rest, their states going on from frame to
    frame.
    """
    output = source.copy()
    for track, width in zip(formants_hz, BANDWIDTHS_HZ, strict=True):
        radius = np.exp(-np.pi * width / RATE_HZ)
        state = np.zeros(2)
        for start in range(0, len(output), FRAME_SAMPLES):
            centre = track[start + FRAME_SAMPLES // 2]
            denominator = np.array([1.0, -2.0 * radius * np.cos(2.0 * np.pi * centre / RATE_HZ), radius**2])
            numerator = np.array([denominator.sum(), 0.0, 0.0])
            block = output[start : start + FRAME_SAMPLES]
            output[start : start + FRAME_SAMPLES], state = signal.lfilter(numerator, denominator, block, zi=state)
    return output


if __name__ == "__main__":
    soundfile.write(sys.argv[1], synthesise(), RATE_HZ, subtype="PCM_16")
