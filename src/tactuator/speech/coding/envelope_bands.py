"""The parameters of an envelope coding: its bands with their carriers, and the voicing that gates them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tactuator.errors import BadInput

Gate = Literal["always", "voiced", "unvoiced"]


@dataclass(frozen=True)
class EnvelopeBand:
    """One band and its carrier.

    low_hz 0 makes the band a low-pass, high_hz None a high-pass; order: of the Butterworth prototype. rectifier: half
    or full wave. smooth_hz, smooth_order: the low-pass behind it. gate: carrier let through always, with voicing, or
    without. gain_db: of the envelope.
    """

    low_hz: float
    high_hz: float | None
    carrier_hz: float
    fingers: tuple[str, ...]
    order: int = 2
    rectifier: Literal["half", "full"] = "full"
    smooth_hz: float = 25.0
    smooth_order: int = 2
    gate: Gate = "always"
    gain_db: float = 0.0

    def __post_init__(self) -> None:
        high = np.inf if self.high_hz is None else self.high_hz
        if not 0.0 <= self.low_hz < high or (self.low_hz == 0.0 and self.high_hz is None):
            raise BadInput(f"envelope band {self.low_hz:g}..{high:g} Hz", "0 <= low < high, one edge at least")
        if not 0.0 < self.carrier_hz <= 280.0:
            raise BadInput(f"envelope carrier {self.carrier_hz:g} Hz", "above 0, 280 at most")
        if not 0.0 < self.smooth_hz <= 200.0 or self.order not in range(1, 9) or self.smooth_order not in range(1, 9):
            raise BadInput(
                f"envelope smoothing {self.smooth_hz:g} Hz, orders {self.order} and {self.smooth_order}",
                "above 0 to 200 Hz, orders 1 to 8",
            )


@dataclass(frozen=True)
class Voicing:
    """Degree of voicing L^2 / (L^2 + ratio^2 H^2), from 0 to 1: L, H are the smoothed rectified signals below low_hz
    (above 60 Hz) and above high_hz; at `ratio` = H/L it is one half.
    """

    low_hz: float = 500.0
    high_hz: float = 2500.0
    smooth_hz: float = 20.0
    ratio: float = 1.0

    def __post_init__(self) -> None:
        if not 60.0 < self.low_hz < self.high_hz < 7000.0 or self.smooth_hz <= 0.0 or self.ratio <= 0.0:
            raise BadInput(
                f"voicing from {self.low_hz:g} and {self.high_hz:g} Hz",
                "60 < low < high < 7000, smoothing and ratio above zero",
            )
