"""Random-phase multisines: all lines at once, one period exactly, with a low crest factor.

Lines left out on purpose (detection lines) show nonlinear distortion: a linear mechanism answers with noise there
(Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2012, chapter 4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput

Bins = NDArray[np.int64]


@dataclass(frozen=True)
class Multisine:
    """A sum of amplitude * cos(2 pi bin k / period + phase) over `period` samples at rate_hz.

    bins: excited lines, multiples of rate_hz/period, shape (m,); odd_detection, even_detection: lines left silent.
    """

    rate_hz: float
    period: int
    bins: Bins
    amplitude: FloatArray
    phase_rad: FloatArray
    odd_detection: Bins
    even_detection: Bins

    @property
    def frequency_hz(self) -> FloatArray:
        """Return the frequencies of the excited lines, hertz, shape (m,)."""
        return np.asarray(self.bins * self.rate_hz / self.period)

    def one_period(self) -> FloatArray:
        """Return one period of the signal, shape (period,)."""
        return _synthesise(self.period, self.bins, self.amplitude, self.phase_rad)

    def samples(self, periods: int) -> FloatArray:
        """Return `periods` periods in a row, shape (periods * period,)."""
        return np.tile(self.one_period(), periods)

    @property
    def crest_factor(self) -> float:
        """Return the peak over root mean square of one period."""
        wave = self.one_period()
        return float(np.max(np.abs(wave)) / np.sqrt(np.mean(wave**2)))


def _synthesise(period: int, bins: Bins, amplitude: FloatArray, phase: FloatArray) -> FloatArray:
    spectrum = np.zeros(period // 2 + 1, dtype=np.complex128)
    spectrum[bins] = 0.5 * period * amplitude * np.exp(1j * phase)
    return np.asarray(np.fft.irfft(spectrum, period))


def place_lines(
    frequency_hz: ArrayLike, rate_hz: float, period: int, *, mains_hz: float | None = 60.0, keep_off_hz: float = 2.0
) -> Bins:
    """Return the odd lines of a period nearest to `frequency_hz` (m,), each used once, `keep_off_hz` off multiples of
    mains.

    Odd lines alone leave every even line free to show even-order distortion. The lowest may be line 1. Raises BadInput
    where no free line is left below rate/2.
    """
    spacing = rate_hz / period
    odd = np.arange(1, period // 2, 2)
    if mains_hz:
        off = np.abs(odd * spacing - mains_hz * np.round(odd * spacing / mains_hz))
        near = (off < keep_off_hz - 1e-9) & (odd * spacing > 0.5 * mains_hz)
        odd = odd[~near]
    chosen: list[int] = []
    for hertz in np.sort(np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))):
        free = odd[~np.isin(odd, chosen)]
        if free.size == 0 or not 0.0 < hertz < rate_hz / 2.0:
            raise BadInput(
                f"no free line for {hertz:g} Hz in a period of {period / rate_hz:g} s; allowed: a longer period"
            )
        chosen.append(int(free[np.argmin(np.abs(free * spacing - hertz))]))
    return np.array(sorted(chosen), dtype=np.int64)


def multisine(
    rate_hz: float,
    period: int,
    bins: ArrayLike,
    amplitude: ArrayLike,
    rng: np.random.Generator,
    *,
    rounds: int = 60,
    detection_band: tuple[int, int] | None = None,
) -> Multisine:
    """Return a multisine with random phases, improved by `rounds` of clipping (Van der Ouderaa et al., 1988).

    bins: lines, (m,); amplitude: peak of each, (m,) or one number. Detection lines are the unexcited odd and even lines
    within detection_band (default: from the lowest to the highest excited line).
    """
    lines = np.asarray(bins, dtype=np.int64)
    if lines.size == 0 or lines.min() < 1 or lines.max() >= period // 2 or np.unique(lines).size != lines.size:
        raise BadInput(f"lines {lines.tolist()} of a period of {period}; allowed: each once, 1 to {period // 2 - 1}")
    peaks = np.broadcast_to(np.asarray(amplitude, dtype=np.float64), lines.shape).copy()
    phase = rng.uniform(0.0, 2.0 * np.pi, lines.size)
    best, best_peak = phase, np.inf
    for _ in range(max(1, rounds)):
        wave = _synthesise(period, lines, peaks, phase)
        peak = float(np.max(np.abs(wave)))
        if peak < best_peak:
            best, best_peak = phase, peak
        clipped = np.clip(wave, -0.85 * peak, 0.85 * peak)
        phase = np.angle(np.fft.rfft(clipped)[lines])
    low, high = detection_band or (int(lines.min()), int(lines.max()))
    silent = np.setdiff1d(np.arange(max(1, low), high + 1), lines)
    return Multisine(rate_hz, period, lines, peaks, best, silent[silent % 2 == 1], silent[silent % 2 == 0])
