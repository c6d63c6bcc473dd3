"""Envelopes taken from speech and put on carriers, block by block; the states go on between blocks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from tactuator.arrays import FloatArray
from tactuator.speech.coding.envelope_bands import EnvelopeBand, Voicing

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
            self._sections = signal.butter(order, low, "highpass", fs=rate_hz, output="sos")
        elif low == 0.0:
            self._sections = signal.butter(order, high_hz, "lowpass", fs=rate_hz, output="sos")
        else:
            self._sections = signal.butter(order, [low, high_hz], "bandpass", fs=rate_hz, output="sos")
        self._state = np.zeros((len(self._sections), 2))

    def push(self, block: FloatArray) -> FloatArray:
        output, self._state = signal.sosfilt(self._sections, block, zi=self._state)
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
        """Return the samples that come next."""
        start, self._at = self._at, self._at + count
        if self._second is None:
            return self._sine(start + np.arange(count))
        length = len(self._second)
        return np.resize(np.roll(self._second, -(start % length)), count)


class _VoicingMeter:
    """The degree of voicing, sample by sample at the display's rate."""

    def __init__(self, voicing: Voicing, rate_hz: float, step: int) -> None:
        self._ratio, self._step = voicing.ratio, step
        self._bands = (
            _Filter(2, LOWEST_VOICE_HZ, voicing.low_hz, rate_hz),
            _Filter(2, voicing.high_hz, None, rate_hz),
        )
        self._smooth = tuple(_Filter(2, 0.0, voicing.smooth_hz, rate_hz / step) for _ in self._bands)

    def degree(self, block: FloatArray) -> FloatArray:
        low, high = (
            smooth.push(_means(np.abs(band.push(block)), self._step)) ** 2
            for band, smooth in zip(self._bands, self._smooth, strict=True)
        )
        return np.asarray(low / (low + self._ratio**2 * high + POWER_FLOOR))
