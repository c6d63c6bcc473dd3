"""The response of a display at a level: frequency by frequency (stepped sine), or all at once (multisine).

A stepped sine plays each frequency until its confidence is reached, all channels at once. Of a multisine, what differs
between two periods is noise; what repeats on lines that were not played is distortion (Pintelon and Schoukens, System
Identification: A Frequency Domain Approach, 2012, chapter 4).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, repeat, takewhile
from operator import attrgetter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.measure.options import MeasurementOptions
from tactuator.perception.curve import check_level
from tactuator.rig.rig import Rig, Trace, recut_traces, require_sensors
from tactuator.runtime.simulation import REFERENCE_MAX
from tactuator.signals.decibels import db, from_db, half_width_db
from tactuator.signals.multisine import Multisine, multisine, multisine_lines, tones
from tactuator.signals.record import Response
from tactuator.signals.spectra import LockIn, mains_multiples, mean_of_blocks, mean_over_frequency, off_mains

Progress = Callable[[int, int], None]
SoFar = Callable[[tuple[Response, ...]], None]
_HARMONICS = 3
_FEWEST_BLOCKS = 8


@dataclass(frozen=True)
class TonePoint:
    """One frequency on every channel that is read: arrays of shape (channels,). half_width: of the amplitude's size."""

    amplitude: ComplexArray
    half_width: NDArray[np.float64]
    confidence_db: NDArray[np.float64]
    noise_v: NDArray[np.float64]
    distortion_v: NDArray[np.float64]
    saturated: NDArray[np.bool_]
    averaged_s: float


def stepped_sine(
    rig: Rig,
    frequency_hz: ArrayLike,
    options: MeasurementOptions,
    *,
    progress: Progress | None = None,
    so_far: SoFar | None = None,
) -> tuple[Response, ...]:
    """Measure the response of the loaded controller and display, one Response for each of the channels asked for.

    frequency_hz (m,): any order; each is played as it is, or within 2 % of it where it has to keep 2 Hz off mains.
    After settling it is played in blocks of whole periods until every channel's confidence is reached, or for
    longest_s. progress is told the number of points done and of all, so_far the responses of those done, after each.
    Raises BadInput above the comfort level, for frequencies outside the band or too near to mains, or an unknown
    channel.
    """
    columns = check_asked(rig, frequency_hz, options)
    frequencies = tones(frequency_hz, options.mains_hz, options.band_hz or (0.0, 0.45 * rig.rate_hz))
    points: list[TonePoint] = []
    for frequency in frequencies:
        points.append(Tone(rig, float(frequency), columns, columns, options).measure())
        if progress is not None:
            progress(len(points), frequencies.size)
        if so_far is not None:
            so_far(_responses(rig, columns, frequencies, points, options))
    rig.rest()
    return _responses(rig, columns, frequencies, points, options)


def check_asked(rig: Rig, frequency_hz: ArrayLike, options: MeasurementOptions) -> list[int]:
    """Return the columns to measure. Raises BadInput for what cannot be measured or should not be felt."""
    check_level(options.level_db_sl)
    check_frequencies(rig, frequency_hz)
    return sensed_columns(rig, options.channels)


def check_frequencies(rig: Rig, frequency_hz: ArrayLike) -> None:
    """Raise BadInput for no frequency at all, or one at which the rig cannot be measured."""
    frequency = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
    if frequency.size == 0 or not (np.min(frequency) > 0.0 and np.max(frequency) < 0.45 * rig.rate_hz):
        raise BadInput(f"frequencies {frequency.tolist()} Hz", f"above 0, below {0.45 * rig.rate_hz:g} Hz")


def sensed_columns(rig: Rig, channels: Sequence[str] | None) -> list[int]:
    """Return the columns of channels (None: all). Raises BadInput for one that is not there, or has no sensor."""
    names = tuple(channels or rig.channels)
    for name in names:
        if name not in rig.channels:
            raise BadInput(f"channel {name!r} is not there", ", ".join(rig.channels))
    require_sensors(rig, names)
    return [rig.channels.index(name) for name in names]


def on_columns(rig: Rig, columns: Sequence[int], wave: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a reference (n, channels) with `wave` (n,) on the columns that are measured; the others stay silent."""
    reference = np.zeros((wave.size, len(rig.channels)))
    reference[:, columns] = wave[:, None]
    return reference


class Tone:
    """One frequency that is played on `driven` columns and read on `columns`; channels that are not driven stay silent.

    doubt_db: of each column that is read, what has to come down to the confidence asked for: its half-width.
    """

    def __init__(
        self,
        rig: Rig,
        frequency_hz: float,
        driven: Sequence[int],
        columns: Sequence[int],
        options: MeasurementOptions,
        doubt_db: Callable[[TonePoint], FloatArray] = attrgetter("confidence_db"),
    ) -> None:
        self._rig, self._frequency, self._driven, self._columns = rig, frequency_hz, driven, columns
        self._options, self._doubt_db = options, doubt_db
        self._reference = float(from_db(options.level_db_sl))
        mains = mains_multiples(options.mains_hz, min(420.0, 0.45 * rig.rate_hz))
        harmonics = frequency_hz * np.arange(1, _HARMONICS + 1)
        harmonics = harmonics[harmonics < 0.45 * rig.rate_hz]
        # what stands at a multiple of mains is hum, whatever it is a harmonic of
        off = np.min(np.abs(harmonics[:, None] - mains), axis=1, initial=np.inf)
        self._harmonics = harmonics[off > 1.0]
        lines = np.concatenate([self._harmonics, mains])
        # two lines come apart in a block of twice the beat between them
        block_s = max(0.25, 2.0 / max(float(off[0]), 1.0) if off.size else 0.25)
        periods = max(1.0, np.ceil(block_s * frequency_hz))
        self._block = round(periods * rig.rate_hz / frequency_hz)
        self._lock_in = LockIn(lines, rig.rate_hz, self._block)

    def measure(self) -> TonePoint:
        """Measure at one frequency: settle, then block after block in one stream; what was fed ahead is played out."""
        confidence_db = self._options.confidence_db
        most = max(_FEWEST_BLOCKS, int(self._options.longest_s * self._rig.rate_hz / self._block))
        settling = round(max(0.5, 1.25 / self._frequency) * self._rig.rate_hz)
        blocks: list[ComplexArray] = []
        saturated = np.zeros(len(self._columns), dtype=bool)
        wanted = _FEWEST_BLOCKS
        point: TonePoint | None = None
        references = chain([self._settling(settling)], self._blocks(settling, lambda: point is None))
        cut = recut_traces(self._rig.stream(references), chain([settling], repeat(self._block)))
        next(cut)
        for trace in cut:
            if point is not None:
                continue
            blocks.append(self._amplitudes(trace, settling + len(blocks) * self._block))
            saturated |= np.any(trace.saturated[:, self._columns], axis=0)
            if len(blocks) < wanted:
                continue
            mean = self._point(np.stack(blocks), saturated)
            worst = float(np.max(self._doubt_db(mean)))
            if worst <= confidence_db or len(blocks) >= most:
                point = mean
            growth = (worst / confidence_db) ** 2 if np.isfinite(worst) else 4.0
            wanted = int(np.clip(np.ceil(len(blocks) * min(growth, 4.0)), len(blocks) + 1, most))
        assert point is not None  # the stream goes on until there is one
        return point

    def _wave(self, start: int, count: int) -> NDArray[np.float64]:
        angle = 2.0 * np.pi * self._frequency * np.arange(start, start + count) / self._rig.rate_hz
        return np.asarray(self._reference * np.sin(angle))

    def _settling(self, count: int) -> NDArray[np.float64]:
        rise = np.minimum(1.0, np.arange(count) / (0.4 * count))
        return on_columns(self._rig, self._driven, self._wave(0, count) * (0.5 - 0.5 * np.cos(np.pi * rise)))

    def _blocks(self, start: int, wanted: Callable[[], bool]) -> Iterator[NDArray[np.float64]]:
        while wanted():
            yield on_columns(self._rig, self._driven, self._wave(start, self._block))
            start += self._block

    def _amplitudes(self, trace: Trace, start: int) -> ComplexArray:
        # the reference is a sine: its own complex amplitude is -i
        amplitudes = 1j * self._lock_in(trace.position_v[:, self._columns], start)
        return amplitudes[: self._harmonics.size]

    def _point(self, blocks: ComplexArray, saturated: NDArray[np.bool_]) -> TonePoint:
        """Return the point of the mean of blocks, shape (count, harmonics, channels)."""
        amplitude, half_width, noise = mean_of_blocks(blocks[:, 0], self._options.coverage)
        distortion = np.sqrt(np.sum(np.abs(blocks[:, 1:].mean(axis=0)) ** 2, axis=0))
        averaged = len(blocks) * self._block / self._rig.rate_hz
        confidence = half_width_db(amplitude, half_width)
        return TonePoint(amplitude, half_width, confidence, noise, distortion, saturated.copy(), averaged)


def _responses(
    rig: Rig,
    columns: Sequence[int],
    frequencies: NDArray[np.float64],
    points: Sequence[TonePoint],
    options: MeasurementOptions,
) -> tuple[Response, ...]:
    done = frequencies[: len(points)]
    amplitude, confidence, noise, distortion, saturated = (
        np.array([getattr(point, name) for point in points]).T
        for name in ("amplitude", "confidence_db", "noise_v", "distortion_v", "saturated")
    )
    return tuple(
        Response(
            channel=rig.channels[column],
            load=options.load,
            level_db_sl=options.level_db_sl,
            method="stepped-sine",
            frequency_hz=done,
            amplitude_v=amplitude[row],
            reference=np.full(done.size, float(from_db(options.level_db_sl))),
            confidence_db=confidence[row],
            noise_v=noise[row],
            distortion_v=distortion[row],
            saturated=saturated[row],
            reached=confidence[row] <= options.confidence_db,
            averaged_s=np.array([point.averaged_s for point in points]),
            controller_hash=options.controller_hash,
        )
        for row, column in enumerate(columns)
    )


SETTLE_S = 1.25


def multisine_response(
    rig: Rig,
    frequency_hz: ArrayLike,
    options: MeasurementOptions,
    rng: np.random.Generator,
    *,
    exactly: bool = True,
    settle_s: float = SETTLE_S,
) -> tuple[Response, ...]:
    """Measure the response at `frequency_hz` (m,), all lines at once, one Response for each of the channels asked for.

    Lines stand at odd multiples of one period's frequency, within 2 % of what is asked, 2 Hz off mains and inside
    the band: the shortest period that has them all. Not `exactly`: the nearest lines inside the band, for a sweep whose
    frequencies nobody asked for. After settle_s of the same signal two periods are averaged, and more until every
    line's 95 % half-width is at most confidence_db or longest_s are over. The half-width covers noise and distortion.
    Raises BadInput as `stepped_sine` does, and for a level at which all lines together pass a reference's full scale.
    """
    columns = check_asked(rig, frequency_hz, options)
    frequency = np.sort(np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64)))
    band_hz = options.band_hz or (0.0, 0.45 * rig.rate_hz)
    period, bins = multisine_lines(frequency, rig.rate_hz, options.longest_s, options.mains_hz, band_hz, exactly)
    excited = multisine(rig.rate_hz, period, bins, float(from_db(options.level_db_sl)), rng)
    beyond_db = float(db(np.max(np.abs(excited.one_period())) / REFERENCE_MAX))
    if beyond_db > 0.0:
        level, most = options.level_db_sl, np.floor(10.0 * (options.level_db_sl - beyond_db)) / 10.0
        asked = f"level (--level) of {level:g} dB SL for {bins.size} frequencies at once"
        raise BadInput(asked, f"up to {most:g} dB SL for so many, or --method stepped")
    return _Player(rig, excited, columns, options).responses(settle_s)


_SWEPT_S, _SWEPT_DB_SL, _CREST_DB = 4.0, 40.0, 9.0


def swept_responses(
    rig: Rig, options: MeasurementOptions, reach_db_sl: Callable[[FloatArray], FloatArray], rng: np.random.Generator
) -> tuple[Response, ...]:
    """Measure at every half hertz of the band at once, off mains, in 9 s: what lies between points.

    reach_db_sl: the greatest level that a tone may have, of frequencies (n,). All lines have 40 dB SL together, or what
    fits into it. The level asked has no part in it: a resonance is as strong at any.
    """
    columns, period = sensed_columns(rig, options.channels), round(_SWEPT_S * rig.rate_hz)
    low, high = options.band_hz or (0.0, 0.45 * rig.rate_hz)
    bins = np.arange(1, period // 2, 2)
    hertz = bins * rig.rate_hz / period
    bins = bins[(low <= hertz) & (hertz <= high) & (off_mains(hertz, options.mains_hz) == hertz)]
    fits_db = -10.0 * np.log10(np.mean(from_db(-reach_db_sl(bins * rig.rate_hz / period)) ** 2)) - _CREST_DB
    together = min(_SWEPT_DB_SL, float(fits_db))
    excited = multisine(rig.rate_hz, period, bins, from_db(together) / np.sqrt(bins.size), rng)
    swept = replace(options, level_db_sl=together, longest_s=2.0 * _SWEPT_S)
    return _Player(rig, excited, columns, swept).responses(SETTLE_S)


_AROUND, _FEWEST_AROUND = 0.1, 12
"""Lines whose power is averaged around an excited one: share of its frequency to either side, and how many at least."""


class _Player:
    """Plays periods of one multisine and keeps their spectra."""

    def __init__(self, rig: Rig, excited: Multisine, columns: Sequence[int], options: MeasurementOptions) -> None:
        self._rig, self._excited, self._columns, self._options = rig, excited, columns, options
        self._wave = excited.one_period()
        self._kept: list[ComplexArray] = []
        self._saturated = np.zeros(len(columns), dtype=bool)
        hertz = np.arange(excited.period // 2 + 1) * excited.rate_hz / excited.period
        self._clear = off_mains(hertz, options.mains_hz) == hertz

    @property
    def periods(self) -> int:
        return len(self._kept)

    def responses(self, settle_s: float) -> tuple[Response, ...]:
        """Play, and return the response of each channel."""
        self.play(settle_s)
        self._rig.rest()
        return tuple(self.response(k) for k in range(len(self._columns)))

    def play(self, settle_s: float) -> None:
        """Play the multisine: settle, then period after period, two at least, until every line is known so well."""
        confidence_db = self._options.confidence_db
        most = max(2, int(self._options.longest_s * self._rig.rate_hz / self._excited.period))
        settling = self._settling(settle_s)
        enough = False
        periods = takewhile(lambda wave: not enough, repeat(self._wave))
        references = (on_columns(self._rig, self._columns, wave) for wave in chain([settling], periods))
        cut = recut_traces(self._rig.stream(references), chain([settling.size], repeat(self._wave.size)))
        next(cut)
        for trace in cut:
            if enough:
                continue  # fed ahead before it was known
            self._kept.append(np.fft.rfft(trace.position_v[:, self._columns], axis=0) * 2.0 / self._wave.size)
            self._saturated |= np.any(trace.saturated[:, self._columns], axis=0)
            known = self.periods > 1 and all(
                float(np.max(self.confidence_db(k))) <= confidence_db for k in range(len(self._columns))
            )
            enough = known or self.periods >= most

    def _settling(self, settle_s: float) -> FloatArray:
        """Return the end of the period, faded in, so that the next sample is its beginning."""
        count = max(1, round(settle_s * self._rig.rate_hz))
        wave = np.tile(self._wave, -(-count // self._wave.size))[-count:]
        fade = max(1, count // 4)
        gain = np.minimum(1.0, np.arange(count) / fade)
        return np.asarray(wave * (0.5 - 0.5 * np.cos(np.pi * gain)))

    def _parts(self, column: int) -> tuple[ComplexArray, FloatArray, FloatArray]:
        """Return mean amplitude (m,), variance of it by noise, and power of distortion on a line, at excited lines."""
        spectra = np.stack([spectra[:, column] for spectra in self._kept])
        mean = spectra.mean(axis=0)
        scatter = np.sum(np.abs(spectra - mean) ** 2, axis=0) / (self.periods - 1)
        silent = self._clear.copy()
        silent[self._excited.bins] = False
        silent[0] = False
        noise = self._around(scatter, self._clear) / self.periods
        repeated = self._around(np.abs(mean) ** 2, silent)
        return mean[self._excited.bins], noise, np.maximum(repeated - noise, 0.0)

    def _around(self, power: FloatArray, usable: NDArray[np.bool_]) -> FloatArray:
        """Return the mean of the usable lines around each excited one."""
        places = np.flatnonzero(usable)
        return mean_over_frequency(power[places], places, self._excited.bins, _AROUND, _FEWEST_AROUND)

    def confidence_db(self, column: int) -> FloatArray:
        """Return the 95 % half-widths of the excited lines' magnitudes, dB, (m,)."""
        mean, noise, distortion = self._parts(column)
        # half of each power is along the amplitude, half across it
        half_width = 1.96 * np.sqrt(0.5 * (noise + distortion))
        return half_width_db(mean, half_width)

    def response(self, column: int) -> Response:
        """Return the response measured on one channel."""
        options = self._options
        mean, noise, distortion = self._parts(column)
        confidence = self.confidence_db(column)
        count = mean.size
        return Response(
            channel=self._rig.channels[self._columns[column]],
            load=options.load,
            level_db_sl=options.level_db_sl,
            method="multisine",
            frequency_hz=self._excited.frequency_hz,
            # phases against the reference's own; a cosine there, a cosine here
            amplitude_v=mean * np.exp(-1j * self._excited.phase_rad),
            reference=self._excited.amplitude.copy(),
            confidence_db=confidence,
            noise_v=np.sqrt(noise * self.periods),
            distortion_v=np.sqrt(distortion),
            saturated=np.full(count, bool(self._saturated[column])),
            reached=confidence <= options.confidence_db,
            averaged_s=np.full(count, self.periods * self._excited.period / self._excited.rate_hz),
            controller_hash=options.controller_hash,
        )
