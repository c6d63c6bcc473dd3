"""Spectra of records: power in bands, complex amplitudes of lines (lock-in), third octaves (IEC 61260-1, base ten), and
the window that slides over a stream.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, DTypeLike, NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput


@dataclass(frozen=True)
class Band:
    """A band of frequencies: edges and mid frequency in hertz."""

    low_hz: float
    centre_hz: float
    high_hz: float


def third_octave_bands(low_hz: float, high_hz: float) -> tuple[Band, ...]:
    """Return the third-octave bands whose mid frequencies 1000 * 10^(k/10) lie within [low_hz, high_hz] (2 % tolerance:
    nominal frequencies are rounded).

    Raises BadInput unless 0 < low_hz <= high_hz.
    """
    if not 0.0 < low_hz <= high_hz:
        raise BadInput(f"band {low_hz}..{high_hz} Hz", "0 < low <= high")
    first = int(np.ceil(10.0 * np.log10(low_hz / 1000.0 / 1.02)))
    last = int(np.floor(10.0 * np.log10(high_hz / 1000.0 * 1.02)))
    half = 10.0 ** (1.0 / 20.0)
    centres = [1000.0 * 10.0 ** (k / 10.0) for k in range(first, last + 1)]
    return tuple(Band(centre / half, centre, centre * half) for centre in centres)


class LockIn:
    """Lock-in at certain frequencies for blocks of `count` samples; what does not depend on values is kept."""

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
        amplitudes = solution[:count] + 1j * solution[count : 2 * count]
        turn = np.exp(self._turn * start)  # the block was taken to begin at k = 0
        return np.asarray(amplitudes * (turn if values.ndim == 1 else turn[:, None]))


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


KEEP_OFF_HZ = 2.0
"""Distance that what is played keeps from multiples of mains by default, hertz."""


def nearest_mains(frequency_hz: ArrayLike, mains_hz: float) -> FloatArray:
    """Return the multiple of mains_hz that is nearest to each frequency, hertz, the fundamental at least."""
    return np.asarray(mains_hz * np.maximum(np.round(np.asarray(frequency_hz) / mains_hz), 1.0))


def off_mains(
    frequency_hz: ArrayLike,
    mains_hz: float | None = 60.0,
    clearance_hz: float = KEEP_OFF_HZ,
    band_hz: tuple[float, float] = (0.0, np.inf),
) -> FloatArray:
    """Return frequencies (m,); those too near a multiple of mains are moved to clearance_hz from it, in the band."""
    frequency = np.array(np.atleast_1d(frequency_hz), dtype=np.float64)
    if not mains_hz:
        return frequency
    nearest = nearest_mains(frequency, mains_hz)
    away = frequency - nearest
    down = (nearest + clearance_hz > band_hz[1]) | ((away < 0.0) & (nearest - clearance_hz >= band_hz[0]))
    return np.where(np.abs(away) < clearance_hz, nearest + np.where(down, -clearance_hz, clearance_hz), frequency)


@dataclass(frozen=True)
class PowerSpectrum:
    """One-sided power spectral density, unit^2/Hz, at frequency_hz (m,), from `averages` windows."""

    frequency_hz: FloatArray
    density: FloatArray
    averages: float

    @property
    def spacing_hz(self) -> float:
        """Return the distance between two lines, hertz."""
        return float(self.frequency_hz[1])

    def power(self, low_hz: float, high_hz: float, without_hz: ArrayLike = (), width_hz: float = 1.5) -> float:
        """Return the power within low..high, unit^2, without +/- width_hz around each of `without_hz`.

        What was left out is filled with the mean density of the rest, so that a band does not shrink with it; a band
        that is all left out has none.
        """
        edges = self.frequency_hz + 0.5 * self.spacing_hz
        share = np.clip(np.minimum(edges, high_hz) - np.maximum(edges - self.spacing_hz, low_hz), 0.0, None)
        kept = np.ones(share.size, dtype=bool)
        for line in np.atleast_1d(np.asarray(without_hz, dtype=np.float64)):
            kept &= np.abs(self.frequency_hz - line) > width_hz
        width = float(np.sum(share * kept))
        return float(np.sum(self.density * share * kept)) * (float(np.sum(share)) / width) if width > 0.0 else 0.0

    def through(self, response: ComplexArray) -> PowerSpectrum:
        """Return the spectrum behind a system with that response (m,) at frequency_hz."""
        return PowerSpectrum(self.frequency_hz, self.density * np.abs(response) ** 2, self.averages)


def mean_over_frequency(
    values: FloatArray, frequency_hz: ArrayLike, at_hz: ArrayLike, share: float = 0.0, fewest: int = 1
) -> FloatArray:
    """Return the means of values (..., n) at ascending frequency_hz (n,) around each of at_hz (m,): over `share` of
    that frequency to either side, and over the `fewest` values around it at least. Shape (..., m)."""
    frequency, at = np.asarray(frequency_hz), np.asarray(at_hz)
    low = np.searchsorted(frequency, at * (1.0 - share))
    high = np.searchsorted(frequency, at * (1.0 + share), side="right")
    missing = np.maximum(fewest - (high - low), 0)
    low = np.maximum(np.minimum(low - (missing + 1) // 2, frequency.size - fewest), 0)
    high = np.minimum(np.maximum(high + missing // 2, low + fewest), frequency.size)
    # sums of each window by itself: running sums would lose what is small beside a strong line
    ended = np.concatenate([values, np.zeros((*values.shape[:-1], 1))], axis=-1)
    sums = np.add.reduceat(ended, np.stack([low, high], axis=1).ravel(), axis=-1)[..., ::2]
    return np.asarray(sums / (high - low))


def frequency_response(command: ComplexArray, position: ComplexArray) -> tuple[ComplexArray, FloatArray]:
    """Return the response by spectra of periods, (periods, ...), and its variance by what differs between them.

    The command repeats, and there are two periods or more.
    """
    count, asked, mean = len(position), command.mean(axis=0), position.mean(axis=0)
    scatter = np.sum(np.abs(position - mean) ** 2, axis=0) / (count * (count - 1))
    return np.asarray(mean / asked), np.asarray(scatter / np.abs(asked) ** 2)


def mean_of_blocks(blocks: ComplexArray, coverage: float = 0.95) -> tuple[ComplexArray, FloatArray, FloatArray]:
    """Return the mean of complex amplitudes (count, ...), the half-width of its size at `coverage` (Student's t), and
    the rms of the noise in one of them."""
    count, mean = len(blocks), blocks.mean(axis=0)
    degrees = 2 * (count - 1)
    variance = np.sum(np.abs(blocks - mean) ** 2, axis=0) / degrees  # along the amplitude; as much across it
    half_width = scipy.stats.t.isf(0.5 * (1.0 - coverage), degrees) * np.sqrt(variance / count)
    return np.asarray(mean), np.asarray(half_width), np.sqrt(2.0 * variance)


def power_spectrum(values: ArrayLike, rate_hz: float, resolution_hz: float = 1.0) -> PowerSpectrum:
    """Return Welch's estimate: Hann windows of 1/resolution_hz, half overlapping, mean taken off each.

    values: (n,). Raises BadInput where the record is shorter than one window.
    """
    data = np.asarray(values, dtype=np.float64)
    length = round(rate_hz / resolution_hz)
    if data.ndim != 1 or data.size < length:
        raise BadInput(f"{data.size} samples for a resolution of {resolution_hz:g} Hz", f"{length} or more")
    frequency, density = scipy.signal.welch(data, rate_hz, window="hann", nperseg=length, detrend="constant")
    return PowerSpectrum(frequency, density, 1.0 + 1.2 * (data.size / length - 1.0))


class SlidingWindow:
    """Holds `rows` (channels, size) of a stream and moves on by `hop` samples, half a window or more; the stream is
    padded with `before` zeros at its start, and with zeros after its end. The window is filled in place; no block is
    copied.
    """

    def __init__(self, channels: int, size: int, hop: int, before: int, dtype: DTypeLike = np.float64) -> None:
        self.rows: NDArray[Any] = np.zeros((channels, size), dtype=dtype)
        self._hop, self._before, self.filled = hop, before, before

    def push(self, *columns: FloatArray) -> Iterator[None]:
        """Count in arrays (n, ...) that hold the stream's channels between them; yield whenever the window is full."""
        at, size = 0, self.rows.shape[1]
        places = np.cumsum([0, *(block.shape[1] for block in columns)])
        while at < len(columns[0]):
            part = min(len(columns[0]) - at, size - self.filled)
            for row, block in zip(places, columns, strict=False):
                self.rows[row : row + block.shape[1], self.filled : self.filled + part] = block[at : at + part].T
            at, self.filled = at + part, self.filled + part
            if self.filled == size:
                yield
                self._move_on()

    def finish(self) -> Iterator[int]:
        """Yield, while there are any, how many samples of the stream are left in the window behind the first."""
        for count in range(self.filled - self._before, 0, -self._hop):
            self.rows[:, self.filled :] = 0.0
            yield count
            if count > self._hop:
                self._move_on()

    def _move_on(self) -> None:
        self.rows[:, : -self._hop] = self.rows[:, self._hop :]
        self.filled -= self._hop
