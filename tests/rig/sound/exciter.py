"""A simulated exciter for a sound card: a high-pass, a delay, two modes of which the first has a spring that hardens,
and a noisy accelerometer.

    x1'' + damping1 x1' + stiffness1 (1 + hardening x1²) x1 = drive1 u        acceleration = x1'' + x2''
    x2'' + damping2 x2' + stiffness2                     x2 = drive2 u        displacement = x1 + x2

Another arithmetic than the simulated display's, on purpose: open loops are identified, equalised and verified on it.
"""

import ctypes
import shlex
import subprocess
import sysconfig
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from tactuator.arrays import ComplexArray, FloatArray

SUBSTEPS = 8


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
        for drive, damping, stiffness in self.modes():
            moved += drive / (s * s + s * damping + stiffness)
        corner = 2.0 * np.pi * self.high_pass_hz
        return np.asarray(moved * s / (s + corner) * np.exp(-s * self.delay_s))

    def modes(self) -> FloatArray:
        """Drive, damping and stiffness of each mode."""
        w = 2.0 * np.pi * np.array([self.resonance_hz, self.second_hz])
        drive = self.drive * np.array([1.0 - self.second_share, self.second_share])
        return np.column_stack([drive, w / [self.q, self.second_q], w * w])


@cache
def _compiled() -> ctypes.CDLL:
    compiler = shlex.split(sysconfig.get_config_var("CC") or "cc")[0]
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "exciter.so"
        source = Path(__file__).with_name("exciter.c")
        subprocess.run([compiler, "-std=c99", "-O2", "-shared", "-fPIC", source, "-o", library], check=True)
        return ctypes.CDLL(str(library))


class RunningExciter:
    """An exciter at rest that is fed block after block at rate_hz."""

    def __init__(self, exciter: Exciter, rate_hz: float, rng: np.random.Generator) -> None:
        self._exciter, self._rate_hz, self._rng = exciter, rate_hz, rng
        hardening_and_state = [[exciter.hardening, 0.0, 0.0], [0.0, 0.0, 0.0]]
        self._modes = np.column_stack([exciter.modes(), hardening_and_state])
        self._run = _compiled().exciter_run
        self._high_pass = signal.butter(1, exciter.high_pass_hz, "highpass", fs=rate_hz)
        self._passed = np.zeros(1)
        self._late = np.zeros(round(exciter.delay_s * rate_hz))
        self._samples = 0

    def answer(self, share: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the samples of the accelerometer and of the displacement, (n,), for samples of command (n,)."""
        exciter = self._exciter
        passed, self._passed = signal.lfilter(*self._high_pass, exciter.volts * share, zi=self._passed)
        waiting = np.concatenate([self._late, passed])
        command, self._late = np.ascontiguousarray(waiting[: share.size]), waiting[share.size :]
        acceleration, moved = np.empty(share.size), np.empty(share.size)
        buffers = [ctypes.c_void_p(array.ctypes.data) for array in (self._modes, command, acceleration, moved)]
        step_s = ctypes.c_double(1.0 / (self._rate_hz * SUBSTEPS))
        self._run(buffers[0], step_s, SUBSTEPS, *buffers[1:], ctypes.c_size_t(share.size))
        time = (self._samples + np.arange(share.size)) / self._rate_hz
        self._samples += share.size
        noise = exciter.noise * self._rng.standard_normal(share.size)
        heard = acceleration + noise + exciter.hum * np.sin(2.0 * np.pi * exciter.hum_hz * time)
        return np.clip(heard / exciter.sensor_full_scale, -1.0, 1.0), np.clip(
            moved / exciter.felt_full_scale_mm, -1.0, 1.0
        )
