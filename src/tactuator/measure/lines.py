"""How amplitudes at frequencies are measured, always: excite, settle, record block after block, estimate, until enough
is known.

Of a tone, what differs between blocks is noise. Of a multisine, what differs between periods is, and what repeats on
lines that were not played is distortion (Pintelon and Schoukens, System Identification: A Frequency Domain Approach,
2012, chapter 4).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, repeat
from operator import attrgetter
from typing import Protocol

import numpy as np
import scipy
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.measure.options import MeasurementOptions
from tactuator.rig.rig import Plays, Trace, recut_traces
from tactuator.signals.decibels import half_width_db
from tactuator.signals.multisine import Multisine
from tactuator.signals.spectra import LockIn, mains_multiples, mean_of_blocks, mean_over_frequency, off_mains

Flags = NDArray[np.bool_]
Play = Callable[[Iterable[FloatArray]], Iterator[Trace]]
"""What plays blocks (n,) of a wave, one after another without a gap, and yields the traces."""
Watch = Callable[[Iterator[Trace]], Iterator[Trace]]


@dataclass(frozen=True, eq=False)
class Lines:
    """Amplitudes at frequency_hz (m,) on every channel that is read, (channels, m).

    reference: peak of what was played, (m,); amplitude: complex, its phase against that; half_width: of its size;
    noise_v, distortion_v: peak volts of what does not repeat, and of what repeats and is not linear; averaged_s: (m,).
    """

    frequency_hz: FloatArray
    reference: FloatArray
    averaged_s: FloatArray
    amplitude: ComplexArray
    half_width: FloatArray
    noise_v: FloatArray
    distortion_v: FloatArray
    saturated: Flags

    @property
    def confidence_db(self) -> FloatArray:
        """Return the half-widths in dB, (channels, m)."""
        return half_width_db(self.amplitude, self.half_width)


class Excitation(Protocol):
    """A wave that repeats, and the estimate of what answers it.

    block, settling: samples; fewest: blocks for an estimate; growth: greatest factor in blocks from one estimate to the
    next, since looking after every block would stop where chance makes the scatter small.
    """

    block: int
    settling: int
    fewest: int
    growth: float

    def wave(self, start: int, count: int) -> FloatArray:
        """Return the samples from `start` on, (count,); the first block begins at `settling`."""
        ...

    def amplitudes(self, position_v: FloatArray, start: int) -> ComplexArray:
        """Return the complex amplitudes of a block (block, channels) that begins at `start`: (lines, channels)."""
        ...

    def lines(self, blocks: ComplexArray, saturated: Flags, coverage: float) -> Lines:
        """Return the estimate of the amplitudes of blocks, (count, lines, channels), with half-widths at `coverage`;
        saturated: channels on which a limit was reached, (channels,).
        """
        ...


def measure_lines(
    play: Play,
    rate_hz: float,
    columns: Sequence[int],
    excitation: Excitation,
    options: MeasurementOptions,
    doubt_db: Callable[[Lines], FloatArray] = attrgetter("confidence_db"),
) -> Lines:
    """Excite, settle, then record block after block in one stream until doubt_db of every line is at most
    confidence_db, or longest_s are over; return the estimate on `columns`.
    """
    settling, block = excitation.settling, excitation.block
    most = max(excitation.fewest, int(options.longest_s * rate_hz / block))
    wanted = excitation.fewest
    blocks: list[ComplexArray] = []
    saturated = np.zeros(len(columns), dtype=bool)
    lines: Lines | None = None

    def waves() -> Iterator[FloatArray]:
        # share of the settling over which the wave rises: what the rise excites has three times that to die away
        rise = np.minimum(1.0, np.arange(settling) / (0.25 * settling))
        yield excitation.wave(0, settling) * (0.5 - 0.5 * np.cos(np.pi * rise))
        start = settling
        while lines is None:
            yield excitation.wave(start, block)
            start += block

    traces = recut_traces(play(waves()), chain([settling], repeat(block)))
    next(traces)
    for trace in traces:
        if lines is not None:
            continue  # fed ahead before enough was known
        blocks.append(excitation.amplitudes(trace.position_v[:, columns], settling + len(blocks) * block))
        saturated |= np.any(trace.saturated[:, columns], axis=0)
        if len(blocks) < wanted:
            continue
        found = excitation.lines(np.stack(blocks), saturated, options.coverage)
        worst = float(np.max(doubt_db(found)))
        if worst <= options.confidence_db or len(blocks) >= most:
            lines = found
        growth = min(excitation.growth, (worst / options.confidence_db) ** 2)
        wanted = int(np.clip(np.ceil(len(blocks) * growth), len(blocks) + 1, most))
    assert lines is not None  # the stream goes on until there are some
    return lines


def reference_on(rig: Plays, columns: Sequence[int], watch: Watch = iter) -> Play:
    """Return what plays a wave as the reference of these columns; the others stay silent. watch: the traces pass it."""

    def references(waves: Iterable[FloatArray]) -> Iterator[FloatArray]:
        for wave in waves:
            reference = np.zeros((wave.size, len(rig.channels)))
            reference[:, columns] = wave[:, None]
            yield reference

    return lambda waves: watch(rig.stream(references(waves)))


_SETTLE_S, _SETTLE_PERIODS, _BLOCK_S = 0.5, 1.25, 0.25
"""A loop settles in half a second, a low tone in little more than a period; a block lasts so long at least."""


class Tone:
    """A sinusoid of `peak` at one frequency, and the lock-in that reads it beside its harmonics and hum."""

    # blocks for a half-width: Student's t of 14 degrees of freedom is within a tenth of that of any number
    fewest, growth = 8, 4.0

    def __init__(self, frequency_hz: float, peak: float, rate_hz: float, mains_hz: float | None) -> None:
        self._frequency_hz, self._peak, self._rate_hz = frequency_hz, peak, rate_hz
        # multiples of mains up to here are kept out of a tone: the seventh of 60 Hz, above the band
        mains = mains_multiples(mains_hz, min(420.0, 0.45 * rate_hz))
        # of a tone, the fundamental among them: friction shows in the third
        harmonics = frequency_hz * np.arange(1, 4)
        harmonics = harmonics[harmonics < 0.45 * rate_hz]
        # what is at a multiple of mains is hum, whatever it is a harmonic of
        off = np.min(np.abs(harmonics[:, None] - mains), axis=1, initial=np.inf)
        harmonics = harmonics[off > 1.0]
        self._harmonics = harmonics.size
        # two lines come apart in a block of twice the beat between them
        block_s = max(_BLOCK_S, 2.0 / max(float(off[0]), 1.0))
        self.block = round(np.ceil(block_s * frequency_hz) * rate_hz / frequency_hz)
        self.settling = round(max(_SETTLE_S, _SETTLE_PERIODS / frequency_hz) * rate_hz)
        self._lock_in = LockIn(np.concatenate([harmonics, mains]), rate_hz, self.block)

    def wave(self, start: int, count: int) -> FloatArray:
        """Return samples of a sine."""
        angle = 2.0 * np.pi * self._frequency_hz * np.arange(start, start + count) / self._rate_hz
        return np.asarray(self._peak * np.sin(angle))

    def amplitudes(self, position_v: FloatArray, start: int) -> ComplexArray:
        """Return the amplitudes of the tone and its harmonics; that of the sine itself is -i."""
        return 1j * self._lock_in(position_v, start)[: self._harmonics]

    def lines(self, blocks: ComplexArray, saturated: Flags, coverage: float) -> Lines:
        """Return the one line: the mean over blocks, which differ by noise."""
        amplitude, half_width, noise = mean_of_blocks(blocks[:, 0], coverage)
        distortion = np.sqrt(np.sum(np.abs(blocks[:, 1:].mean(axis=0)) ** 2, axis=0))
        frequency, reference = np.array([self._frequency_hz]), np.array([self._peak])
        averaged_s = np.array([len(blocks) * self.block / self._rate_hz])
        return Lines(
            frequency, reference, averaged_s, amplitude[:, None], half_width[:, None], noise[:, None],
            distortion[:, None], saturated[:, None].copy(),
        )  # fmt: skip


_AROUND, _FEWEST_AROUND = 0.1, 12
"""Lines whose power is averaged around an excited one: share of its frequency to either side, and how many at least."""
SETTLE_S = 1.25
"""Settling of a multisine: half a period of the lowest frequency of the usual band."""


class Periodic:
    """A multisine, of which each block is a period; lines that were not played show distortion."""

    fewest, growth = 2, 1.0  # a period is long: no more of them than it takes

    def __init__(self, excited: Multisine, mains_hz: float | None, settle_s: float) -> None:
        self._excited, self._wave = excited, excited.one_period()
        self.block, self.settling = excited.period, max(1, round(settle_s * excited.rate_hz))
        hertz = np.arange(excited.period // 2 + 1) * excited.rate_hz / excited.period
        self._clear = off_mains(hertz, mains_hz) == hertz
        self._silent = self._clear.copy()
        self._silent[0] = self._silent[excited.bins] = False

    def wave(self, start: int, count: int) -> FloatArray:
        """Return samples of the period, which begins where the settling ends."""
        return self._wave[np.arange(start - self.settling, start - self.settling + count) % self.block]

    def amplitudes(self, position_v: FloatArray, start: int) -> ComplexArray:
        """Return the amplitudes of every line of the period."""
        return np.asarray(np.fft.rfft(position_v, axis=0) * 2.0 / self.block)

    def lines(self, blocks: ComplexArray, saturated: Flags, coverage: float) -> Lines:
        """Return the excited lines; the half-width covers noise, and the distortion that the silent lines show."""
        excited, count = self._excited, len(blocks)
        mean, _, noise = mean_of_blocks(blocks)
        noise_power = self._around(noise.T**2, self._clear) / count
        distortion = np.maximum(self._around(np.abs(mean.T) ** 2, self._silent) - noise_power, 0.0)
        # half of each power is along the amplitude, half across it
        half_width = scipy.stats.norm.isf(0.5 * (1.0 - coverage)) * np.sqrt(0.5 * (noise_power + distortion))
        # a cosine in the reference is a cosine in the amplitude
        amplitude = mean.T[:, excited.bins] * np.exp(-1j * excited.phase_rad)
        averaged_s = np.full(excited.bins.size, count * self.block / excited.rate_hz)
        return Lines(
            excited.frequency_hz, excited.amplitude.copy(), averaged_s, amplitude, half_width,
            np.sqrt(noise_power * count), np.sqrt(distortion), np.repeat(saturated[:, None], excited.bins.size, axis=1),
        )  # fmt: skip

    def _around(self, power: FloatArray, usable: NDArray[np.bool_]) -> FloatArray:
        """Return the means of power (channels, lines) over the usable lines around each excited one."""
        places = np.flatnonzero(usable)
        return mean_over_frequency(power[:, places], places, self._excited.bins, _AROUND, _FEWEST_AROUND)
