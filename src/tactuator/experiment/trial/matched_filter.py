"""Amplitude of a sinusoid of known frequency and envelope in a stretch of signal, by least squares.

The basis is envelope x cos, envelope x sin and a constant: the matched filter of a ramped tone. It has no leakage from
the tone's own negative frequency, which a plain lock-in has when only a few periods are there, and none from an offset.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.signals.excitation import ramps


def amplitude(signal: FloatArray, frequency_hz: float, rate_hz: float, ramp_s: float) -> float:
    """Return the peak amplitude at `frequency_hz` of a tone with these ramps over the whole of signal, shape (n,)."""
    cosine, sine = _analysis(signal.size, frequency_hz, rate_hz, ramp_s) @ signal
    return float(np.hypot(cosine, sine))


@lru_cache(maxsize=64)
def _analysis(count: int, frequency_hz: float, rate_hz: float, ramp_s: float) -> FloatArray:
    """Return the two rows of the pseudo-inverse that give the cosine and sine amplitudes, shape (2, count)."""
    envelope = ramps(count, rate_hz, ramp_s)
    phase = 2.0 * np.pi * frequency_hz * np.arange(count) / rate_hz
    basis = np.column_stack([envelope * np.cos(phase), envelope * np.sin(phase), np.ones(count)])
    return np.ascontiguousarray(np.linalg.solve(basis.T @ basis, basis.T)[:2])
