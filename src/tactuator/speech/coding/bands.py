"""Low, middle and high bands of the sub-300 Hz signal, a finger each: what `direct` gives, split without loss."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.speech.coding.coding import place
from tactuator.speech.coding.direct import band_limit_kernel
from tactuator.speech.coding.filterbank import filter_bank
from tactuator.speech.resampling import resample


@dataclass(frozen=True)
class BandsCoding:
    """Bands edges_hz[i]..edges_hz[i + 1] go to the fingers fingers[i] with gains_db[i]; their sum is `direct`.

    Edges are -6 dB points of linear-phase filters: the lowest is low_transition_hz wide, the others transition_hz. The
    inner edges lie where a voice of about 120 Hz has its fundamental below, one of about 200 Hz between.
    """

    kind: Literal["bands"] = "bands"
    edges_hz: tuple[float, ...] = (2.0, 145.0, 215.0, 290.0)
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

    def placement(self, fingers: tuple[str, ...]) -> FloatArray:
        """Return the gains, shape (bands, fingers)."""
        return place(list(self.fingers), fingers) * (10.0 ** (np.array(self.gains_db) / 20.0))[:, None]
