"""The paper's own next step: speech, band-limited to 300 Hz, as it is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

from tactuator.arrays import FloatArray
from tactuator.speech.coding.coding import place
from tactuator.speech.coding.filterbank import band_kernel, convolve_kernels, filter_bank
from tactuator.speech.resampling import resample

ALL_FINGERS = ("all",)


@lru_cache(maxsize=8)
def band_limit_kernel(low: tuple[float, float], high: tuple[float, float], rate_hz: float) -> FloatArray:
    """Return a linear-phase band-pass; low and high are (edge, transition) in hertz, -6 dB at the edges, 80 dB beyond.

    A low edge of 0 leaves DC in. It is kept for the next file, and cannot be written to.
    """
    kernel = band_kernel(0.0, *high, rate_hz)
    if low[0] > 0.0:
        below = -band_kernel(0.0, *low, rate_hz)
        below[len(below) // 2] += 1.0
        kernel = convolve_kernels(below, kernel)
    kernel.flags.writeable = False
    return kernel


@dataclass(frozen=True)
class DirectCoding:
    """The speech signal between low_hz and high_hz, the same on every finger of `fingers` ("all", or names).

    Edges are -6 dB points of a linear-phase filter whose edges are *_transition_hz wide: flat within 0.001 dB from 3
    to 280 Hz, 80 dB down below 1 Hz and from 300 Hz up.
    """

    kind: Literal["direct"] = "direct"
    low_hz: float = 2.0
    low_transition_hz: float = 2.0
    high_hz: float = 290.0
    high_transition_hz: float = 20.0
    fingers: tuple[str, ...] = ALL_FINGERS

    def signals(self, blocks: Iterable[FloatArray], rate_in_hz: int, rate_hz: int) -> Iterator[FloatArray]:
        """Yield mono blocks (n,) at `rate_in_hz` as blocks (m, 1) at `rate_hz`, in the file's own units."""
        stop_hz = self.high_hz + 0.5 * self.high_transition_hz
        low, high = (self.low_hz, self.low_transition_hz), (self.high_hz, self.high_transition_hz)
        kernel = band_limit_kernel(low, high, rate_hz)
        return filter_bank(resample(blocks, rate_in_hz, rate_hz, stop_hz), [kernel])

    def placement(self, fingers: tuple[str, ...]) -> FloatArray:
        """Return the gain of the one signal on each finger, shape (1, fingers)."""
        return place([self.fingers], fingers)
