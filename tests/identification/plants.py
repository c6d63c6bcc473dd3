"""Random second-order plants and records of them, simulated independently of the package's own states."""

from dataclasses import dataclass

import numpy as np
from scipy import signal

from tactuator.signals.record import Record

RATE_HZ = 4000.0


@dataclass(frozen=True)
class Plant:
    num: np.ndarray
    den: np.ndarray

    def response(self, frequency_hz):
        s = 2j * np.pi * np.asarray(frequency_hz)
        return np.polyval(self.num, s) / np.polyval(self.den, s)

    def sampled(self, rate_hz=RATE_HZ):
        """(b, a) under a zero-order hold, from scipy."""
        b, a, _ = signal.cont2discrete((self.num, self.den), 1.0 / rate_hz)
        return b[0], a


PAPER = Plant(np.array([2875.0]), np.array([1.0, 94.0, 290.0]))


def open_loop(plant: Plant, rng, duration_s=60.0, noise=0.1, rate_hz=RATE_HZ) -> Record:
    """White command; white sensor noise `noise` times the position's rms (0.1: 20 dB)."""
    command = rng.standard_normal(round(duration_s * rate_hz))
    clean = signal.lfilter(*plant.sampled(rate_hz), command)
    return Record(rate_hz, command, clean + noise * clean.std() * rng.standard_normal(clean.size))


def closed_loop(plant: Plant, rng, duration_s=60.0, noise=0.1, rate_hz=RATE_HZ, colour=0.0) -> Record | None:
    """u = K (r - y), y with sensor noise fed back; None where that K is not stable."""
    count = round(duration_s * rate_hz)
    gain = rng.uniform(1.0, 10.0) * plant.den[-1] / plant.num[-1]
    b, a = plant.sampled(rate_hz)
    closed = np.polyadd(a, gain * b)
    if np.max(np.abs(np.roots(closed))) > 1.0 - 1e-5:
        return None
    reference = rng.standard_normal(count)
    disturbance = signal.lfilter([1.0], [1.0, -colour], rng.standard_normal(count))
    disturbance *= noise * signal.lfilter(gain * b, closed, reference).std() / disturbance.std()
    position = signal.lfilter(gain * b, closed, reference - disturbance) + disturbance
    return Record(rate_hz, gain * (reference - position), position)
