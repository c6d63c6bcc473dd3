"""Envelopes of spectral bands on carriers, gated by voicing.

    band of speech -> rectify -> mean of a display's sample -> low-pass -> (x voicing gate) -> x carrier -> finger

Filters are causal Butterworth; the sum for each finger is band-limited below 300 Hz at the end, with linear phase.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.speech.coding.coding import place
from tactuator.speech.coding.direct import band_limit_kernel
from tactuator.speech.coding.envelope_bands import EnvelopeBand, Voicing
from tactuator.speech.coding.filterbank import filter_columns
from tactuator.speech.coding.modulation import modulated
from tactuator.speech.resampling import resample


@dataclass(frozen=True)
class EnvelopeCoding:
    """Bands, each on its carrier; analysis_hz: least rate of analysis (the next multiple of the display's is taken)."""

    bands: tuple[EnvelopeBand, ...]
    kind: Literal["envelope"] = "envelope"
    name: str = "envelope"
    voicing: Voicing = field(default_factory=Voicing)
    analysis_hz: float = 16000.0

    def __post_init__(self) -> None:
        if not self.bands:
            raise BadInput("envelope coding: no bands", "one or more")
        if not 1e3 <= self.analysis_hz <= 192e3:
            raise BadInput(f"envelope coding: analysis_hz is {self.analysis_hz:g}", "1000 to 192000 Hz")

    def placement(self, fingers: tuple[str, ...]) -> FloatArray:
        """Return ones and zeros, shape (signals, fingers): bands with the same fingers are one signal."""
        return place(list(self._groups()), fingers)

    def _groups(self) -> tuple[tuple[str, ...], ...]:
        return tuple(dict.fromkeys(band.fingers for band in self.bands))

    def signals(self, blocks: Iterable[FloatArray], rate_in_hz: int, rate_hz: int) -> Iterator[FloatArray]:
        """Yield mono blocks (n,) at `rate_in_hz` as blocks (m, signals) at `rate_hz`."""
        step = int(np.ceil(self.analysis_hz / rate_hz))
        rate = step * rate_hz
        speech = resample(blocks, rate_in_hz, rate, 0.42 * min(rate, rate_in_hz))
        kernel = band_limit_kernel((0.0, 0.0), (290.0, 20.0), rate_hz)
        return filter_columns(modulated(speech, self.bands, self._groups(), self.voicing, rate, step), kernel)


DEFAULT = EnvelopeCoding(
    (
        EnvelopeBand(100.0, 300.0, 10.0, ("thumb",), smooth_hz=4.0, gate="voiced", gain_db=6.0),
        EnvelopeBand(300.0, 550.0, 50.0, ("thumb",)),
        EnvelopeBand(550.0, 800.0, 250.0, ("thumb",)),
        EnvelopeBand(800.0, 1100.0, 10.0, ("index",), smooth_hz=4.0, gate="voiced", gain_db=6.0),
        EnvelopeBand(1100.0, 1500.0, 50.0, ("index",), gain_db=6.0),
        EnvelopeBand(1500.0, 2100.0, 250.0, ("index",), gain_db=6.0),
        EnvelopeBand(2100.0, 2900.0, 10.0, ("middle",), smooth_hz=4.0, gate="voiced", gain_db=12.0),
        EnvelopeBand(2900.0, 4000.0, 50.0, ("middle",), gate="unvoiced", gain_db=12.0),
        EnvelopeBand(4000.0, 6500.0, 250.0, ("middle",), gate="unvoiced", gain_db=12.0),
    )
)
"""Our own: spectral place on the finger, and within a finger on carriers from kinesthetic to cutaneous."""

YUAN_2005 = EnvelopeCoding(
    (
        EnvelopeBand(0.0, 350.0, 50.0, ("thumb",)),
        EnvelopeBand(3000.0, None, 250.0, ("index",)),
    ),
    name="yuan-2005",
)
"""Yuan (2005): below 350 Hz on 50 Hz, above 3 kHz on 250 Hz; second order, 25 Hz. Fingers and wave are our choice."""

BRATAKOS_2001 = EnvelopeCoding(
    (EnvelopeBand(500.0 / 2.0**0.5, 500.0 * 2.0**0.5, 200.0, ("all",), smooth_hz=100.0),),
    name="bratakos-2001",
)
"""Bratakos et al. (2001): the octave at 500 Hz, 100 Hz, on 200 Hz. Orders and fingers are our choice."""

PRESETS = {coding.name: coding for coding in (DEFAULT, YUAN_2005, BRATAKOS_2001)}
