"""Speech band-limited to 300 Hz (the paper's own next step), as it is or split without loss into bands for fingers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Literal

import numpy as np
import scipy

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.perception.curve import FELT_BAND_HZ
from tactuator.speech.causal import CausalBank, CausalStream, band_sections
from tactuator.speech.coding import place
from tactuator.speech.filters import band_kernel, convolve_kernels, filter_bank, resample

ALL_FINGERS = ("all",)
LIVE_RATE_HZ = 16000.0
"""Least rate of the sound that a live coding takes."""
_LIVE_ORDER = 3
"""Of the live bands' prototypes: 9 ms late in the middle of a band 70 Hz wide; a fourth would be 12."""


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


def live_rate(rate_hz: int, least_hz: float = LIVE_RATE_HZ) -> tuple[int, int]:
    """Return the lowest multiple of the display's rate that is not below `least_hz`, and which multiple it is."""
    step = int(np.ceil(least_hz / rate_hz))
    return step * rate_hz, step


def _bank_stream(
    filters: Callable[[int], list[FloatArray]], stated_hz: list[list[float]], rate_hz: int, block: int
) -> CausalStream:
    """Return a bank of filters as a coding at work; stated_hz: where each one's delay is stated."""
    rate, step = live_rate(rate_hz)
    sections = filters(rate)
    bank = CausalBank(sections, rate, block * step)
    delays = {hertz: bank.delay_s(k, hertz) for k, row in enumerate(stated_hz) for hertz in row}
    return CausalStream(rate, delays, lambda sound: bank.push(np.tile(sound, (len(sections), 1)))[:, ::step].T)


@dataclass(frozen=True)
class DirectCoding:
    """The speech signal between low_hz and high_hz, the same on every finger of `fingers` ("all", or names).

    Edges are -6 dB points of a linear-phase filter whose edges are *_transition_hz wide: flat within 0.001 dB from 3
    to 280 Hz, 80 dB down below 1 Hz and from 300 Hz up.
    """

    kind: Literal["direct"] = "direct"
    low_hz: float = FELT_BAND_HZ[0]
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

    def live(self, rate_hz: int, block: int) -> CausalStream:
        """Return the coding at work: the same band, 5 dB down at `high_hz` and 50 dB at 1.26 times that."""
        stated_hz = [hertz for hertz in (50.0, 100.0, 200.0, 250.0) if hertz < self.high_hz]
        return _bank_stream(lambda rate: [band_sections(self.low_hz, self.high_hz, rate)], [stated_hz], rate_hz, block)

    def placement(self, fingers: tuple[str, ...]) -> FloatArray:
        """Return the gain of the one signal on each finger, shape (1, fingers)."""
        return place([self.fingers], fingers)


@dataclass(frozen=True)
class BandsCoding:
    """Bands edges_hz[i]..edges_hz[i + 1] go to the fingers fingers[i] with gains_db[i]; their sum is `direct`.

    Edges are -6 dB points of linear-phase filters: the lowest is low_transition_hz wide, the others transition_hz. The
    inner edges lie where a voice of about 120 Hz has its fundamental below, one of about 200 Hz between.
    """

    kind: Literal["bands"] = "bands"
    edges_hz: tuple[float, ...] = (FELT_BAND_HZ[0], 145.0, 215.0, 290.0)
    low_transition_hz: float = 2.0
    transition_hz: float = 20.0
    fingers: tuple[tuple[str, ...], ...] = (("thumb",), ("index",), ("middle",))
    gains_db: tuple[float, ...] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        count = len(self.edges_hz) - 1
        if count < 1 or len(self.fingers) != count or len(self.gains_db) != count:
            raise BadInput(
                f"bands coding: {len(self.edges_hz)} edges, {len(self.fingers)} fingers, {len(self.gains_db)} gains",
                "two edges or more, and for each band between them a list of fingers and a gain",
            )
        if any(high - low < self.transition_hz for low, high in zip(self.edges_hz, self.edges_hz[1:], strict=False)):
            raise BadInput(f"bands coding: edges {self.edges_hz} Hz", f"ascending, {self.transition_hz:g} Hz apart")

    def signals(self, blocks: Iterable[FloatArray], rate_in_hz: int, rate_hz: int) -> Iterator[FloatArray]:
        """Yield mono blocks (n,) at `rate_in_hz` as blocks (m, bands) at `rate_hz`, in the file's own units."""
        high = (self.edges_hz[-1], self.transition_hz)
        low = (self.edges_hz[0], self.low_transition_hz)
        below = [band_limit_kernel(low, (edge, self.transition_hz), rate_hz) for edge in self.edges_hz[1:]]
        kernels = [below[0], *(upper - lower for lower, upper in pairwise(below))]
        stop_hz = high[0] + 0.5 * high[1]
        return filter_bank(resample(blocks, rate_in_hz, rate_hz, stop_hz), kernels)

    def live(self, rate_hz: int, block: int) -> CausalStream:
        """Return the coding at work: Butterworth bands, -3 dB at their edges, whose skirts overlap."""
        pairs = list(pairwise(self.edges_hz))

        def bands(rate: int) -> list[FloatArray]:
            return [scipy.signal.butter(_LIVE_ORDER, pair, "bandpass", fs=rate, output="sos") for pair in pairs]

        return _bank_stream(bands, [[float(np.sqrt(low * high))] for low, high in pairs], rate_hz, block)

    def placement(self, fingers: tuple[str, ...]) -> FloatArray:
        """Return the gains, shape (bands, fingers)."""
        return place(list(self.fingers), fingers) * (10.0 ** (np.array(self.gains_db) / 20.0))[:, None]
