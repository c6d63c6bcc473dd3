"""A simulated exciter behind a sound card: high-pass, delay, modes, a hardening spring, a noisy accelerometer.

One is drawn at random for a demonstration, with its display.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.io.display import parse_display
from tactuator.model.description import Display
from tactuator.runtime._core import ffi, lib

SUBSTEPS = 8
RATE_HZ = 48000.0


@dataclass(frozen=True)
class Exciter:
    """An exciter with its amplifier and accelerometer. resonance_hz, q: of the first mode; second_hz, second_q,
    second_share: of another, and its share of the drive.

    drive: mm/s² for a volt. hardening: 1/mm², of the first spring. delay_s: from the card's output to the coil.
    high_pass_hz: the card's own, first order. volts, sensor_full_scale: volts at the coil, and mm/s² at the
    accelerometer, for a sample of 1.0. noise, hum: mm/s² rms of white noise, peak at hum_hz. felt_full_scale_mm: of the
    port that tells the displacement itself.
    """

    resonance_hz: float = 110.0
    q: float = 5.0
    drive: float = 2.0e4
    second_hz: float = 420.0
    second_q: float = 8.0
    second_share: float = 0.1
    hardening: float = 0.0
    delay_s: float = 0.004
    high_pass_hz: float = 8.0
    volts: float = 2.0
    sensor_full_scale: float = 5.0e4
    noise: float = 20.0
    hum: float = 5.0
    hum_hz: float = 50.0
    felt_full_scale_mm: float = 2.0

    def response(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return mm at the finger for a volt asked of the card, at `frequency_hz` (any shape), for small amplitudes and
        in continuous time: the truth that the simulation is held against.
        """
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)
        moved = np.zeros(s.shape, dtype=np.complex128)
        for hertz, q, drive in self._modes():
            w = 2.0 * np.pi * hertz
            moved += drive / (s * s + s * w / q + w * w)
        corner = 2.0 * np.pi * self.high_pass_hz
        return np.asarray(moved * s / (s + corner) * np.exp(-s * self.delay_s))

    def _modes(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        first = (self.resonance_hz, self.q, self.drive * (1.0 - self.second_share))
        return first, (self.second_hz, self.second_q, self.drive * self.second_share)


class RunningExciter:
    """An exciter at rest that is fed block after block at rate_hz."""

    def __init__(self, exciter: Exciter, rate_hz: float, rng: np.random.Generator) -> None:
        self._exciter, self._rate_hz, self._rng = exciter, rate_hz, rng
        self._state = ffi.new("tact_exciter *")
        self._state.step_s, self._state.substeps = 1.0 / (rate_hz * SUBSTEPS), SUBSTEPS
        for mode, (hertz, q, drive) in zip(self._state.mode, exciter._modes(), strict=True):
            w = 2.0 * np.pi * hertz
            mode.drive, mode.damping, mode.stiffness = drive, w / q, w * w
        self._state.mode[0].hardening = exciter.hardening
        self._high_pass = scipy.signal.butter(1, exciter.high_pass_hz, "highpass", fs=rate_hz)
        self._passed = np.zeros(1)
        self._late = np.zeros(round(exciter.delay_s * rate_hz))
        self._samples = 0

    def answer(self, share: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the samples of the accelerometer and of the displacement, (n,), for samples of command (n,)."""
        exciter = self._exciter
        passed, self._passed = scipy.signal.lfilter(*self._high_pass, exciter.volts * share, zi=self._passed)
        waiting = np.concatenate([self._late, passed])
        command, self._late = np.ascontiguousarray(waiting[: share.size]), waiting[share.size :]
        acceleration, moved = np.empty(share.size), np.empty(share.size)
        buffers = [ffi.from_buffer("double[]", array) for array in (command, acceleration, moved)]
        lib.tact_exciter_run(self._state, *buffers, share.size)
        time = (self._samples + np.arange(share.size)) / self._rate_hz
        self._samples += share.size
        noise = exciter.noise * self._rng.standard_normal(share.size)
        heard = acceleration + noise + exciter.hum * np.sin(2.0 * np.pi * exciter.hum_hz * time)
        return np.clip(heard / exciter.sensor_full_scale, -1.0, 1.0), np.clip(
            moved / exciter.felt_full_scale_mm, -1.0, 1.0
        )


def demo_exciter(rng: np.random.Generator) -> Exciter:
    """Return an exciter as one can buy: resonance 60 to 150 Hz, Q 2 to 8, a second mode, delay and high-pass."""
    resonance_hz = float(rng.uniform(60.0, 150.0))
    return Exciter(
        resonance_hz=resonance_hz,
        q=float(rng.uniform(2.0, 8.0)),
        drive=3e4,
        second_hz=resonance_hz * float(rng.uniform(2.0, 4.0)),
        hardening=0.2,
        delay_s=float(rng.uniform(0.002, 0.02)),
        sensor_full_scale=1e5,
    )


def demo_display(exciter: Exciter) -> Display:
    """Return its display, whose plant is a rough guess: the calibration finds it anew."""
    document = {
        "display": {"name": "simulated exciter", "rate_hz": RATE_HZ, "delay_samples": 0},
        "threshold": {"curve": "bolanowski-1988", "band_hz": [10.0, 400.0]},
        "feedback": {"structure": "none"},
        "converter": {"range_v": exciter.volts},
        "sound": {
            "output_full_scale_v": exciter.volts,
            "input_full_scale_v": 1e-3 * exciter.sensor_full_scale,
            "lead_s": 0.5,
        },
        "channel": [
            {
                "name": "exciter",
                "sensor_gain_v_per_mm": 1e-3,
                "quantity": "acceleration",
                "travel_mm": 1.0,
                "plant": {"num": [1.0], "den": [1.0, 100.0, 1e6]},
            }
        ],
    }
    return parse_display(document)
