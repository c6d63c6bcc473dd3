"""Response by multisine: all frequencies at once, noise and nonlinear distortion told apart.

What differs between two periods is noise; what repeats on lines that were not played is distortion (Pintelon and
Schoukens, System Identification: A Frequency Domain Approach, 2012, chapter 4).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, repeat, takewhile

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.measure.frequencies import multisine_lines
from tactuator.measure.options import MeasurementOptions
from tactuator.measure.stepped_sine import check_asked, on_columns
from tactuator.rig.rig import Rig, recut_traces
from tactuator.signals.decibels import from_db, half_width_db
from tactuator.signals.multisine import Multisine, multisine
from tactuator.signals.record import Response

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
    Raises BadInput as `stepped_sine` does.
    """
    columns = check_asked(rig, frequency_hz, options)
    frequency = np.sort(np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64)))
    band_hz = options.band_hz or (0.0, 0.45 * rig.rate_hz)
    period, bins = multisine_lines(frequency, rig.rate_hz, options.longest_s, options.mains_hz, band_hz, exactly)
    excited = multisine(rig.rate_hz, period, bins, float(from_db(options.level_db_sl)), rng)
    player = _Player(rig, excited, columns, options)
    player.play(settle_s)
    rig.rest()
    return tuple(player.response(k) for k in range(len(columns)))


class _Player:
    """Plays periods of one multisine and keeps their spectra."""

    def __init__(self, rig: Rig, excited: Multisine, columns: Sequence[int], options: MeasurementOptions) -> None:
        self._rig, self._excited, self._columns, self._options = rig, excited, columns, options
        self._wave = excited.one_period()
        self._kept: list[ComplexArray] = []
        self._saturated = np.zeros(len(columns), dtype=bool)
        spacing = excited.rate_hz / excited.period
        lines = np.arange(excited.period // 2 + 1)
        off = np.full(lines.size, np.inf)
        if options.mains_hz:
            nearest = options.mains_hz * np.maximum(np.round(lines * spacing / options.mains_hz), 1.0)
            off = np.abs(lines * spacing - nearest)
        self._clear = off > 1.0

    @property
    def periods(self) -> int:
        """Return the number of periods averaged."""
        return len(self._kept)

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
        """Return the mean amplitude (m,), the variance of that mean by noise, and the power of distortion on a line, at
        the excited lines.
        """
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
        """Return the mean of the usable lines around each excited one: 12 at least, a tenth of the frequency to each
        side.
        """
        means = []
        places = np.flatnonzero(usable)
        for line in self._excited.bins:
            # places ascend: the twelve nearest are among the twelve to either side
            middle = int(np.searchsorted(places, line))
            near = np.sort(np.abs(places[max(0, middle - 12) : middle + 12] - line))
            reach = max(0.1 * line, float(near[min(11, near.size - 1)]))
            first, last = np.searchsorted(places, line - reach), np.searchsorted(places, line + reach, side="right")
            means.append(power[places[first:last]].mean())
        return np.array(means)

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
