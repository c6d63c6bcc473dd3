"""Envelopes of spectral bands on carriers, gated by voicing.

    band of speech -> rectify -> mean of a display's sample -> low-pass -> (x voicing gate) -> x carrier -> finger

Filters are causal Butterworth, their states go on between blocks; the sum for each finger is band-limited below 300 Hz
at the end, with linear phase.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.speech.band_codings import band_limit_kernel
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


def modulated(
    speech: Iterable[FloatArray],
    bands: tuple[EnvelopeBand, ...],
    groups: tuple[tuple[str, ...], ...],
    voicing: Voicing,
    rate_hz: int,
    step: int,
) -> Iterator[FloatArray]:
    """Yield speech (n,) at rate_hz as blocks (n / step, groups) at rate_hz / step: each group the sum of its bands."""
    meter = _VoicingMeter(voicing, rate_hz, step) if any(band.gate != "always" for band in bands) else None
    modulators = [(_Modulator(band, rate_hz, step), groups.index(band.fingers)) for band in bands]
    for block in _in_steps(speech, step):
        degree = np.ones(1) if meter is None else meter.degree(block)
        output = np.zeros((len(block) // step, len(groups)))
        for modulator, group in modulators:
            output[:, group] += modulator.push(block, degree)
        yield output


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
    """Return the mean of every `step` samples: the rectified signal at the display's rate."""
    return np.asarray(samples.reshape(-1, step) @ np.full(step, 1.0 / step))


class _Filter:
    """A Butterworth filter whose state goes on from block to block; edges beyond half the rate let all through."""

    def __init__(self, order: int, low_hz: float, high_hz: float | None, rate_hz: float) -> None:
        top = 0.45 * rate_hz
        low = min(low_hz, top)
        if high_hz is None or high_hz >= top:
            self._sections = scipy.signal.butter(order, low, "highpass", fs=rate_hz, output="sos")
        elif low == 0.0:
            self._sections = scipy.signal.butter(order, high_hz, "lowpass", fs=rate_hz, output="sos")
        else:
            self._sections = scipy.signal.butter(order, [low, high_hz], "bandpass", fs=rate_hz, output="sos")
        self._state = np.zeros((len(self._sections), 2))

    def push(self, block: FloatArray) -> FloatArray:
        output, self._state = scipy.signal.sosfilt(self._sections, block, zi=self._state)
        return np.asarray(output)


class _Modulator:
    """One band: rectified, smoothed, gated, on its carrier."""

    def __init__(self, band: EnvelopeBand, rate_hz: float, step: int) -> None:
        self._band, self._step, self._rate = band, step, rate_hz / step
        self._filter = _Filter(band.order, band.low_hz, band.high_hz, rate_hz)
        self._smooth = _Filter(band.smooth_order, 0.0, band.smooth_hz, self._rate)
        self._gain = 10.0 ** (band.gain_db / 20.0)
        self._carrier = _Carrier(band.carrier_hz, self._rate)

    def push(self, block: FloatArray, degree: FloatArray) -> FloatArray:
        signal_in = self._filter.push(block)
        if self._band.rectifier == "full":
            rectified = np.abs(signal_in, out=signal_in)
        else:
            rectified = np.maximum(signal_in, 0.0, out=signal_in)
        envelope = self._gain * self._smooth.push(_means(rectified, self._step))
        if self._band.gate != "always":
            envelope = envelope * (degree if self._band.gate == "voiced" else 1.0 - degree)
        return np.asarray(envelope * self._carrier.next(len(envelope)))


class _Carrier:
    """A sine that begins at zero. Whole frequencies and rates repeat every second: one second is kept."""

    def __init__(self, frequency_hz: float, rate_hz: float) -> None:
        self._per_sample = frequency_hz / rate_hz
        whole = frequency_hz == int(frequency_hz) and rate_hz == int(rate_hz)
        self._second = self._sine(np.arange(int(rate_hz))) if whole else None
        self._at = 0

    def _sine(self, index: NDArray[np.int64]) -> FloatArray:
        return np.asarray(np.sin(2.0 * np.pi * np.mod(index * self._per_sample, 1.0)))

    def next(self, count: int) -> FloatArray:
        start, self._at = self._at, self._at + count
        if self._second is None:
            return self._sine(start + np.arange(count))
        length = len(self._second)
        return np.resize(np.roll(self._second, -(start % length)), count)


class _VoicingMeter:
    """The degree of voicing, sample by sample at the display's rate."""

    def __init__(self, voicing: Voicing, rate_hz: float, step: int) -> None:
        self._ratio, self._step = voicing.ratio, step
        self._bands = (_Filter(2, LOWEST_VOICE_HZ, voicing.low_hz, rate_hz), _Filter(2, voicing.high_hz, None, rate_hz))
        self._smooth = tuple(_Filter(2, 0.0, voicing.smooth_hz, rate_hz / step) for _ in self._bands)

    def degree(self, block: FloatArray) -> FloatArray:
        low, high = (
            smooth.push(_means(np.abs(band.push(block)), self._step)) ** 2
            for band, smooth in zip(self._bands, self._smooth, strict=True)
        )
        return np.asarray(low / (low + self._ratio**2 * high + POWER_FLOOR))


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
    """Bands, each on its carrier; analysis_hz: least rate of analysis (the next multiple of the display's is taken)."""

    bands: tuple[EnvelopeBand, ...] = OUR_BANDS
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


YUAN_2005 = EnvelopeCoding(
    (EnvelopeBand(0.0, 350.0, 50.0, ("thumb",)), EnvelopeBand(3000.0, None, 250.0, ("index",))), name="yuan-2005"
)
"""Yuan (2005): below 350 Hz on 50 Hz, above 3 kHz on 250 Hz; second order, 25 Hz. Fingers and wave are our choice."""

BRATAKOS_2001 = EnvelopeCoding(
    (EnvelopeBand(500.0 / 2.0**0.5, 500.0 * 2.0**0.5, 200.0, ("all",), smooth_hz=100.0),), name="bratakos-2001"
)
"""Bratakos et al. (2001): the octave at 500 Hz, 100 Hz, on 200 Hz. Orders and fingers are our choice."""
