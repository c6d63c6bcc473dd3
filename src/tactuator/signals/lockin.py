"""Lock-in: complex amplitudes of known frequencies in a record, by least squares."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput


class LockIn:
    """Lock-in at certain frequencies for blocks of `count` samples: what does not depend on the values is worked out
    once.
    """

    def __init__(self, frequency_hz: ArrayLike, rate_hz: float, count: int) -> None:
        """Raise BadInput for frequencies outside 0 .. rate/2 or more unknowns than samples."""
        frequency = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
        if np.any(frequency <= 0.0) or np.any(frequency >= rate_hz / 2.0):
            raise BadInput(f"lock-in at {frequency.tolist()} Hz", f"between 0 and {rate_hz / 2.0:g} Hz")
        if count < 2 * frequency.size + 2:
            raise BadInput(f"{count} samples for {frequency.size} frequencies", "more samples than unknowns")
        self._turn = -2j * np.pi * frequency / rate_hz
        angle = 2.0 * np.pi * np.outer(np.arange(count), frequency) / rate_hz
        ramp = np.linspace(-1.0, 1.0, count)[:, None]
        self._columns = np.hstack([np.cos(angle), -np.sin(angle), np.ones((count, 1)), ramp])
        self._inverse = np.linalg.pinv(self._columns.T @ self._columns, rcond=1e-12, hermitian=True)

    def __call__(self, values: FloatArray, start: int = 0) -> ComplexArray:
        """Return the complex amplitudes as `lock_in` does, of values (count,) or (count, channels)."""
        solution = self._inverse @ (self._columns.T @ values)
        count = self._turn.size
        found = solution[:count] + 1j * solution[count : 2 * count]
        turn = np.exp(self._turn * start)  # the block was taken to begin at k = 0
        return np.asarray(found * (turn if values.ndim == 1 else turn[:, None]))


def lock_in(values: ArrayLike, frequency_hz: ArrayLike, rate_hz: float, *, start: int = 0) -> ComplexArray:
    """Return the complex amplitudes a with values = Re sum a exp(2 pi i f k / rate) + offset + slope k: all fitted
    together.

    values: (n,) or (n, channels), k counting from `start`. Returns (m,) or (m, channels) for m frequencies. Fitting
    them together keeps a neighbouring line (mains, a harmonic) out of the others though no period fits the record.
    Raises BadInput for frequencies outside 0 .. rate/2 or more unknowns than samples.
    """
    data = np.asarray(values, dtype=np.float64)
    return LockIn(frequency_hz, rate_hz, data.shape[0])(data, start)


def mains_multiples(mains_hz: float | None, high_hz: float) -> FloatArray:
    """Return the mains frequency and its multiples up to high_hz; no frequency for None."""
    if not mains_hz:
        return np.zeros(0)
    return mains_hz * np.arange(1.0, int(high_hz / mains_hz) + 1.0)


def off_mains(frequency_hz: ArrayLike, mains_hz: float | None = 60.0, keep_off_hz: float = 2.0) -> FloatArray:
    """Return the frequencies (m,); those nearer than keep_off_hz to a multiple of mains are moved to that distance from
    it.
    """
    frequency = np.array(np.atleast_1d(frequency_hz), dtype=np.float64)
    if not mains_hz:
        return frequency
    nearest = mains_hz * np.maximum(np.round(frequency / mains_hz), 1.0)
    away = frequency - nearest
    moved = nearest + np.where(away >= 0.0, keep_off_hz, -keep_off_hz)
    return np.where(np.abs(away) < keep_off_hz, moved, frequency)
