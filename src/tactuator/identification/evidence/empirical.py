"""The frequency response that a record shows by itself, averaged over bands: where every parametric fit starts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray


@dataclass(frozen=True)
class EmpiricalResponse:
    """Response y/u in bands: frequency (hertz), complex value, its relative standard error; all of shape (m,).

    excitation: the share of the command's power in each band. Measured under feedback and noise it is biased towards
    the inverse of the feedback; it serves to start from, not to report.
    """

    frequency_hz: FloatArray
    value: NDArray[np.complex128]
    relative_error: FloatArray
    coherence: FloatArray
    excitation: FloatArray

    def trusted(self, coherence: float = 0.3, fewest: int = 8) -> EmpiricalResponse:
        """Return the bands of at least that coherence, or the `fewest` most coherent ones."""
        bound = min(coherence, float(np.sort(self.coherence)[-min(fewest, self.coherence.size)]))
        keep = self.coherence >= bound
        return EmpiricalResponse(
            self.frequency_hz[keep],
            self.value[keep],
            self.relative_error[keep],
            self.coherence[keep],
            self.excitation[keep],
        )


def empirical_response(
    command: FloatArray,
    position: FloatArray,
    rate_hz: float,
    *,
    bands_per_decade: int = 20,
    high_hz: float | None = None,
) -> EmpiricalResponse:
    """Return the response in bands even in log frequency from 3 lines above zero up to high_hz (default 0.45 rate), 5
    lines each at least.

    command, position: (n,). One Hann window over the whole record keeps its full resolution; the end-to-end slope is
    taken off first, as a drift would leak into every band.
    """
    count = command.size
    window = np.hanning(count)
    u, y = (np.fft.rfft(window * _levelled(values)) for values in (command, position))
    spacing = rate_hz / count
    top = min(high_hz or 0.45 * rate_hz, 0.45 * rate_hz)
    edges = _edges(3, min(max(int(top / spacing), 12), u.size - 1), bands_per_decade)
    index = edges[:-1]
    suu = np.add.reduceat(np.abs(u) ** 2, edges)[:-1]
    syy = np.add.reduceat(np.abs(y) ** 2, edges)[:-1]
    syu = np.add.reduceat(y * np.conj(u), edges)[:-1]
    lines = np.arange(u.size) * spacing
    centre = np.add.reduceat(np.abs(u) ** 2 * lines, edges)[:-1] / np.maximum(suu, 1e-300)
    concentration = np.add.reduceat(np.abs(u) ** 4, edges)[:-1] / np.maximum(suu, 1e-300) ** 2
    effective = np.maximum(1.0 / np.maximum(concentration, 1e-12) / 1.9, 1.2)
    keep = (suu > 1e-14 * suu.max()) & (np.diff(edges) > 0) & (index > 0)
    coherence = np.clip(np.abs(syu) ** 2 / np.maximum(suu * syy, 1e-300), 1e-6, 1.0 - 1e-9)
    error = np.sqrt((1.0 - coherence) / coherence / (2.0 * effective))
    return EmpiricalResponse(centre[keep], syu[keep] / suu[keep], error[keep], coherence[keep], suu[keep] / suu.sum())


def _levelled(values: FloatArray) -> FloatArray:
    """Take off mean and slope by least squares."""
    time = np.linspace(-1.0, 1.0, values.size)
    centred: FloatArray = values - values.mean()
    return np.asarray(centred - time * float(time @ centred) / float(time @ time))


def _edges(first: int, last: int, bands_per_decade: int) -> NDArray[np.int64]:
    edges = [first]
    growth = 10.0 ** (1.0 / bands_per_decade)
    while edges[-1] < last:
        edges.append(max(edges[-1] + 5, round(edges[-1] * growth)))
    return np.minimum(np.array(edges, dtype=np.int64), last)
