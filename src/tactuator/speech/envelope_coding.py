"""Envelopes of spectral bands on carriers, gated by voicing.

    band of speech -> rectify -> mean of a display's sample -> low-pass -> (x voicing gate) -> x carrier -> finger

Filters are causal Butterworth, their states go on between blocks; the sum for each finger is band-limited below 300 Hz
at the end, with linear phase from a file.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.speech.band_codings import band_limit_kernel, live_rate
from tactuator.speech.causal import CausalBank, CausalStream, carrier_sections
from tactuator.speech.coding import place
from tactuator.speech.filters import filter_columns, resample

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


LOWEST_VOICE_HZ = 60.0
POWER_FLOOR = 1e-12
EXPANDED_FROM = 0.03
"""An envelope of so much of full scale, as speech has it, keeps its size when it is expanded."""
TOP_HZ = 290.0
"""What is felt of the carriers and their sidebands is below."""


_GATES = {"always": (1.0, 0.0), "voiced": (0.0, 1.0), "unvoiced": (1.0, -1.0)}
"""What a gate lets through without voicing, and what voicing adds."""


class Modulators:
    """Bands on their carriers at work: speech (n,) at rate_hz to (n / step, groups), each group the sum of its bands.

    block: None, or the length that every block of speech has.
    """

    def __init__(
        self,
        bands: tuple[EnvelopeBand, ...],
        groups: tuple[tuple[str, ...], ...],
        voicing: Voicing,
        rate_hz: int,
        step: int,
        block: int | None = None,
        expansion: float = 1.0,
    ) -> None:
        self._expansion = expansion
        self._bands, self._step, self._rate_hz = bands, step, rate_hz
        self._groups = [groups.index(band.fingers) for band in bands]
        self._ratio = voicing.ratio
        self._gated = any(band.gate != "always" for band in bands)
        self._carriers = _Carriers([band.carrier_hz for band in bands], rate_hz / step)
        self._half = [k for k, band in enumerate(bands) if band.rectifier == "half"]
        self._gains = 10.0 ** (np.array([[band.gain_db] for band in bands]) / 20.0)
        self._open, self._opens = np.array([_GATES[band.gate] for band in bands]).T[:, :, None]
        filters = [_butter(band.order, band.low_hz, band.high_hz, rate_hz) for band in bands]
        smooth = [_butter(band.smooth_order, 0.0, band.smooth_hz, rate_hz / step) for band in bands]
        if self._gated:
            filters += [
                _butter(2, LOWEST_VOICE_HZ, voicing.low_hz, rate_hz),
                _butter(2, voicing.high_hz, None, rate_hz),
            ]
            smooth += [_butter(2, 0.0, voicing.smooth_hz, rate_hz / step)] * 2
        self._filters = CausalBank(filters, rate_hz, block)
        self._smooth = CausalBank(smooth, rate_hz / step, None if block is None else block // step)
        self._rows = len(filters)

    def push(self, block: FloatArray) -> FloatArray:
        """Return a block whose length is a multiple of the step, modulated."""
        filtered = self._filters.push(np.broadcast_to(block, (self._rows, len(block))))
        if self._half:
            filtered[self._half] = np.maximum(filtered[self._half], 0.0)
        envelopes = self._smooth.push(_means(np.abs(filtered, out=filtered), self._step))
        bands = envelopes[: len(self._bands)]
        if self._expansion != 1.0:
            bands = bands * (np.abs(bands) / EXPANDED_FROM) ** (self._expansion - 1.0)
        bands = self._gains * bands
        if self._gated:
            bands *= self._open + self._opens * self._voiced(*envelopes[len(self._bands) :])
        bands *= self._carriers.next(bands.shape[1])
        output = np.zeros((max(self._groups) + 1, bands.shape[1]))
        for band, group in zip(bands, self._groups, strict=True):
            output[group] += band
        return output.T

    def _voiced(self, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return the degree of voicing, sample by sample at the display's rate."""
        low, high = low**2, high**2
        return np.asarray(low / (low + self._ratio**2 * high + POWER_FLOOR))

    def delay_s(self) -> dict[float, float]:
        """Return, by carrier, by how much its envelope follows the sound: band-pass, mean and smoothing."""
        delays: dict[float, float] = {}
        top_hz, mean_s = 0.45 * self._rate_hz, 0.5 * (self._step - 1) / self._rate_hz
        for k, band in enumerate(self._bands):
            middle_hz = float(np.sqrt(max(band.low_hz, 1.0) * min(band.high_hz or top_hz, top_hz)))
            late_s = self._filters.delay_s(k, middle_hz) + mean_s + self._smooth.delay_s(k, 1.0)
            delays[band.carrier_hz] = max(late_s, delays.get(band.carrier_hz, 0.0))
        return delays


def _in_steps(blocks: Iterable[FloatArray], step: int) -> Iterator[FloatArray]:
    """Yield the signal in blocks whose lengths are multiples of `step`; the last is filled up with zeros."""
    rest = np.zeros(0)
    for block in blocks:
        joined = np.concatenate((rest, block)) if rest.size else block
        length = len(joined) // step * step
        rest = joined[length:]
        if length:
            yield joined[:length]
    if rest.size:
        yield np.concatenate((rest, np.zeros(step - rest.size)))


def _means(samples: FloatArray, step: int) -> FloatArray:
    """Return the mean of every `step` samples of rows: the rectified signals at the display's rate."""
    return np.asarray(samples.reshape(len(samples), -1, step) @ np.full(step, 1.0 / step))


def _butter(order: int, low_hz: float, high_hz: float | None, rate_hz: float) -> FloatArray:
    """Return a Butterworth filter; edges beyond half the rate let all through."""
    top = 0.45 * rate_hz
    low, edges = min(low_hz, top), [low_hz, high_hz]
    if high_hz is None or high_hz >= top:
        edges, kind = [low], "highpass"
    elif low == 0.0:
        edges, kind = [high_hz], "lowpass"
    else:
        kind = "bandpass"
    edge = edges if len(edges) == 2 else edges[0]
    return np.asarray(scipy.signal.butter(order, edge, kind, fs=rate_hz, output="sos"))


class _Carriers:
    """Sines that begin at zero, (carriers, n). Whole frequencies and rates repeat every second: one second is kept."""

    def __init__(self, frequencies_hz: Sequence[float], rate_hz: float) -> None:
        self._per_sample = np.array(frequencies_hz)[:, None] / rate_hz
        whole = all(each == int(each) for each in (*frequencies_hz, rate_hz))
        self._second = self._sines(np.arange(int(rate_hz))) if whole else None
        self._at = 0

    def _sines(self, index: NDArray[np.int64]) -> FloatArray:
        return np.asarray(np.sin(2.0 * np.pi * np.mod(index * self._per_sample, 1.0)))

    def next(self, count: int) -> FloatArray:
        start, self._at = self._at, self._at + count
        if self._second is None:
            return self._sines(start + np.arange(count))
        first, length = start % self._second.shape[1], self._second.shape[1]
        if first + count <= length:
            return self._second[:, first : first + count]
        return np.take(self._second, np.arange(first, first + count), axis=1, mode="wrap")


OUR_BANDS = (
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
"""Our own: spectral place on the finger, and within a finger on carriers from kinesthetic to cutaneous."""


@dataclass(frozen=True)
class EnvelopeCoding:
    """Bands, each on its carrier; analysis_hz: least rate of analysis (the next multiple of the display's is taken).

    expansion: exponent of every envelope, 1 to 4; None: none. Expanded envelopes helped to tell vowels apart in quiet
    and phonemes in noise (Fletcher et al. 2024; an exponent is our choice).
    """

    bands: tuple[EnvelopeBand, ...] = OUR_BANDS
    kind: Literal["envelope"] = "envelope"
    name: str = "envelope"
    voicing: Voicing = field(default_factory=Voicing)
    analysis_hz: float = 16000.0
    expansion: float | None = None

    def __post_init__(self) -> None:
        if self.expansion is not None and not 1.0 <= self.expansion <= 4.0:
            raise BadInput(f"{self.expansion:g}", "1 to 4", key="expansion")
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
        rate, step = live_rate(rate_hz, self.analysis_hz)
        speech = resample(blocks, rate_in_hz, rate, 0.42 * min(rate, rate_in_hz))
        kernel = band_limit_kernel((0.0, 0.0), (TOP_HZ, 20.0), rate_hz)
        return filter_columns(map(self._modulators(rate, step).push, _in_steps(speech, step)), kernel)

    def _modulators(self, rate_hz: int, step: int, block: int | None = None) -> Modulators:
        return Modulators(self.bands, self._groups(), self.voicing, rate_hz, step, block, self.expansion or 1.0)

    def live(self, rate_hz: int, block: int) -> CausalStream:
        """Return the coding at work: the file's own filters, but for the last, which leaves 1 % above 320 Hz."""
        rate, step = live_rate(rate_hz, self.analysis_hz)
        modulators, groups = self._modulators(rate, step, block * step), len(self._groups())
        top = CausalBank([carrier_sections(TOP_HZ, rate_hz)] * groups, rate_hz, block)
        delays = {hertz: late_s + top.delay_s(0, hertz) for hertz, late_s in modulators.delay_s().items()}
        return CausalStream(rate, delays, lambda sound: top.push(modulators.push(sound).T).T)


YUAN_2005 = EnvelopeCoding(
    (EnvelopeBand(0.0, 350.0, 50.0, ("thumb",)), EnvelopeBand(3000.0, None, 250.0, ("index",))), name="yuan-2005"
)
"""Yuan (2005): below 350 Hz on 50 Hz, above 3 kHz on 250 Hz; second order, 25 Hz. Fingers and wave are our choice."""

BRATAKOS_2001 = EnvelopeCoding(
    (EnvelopeBand(500.0 / 2.0**0.5, 500.0 * 2.0**0.5, 200.0, ("all",), smooth_hz=100.0),), name="bratakos-2001"
)
"""Bratakos et al. (2001): the octave at 500 Hz, 100 Hz, on 200 Hz. Orders and fingers are our choice."""
