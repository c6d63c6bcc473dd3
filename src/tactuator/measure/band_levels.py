"""Levels in third-octave bands over time, of long streams, by short inverse transforms.

A chunk is transformed once; each band's bins, weighted and moved down to zero frequency, give the band's complex
envelope at a low rate. Its mean square over a frame is twice the band's power there: the level of the sinusoid of equal
power, 10 log10 of the mean square envelope. Bands up to 40 Hz are looked at over 500 ms, those above over 100 ms.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from tactuator.signals.spectra import Band, third_octave_bands

LONG_FRAME_S, SHORT_FRAME_S = 0.5, 0.1
LONG_UP_TO_HZ = 40.0
EDGE = 0.1
"""Width of a band's raised-cosine edges, of its bandwidth; the squares of neighbours add up to one."""

CHUNK_S, MARGIN_S = 12.0, 2.0
ENVELOPE_RATE_HZ = 160.0


Spectrum = NDArray[np.complex64] | NDArray[np.complex128]
Levels = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class BandFrames:
    """Levels of one stretch of time. long_db: (frames of 0.5 s, bands to 40 Hz); short_db: (frames of 0.1 s, above)."""

    long_db: Levels
    short_db: Levels


@dataclass(frozen=True)
class BandAnalysis:
    """Third-octave bands from low_hz to high_hz at a sampling rate of rate_hz."""

    rate_hz: float
    low_hz: float = 2.0
    high_hz: float = 300.0
    bands: tuple[Band, ...] = field(init=False)
    _bins: dict[Band, tuple[int, NDArray[np.float32]]] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        bands = third_octave_bands(self.low_hz, self.high_hz)
        object.__setattr__(self, "bands", tuple(band for band in bands if band.high_hz <= self.high_hz))
        object.__setattr__(self, "_bins", {band: self._weights(band) for band in self.bands})

    @property
    def long_bands(self) -> tuple[Band, ...]:
        """Return the bands that are examined over 500 ms."""
        return tuple(band for band in self.bands if band.centre_hz <= LONG_UP_TO_HZ * 1.02)

    @property
    def short_bands(self) -> tuple[Band, ...]:
        """Return the bands that are examined over 100 ms."""
        return self.bands[len(self.long_bands) :]

    @property
    def chunk(self) -> int:
        """Return the number of samples of a whole chunk, margins included."""
        return round((CHUNK_S + 2.0 * MARGIN_S) * self.rate_hz)

    @property
    def hop(self) -> int:
        """Return the number of samples from one chunk to the next: what a chunk's frames cover."""
        return round(CHUNK_S * self.rate_hz)

    @property
    def margin(self) -> int:
        """Return the number of samples of a chunk before and after its frames."""
        return round(MARGIN_S * self.rate_hz)

    def frequency_hz(self) -> NDArray[np.float64]:
        """Return the frequencies of the bins of a chunk's spectrum."""
        return np.asarray(fft.rfftfreq(self.chunk, 1.0 / self.rate_hz))

    def frames(self, spectrum: Spectrum, seconds: float = CHUNK_S) -> BandFrames:
        """Return the levels in the frames that lie wholly within `seconds` after a chunk's margin; `spectrum`: its
        rfft.
        """
        return BandFrames(
            self._levels(spectrum, self.long_bands, LONG_FRAME_S, seconds),
            self._levels(spectrum, self.short_bands, SHORT_FRAME_S, seconds),
        )

    def _levels(self, spectrum: Spectrum, bands: tuple[Band, ...], frame_s: float, seconds: float) -> Levels:
        count = int((seconds + 1e-9) / frame_s)
        samples = round(ENVELOPE_RATE_HZ * (CHUNK_S + 2.0 * MARGIN_S))
        first, per_frame = round(ENVELOPE_RATE_HZ * MARGIN_S), round(ENVELOPE_RATE_HZ * frame_s)
        levels = np.empty((count, len(bands)), dtype=np.float32)
        for column, band in enumerate(bands):
            start, weights = self._bins[band]
            bins = spectrum[start : start + len(weights)] * weights
            envelope = fft.ifft(bins, samples)[first : first + count * per_frame]
            power = envelope.real**2 + envelope.imag**2
            levels[:, column] = power.reshape(count, per_frame).mean(axis=1) * (2.0 * samples / self.chunk) ** 2
        with np.errstate(divide="ignore"):
            return np.asarray(10.0 * np.log10(levels), dtype=np.float32)

    def _weights(self, band: Band) -> tuple[int, NDArray[np.float32]]:
        """Return the index of the band's first bin, and the weights from there on."""
        step = self.rate_hz / self.chunk
        half_edge = 0.5 * EDGE * (band.high_hz - band.low_hz)
        start, stop = int(np.ceil((band.low_hz - half_edge) / step)), int((band.high_hz + half_edge) / step) + 1
        frequency = np.arange(start, stop) * step
        up = np.clip((frequency - band.low_hz) / (2.0 * half_edge) + 0.5, 0.0, 1.0)
        down = np.clip((band.high_hz - frequency) / (2.0 * half_edge) + 0.5, 0.0, 1.0)
        return start, (np.sin(0.5 * np.pi * up) * np.sin(0.5 * np.pi * down)).astype(np.float32)


@dataclass
class Chunker:
    """Cuts a stream (n, channels) into overlapping chunks; zeros stand before its begin and after its end.

    Chunks are float32: 24 bits reach 140 dB below the greatest displacement, and thresholds span 45 dB.
    """

    analysis: BandAnalysis
    channels: int
    _kept: NDArray[np.float32] = field(init=False)

    def __post_init__(self) -> None:
        self._kept = np.zeros((self.analysis.margin, self.channels), dtype=np.float32)

    def push(self, block: NDArray[np.float64]) -> Iterator[NDArray[np.float32]]:
        """Count a block in; the chunks (channels, chunk) that are whole now."""
        self._kept = np.concatenate((self._kept, block.astype(np.float32)))
        while len(self._kept) >= self.analysis.chunk:
            yield np.ascontiguousarray(self._kept[: self.analysis.chunk].T)
            self._kept = self._kept[self.analysis.hop :]

    def finish(self) -> Iterator[tuple[NDArray[np.float32], float]]:
        """Yield the chunks that are left, each with the seconds of signal that its frames may cover."""
        while len(self._kept) > self.analysis.margin:
            seconds = min(CHUNK_S, (len(self._kept) - self.analysis.margin) / self.analysis.rate_hz)
            chunk = np.zeros((self.channels, self.analysis.chunk), dtype=np.float32)
            part = self._kept[: self.analysis.chunk].T
            chunk[:, : part.shape[1]] = part
            yield chunk, seconds
            self._kept = self._kept[self.analysis.hop :]
