"""Response by multisine: all frequencies at once, noise and nonlinear distortion told apart.

What differs between two periods is noise; what repeats on lines that were not played is distortion (Pintelon and
Schoukens, System Identification: A Frequency Domain Approach, 2012, chapter 4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, repeat, takewhile

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.measure.frequencies import multisine_lines, sweep_lines
from tactuator.measure.stepped_sine import check_asked
from tactuator.rig.rig import Rig
from tactuator.rig.trace import recut_traces
from tactuator.signals.decibels import from_db, half_width_db
from tactuator.signals.multisine import Multisine, multisine
from tactuator.signals.record import Response


@dataclass(frozen=True, eq=False)
class _Spectra:
    """Peak amplitudes of every line, (periods, lines), and whether anything was limited."""

    lines: ComplexArray
    saturated: bool


def multisine_response(
    rig: Rig,
    frequency_hz: ArrayLike,
    level_db_sl: float,
    rng: np.random.Generator,
    *,
    channels: Sequence[str] | None = None,
    load: str = "none",
    confidence_db: float = 0.25,
    longest_s: float = 20.0,
    settle_s: float = 1.25,
    mains_hz: float | None = 60.0,
    band_hz: tuple[float, float] | None = None,
    exactly: bool = True,
    controller_hash: str = "",
) -> tuple[Response, ...]:
    """Measure the response at `frequency_hz` (m,), each line at `level_db_sl`, one Response for each of `channels`
    (default all).

    Lines stand at odd multiples of one period's frequency, within 2 % of what is asked, 2 Hz off mains and inside
    band_hz (default: below 0.45 of the rate): the shortest period that has them all. Not `exactly`: the nearest lines
    inside the band, for a sweep whose frequencies nobody asked for. After
    settle_s of the same signal two periods are averaged, and more until every line's 95 % half-width is at most
    confidence_db or longest_s are over. The half-width covers noise and distortion. Raises BadInput as `stepped_sine`
    does.
    """
    names = check_asked(rig, frequency_hz, level_db_sl, confidence_db, longest_s, channels)
    frequency = np.sort(np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64)))
    lines = multisine_lines if exactly else sweep_lines
    period, bins = lines(frequency, rig.rate_hz, longest_s, mains_hz, band_hz or (0.0, 0.45 * rig.rate_hz))
    excited = multisine(rig.rate_hz, period, bins, float(from_db(level_db_sl)), rng)
    columns = [rig.channels.index(name) for name in names]
    player = _Player(rig, excited, columns, mains_hz)
    player.play(settle_s, int(longest_s * rig.rate_hz / period), confidence_db)
    rig.rest()
    return tuple(
        player.response(k, name, load, level_db_sl, confidence_db, controller_hash) for k, name in enumerate(names)
    )


class _Player:
    """Plays periods of one multisine and keeps their spectra."""

    def __init__(self, rig: Rig, excited: Multisine, columns: list[int], mains_hz: float | None) -> None:
        self._rig, self._excited, self._columns = rig, excited, columns
        self._wave = excited.one_period()
        self._kept: list[ComplexArray] = []
        self._saturated = np.zeros(len(columns), dtype=bool)
        spacing = excited.rate_hz / excited.period
        lines = np.arange(excited.period // 2 + 1)
        off = np.full(lines.size, np.inf)
        if mains_hz:
            off = np.abs(lines * spacing - mains_hz * np.maximum(np.round(lines * spacing / mains_hz), 1.0))
        self._clear = off > 1.0

    @property
    def periods(self) -> int:
        """Return the number of periods averaged."""
        return len(self._kept)

    def play(self, settle_s: float, most: int, confidence_db: float) -> None:
        """Play the multisine: settle, then period after period, two at least and `most` at most, until every line is
        known so well.
        """
        settling = self._settling(settle_s)
        enough = False
        periods = takewhile(lambda wave: not enough, repeat(self._wave))
        references = map(self._on_columns, chain([settling], periods))
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
            enough = known or self.periods >= max(2, most)

    def _settling(self, settle_s: float) -> FloatArray:
        """Return the end of the period, faded in, so that the next sample is its beginning."""
        count = max(1, round(settle_s * self._rig.rate_hz))
        wave = np.tile(self._wave, -(-count // self._wave.size))[-count:]
        fade = max(1, count // 4)
        gain = np.minimum(1.0, np.arange(count) / fade)
        return np.asarray(wave * (0.5 - 0.5 * np.cos(np.pi * gain)))

    def _on_columns(self, wave: FloatArray) -> FloatArray:
        reference = np.zeros((wave.size, len(self._rig.channels)))
        reference[:, self._columns] = wave[:, None]
        return reference

    def _parts(self, column: int) -> tuple[ComplexArray, FloatArray, FloatArray]:
        """Return the mean amplitude (m,), the variance of that mean by noise, and the power of distortion on a line, at
        the excited lines.
        """
        spectra = np.stack([one[:, column] for one in self._kept])
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
        made = []
        places = np.flatnonzero(usable)
        for line in self._excited.bins:
            # places ascend: the twelve nearest are among the twelve to either side
            middle = int(np.searchsorted(places, line))
            near = np.sort(np.abs(places[max(0, middle - 12) : middle + 12] - line))
            reach = max(0.1 * line, float(near[min(11, near.size - 1)]))
            first, last = np.searchsorted(places, line - reach), np.searchsorted(places, line + reach, side="right")
            made.append(power[places[first:last]].mean())
        return np.array(made)

    def confidence_db(self, column: int) -> FloatArray:
        """Return the 95 % half-widths of the excited lines' magnitudes, dB, (m,)."""
        mean, noise, distortion = self._parts(column)
        # half of each power is along the amplitude, half across it
        half_width = 1.96 * np.sqrt(0.5 * (noise + distortion))
        return half_width_db(mean, half_width)

    def response(
        self, column: int, name: str, load: str, level_db_sl: float, confidence_db: float, controller_hash: str
    ) -> Response:
        """Return the response measured on one channel."""
        mean, noise, distortion = self._parts(column)
        confidence = self.confidence_db(column)
        count = mean.size
        return Response(
            channel=name,
            load=load,
            level_db_sl=level_db_sl,
            method="multisine",
            frequency_hz=self._excited.frequency_hz,
            # phases against the reference's own; a cosine there, a cosine here
            amplitude_v=mean * np.exp(-1j * self._excited.phase_rad),
            reference=self._excited.amplitude.copy(),
            confidence_db=confidence,
            noise_v=np.sqrt(noise * self.periods),
            distortion_v=np.sqrt(distortion),
            saturated=np.full(count, bool(self._saturated[column])),
            reached=confidence <= confidence_db,
            averaged_s=np.full(count, self.periods * self._excited.period / self._excited.rate_hz),
            controller_hash=controller_hash,
        )
