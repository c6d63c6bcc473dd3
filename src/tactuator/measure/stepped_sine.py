"""Stepped sine: one frequency after the other, each until its confidence is reached, all channels at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, repeat

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from tactuator.arrays import ComplexArray
from tactuator.errors import BadInput
from tactuator.measure.frequencies import tones
from tactuator.perception.curve import check_level
from tactuator.rig.rig import Rig
from tactuator.rig.sensing import require_sensors
from tactuator.rig.trace import Trace, recut_traces
from tactuator.signals.decibels import from_db, half_width_db
from tactuator.signals.record import Response
from tactuator.signals.spectra import LockIn, mains_multiples

Progress = Callable[[int, int], None]
SoFar = Callable[[tuple[Response, ...]], None]
_HARMONICS = 3
_FEWEST_BLOCKS = 8


@dataclass(frozen=True)
class _Point:
    """One frequency on every channel: arrays of shape (channels,)."""

    amplitude: ComplexArray
    confidence_db: NDArray[np.float64]
    noise_v: NDArray[np.float64]
    distortion_v: NDArray[np.float64]
    saturated: NDArray[np.bool_]
    averaged_s: float


def stepped_sine(
    rig: Rig,
    frequency_hz: ArrayLike,
    level_db_sl: float,
    *,
    channels: Sequence[str] | None = None,
    load: str = "none",
    confidence_db: float = 0.25,
    longest_s: float = 30.0,
    coverage: float = 0.95,
    mains_hz: float | None = 60.0,
    band_hz: tuple[float, float] | None = None,
    controller_hash: str = "",
    progress: Progress | None = None,
    so_far: SoFar | None = None,
) -> tuple[Response, ...]:
    """Measure the response of the loaded controller and display at `level_db_sl`, one Response each for `channels`
    (default: all).

    frequency_hz (m,): any order; each is played as it is, or within 2 % of it where it has to keep 2 Hz off multiples
    of mains_hz; band_hz: none is played outside (default: below 0.45 of the rate). After settling it is played in
    blocks of whole periods until every channel's half-width at `coverage` is at most confidence_db, or for longest_s.
    A simultaneous statement about m points asks for a coverage of 1 - 0.05/m (Bonferroni). `load`
    only names what touches the display: whoever holds the finger port puts it there. progress is told the number of
    points done and of all, so_far the responses of those done, after each. Raises BadInput above the comfort level, for
    frequencies outside the band or too near to mains, or an unknown channel.
    """
    names = check_asked(rig, frequency_hz, level_db_sl, confidence_db, longest_s, channels)
    frequencies = tones(frequency_hz, mains_hz, band_hz or (0.0, 0.45 * rig.rate_hz))
    columns = [rig.channels.index(name) for name in names]
    points: list[_Point] = []

    def responses() -> tuple[Response, ...]:
        made = (frequencies[: len(points)], points, float(from_db(level_db_sl)), confidence_db)
        return tuple(
            _response(name, load, level_db_sl, controller_hash, column, *made) for column, name in enumerate(names)
        )

    for done, frequency in enumerate(frequencies):
        tone = _Tone(rig, float(frequency), float(from_db(level_db_sl)), columns, mains_hz, coverage)
        points.append(tone.measure(confidence_db, longest_s))
        if progress is not None:
            progress(done + 1, frequencies.size)
        if so_far is not None:
            so_far(responses())
    rig.rest()
    return responses()


def check_asked(
    rig: Rig,
    frequency_hz: ArrayLike,
    level_db_sl: float,
    confidence_db: float,
    longest_s: float,
    channels: Sequence[str] | None,
) -> tuple[str, ...]:
    """Return the channels to measure. Raises BadInput for what cannot be measured or should not be felt."""
    check_level(level_db_sl)
    if not (confidence_db > 0.0 and longest_s > 0.0):
        raise BadInput(f"confidence {confidence_db:g} dB within {longest_s:g} s", "both positive")
    names = tuple(rig.channels if channels is None else channels)
    for name in names:
        if name not in rig.channels:
            raise BadInput(f"channel {name!r} is not there", f"{', '.join(rig.channels)}")
    require_sensors(rig, names)
    frequency = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
    if frequency.size == 0 or not (np.min(frequency) > 0.0 and np.max(frequency) < 0.45 * rig.rate_hz):
        raise BadInput(f"frequencies {frequency.tolist()} Hz", f"above 0, below {0.45 * rig.rate_hz:g} Hz")
    return names


class _Tone:
    """One frequency being played on the measured channels; the others stay silent."""

    def __init__(
        self,
        rig: Rig,
        frequency_hz: float,
        reference: float,
        columns: list[int],
        mains_hz: float | None,
        coverage: float,
    ) -> None:
        self._rig, self._frequency, self._reference, self._columns = rig, frequency_hz, reference, columns
        self._tail = 0.5 * (1.0 - coverage)
        mains = mains_multiples(mains_hz, min(420.0, 0.45 * rig.rate_hz))
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

    def measure(self, confidence_db: float, longest_s: float) -> _Point:
        """Measure at one frequency: settle, then block after block, all in one stream; what was fed ahead is played
        out.
        """
        most = max(_FEWEST_BLOCKS, int(longest_s * self._rig.rate_hz / self._block))
        settling = round(max(0.5, 1.25 / self._frequency) * self._rig.rate_hz)
        blocks: list[ComplexArray] = []
        saturated = np.zeros(len(self._columns), dtype=bool)
        wanted = _FEWEST_BLOCKS
        point: _Point | None = None
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
            found = self._point(np.stack(blocks), saturated)
            worst = float(np.max(found.confidence_db))
            if worst <= confidence_db or len(blocks) >= most:
                point = found
            growth = (worst / confidence_db) ** 2 if np.isfinite(worst) else 4.0
            wanted = int(np.clip(np.ceil(len(blocks) * min(growth, 4.0)), len(blocks) + 1, most))
        assert point is not None  # the stream goes on until there is one
        return point

    def _wave(self, start: int, count: int) -> NDArray[np.float64]:
        angle = 2.0 * np.pi * self._frequency * np.arange(start, start + count) / self._rig.rate_hz
        return np.asarray(self._reference * np.sin(angle))

    def _on_columns(self, wave: NDArray[np.float64]) -> NDArray[np.float64]:
        reference = np.zeros((wave.size, len(self._rig.channels)))
        reference[:, self._columns] = wave[:, None]
        return reference

    def _settling(self, count: int) -> NDArray[np.float64]:
        rise = np.minimum(1.0, np.arange(count) / (0.4 * count))
        return self._on_columns(self._wave(0, count) * (0.5 - 0.5 * np.cos(np.pi * rise)))

    def _blocks(self, start: int, wanted: Callable[[], bool]) -> Iterator[NDArray[np.float64]]:
        while wanted():
            yield self._on_columns(self._wave(start, self._block))
            start += self._block

    def _amplitudes(self, trace: Trace, start: int) -> ComplexArray:
        # the reference is a sine: its own complex amplitude is -i
        amplitudes = 1j * self._lock_in(trace.position_v[:, self._columns], start)
        return amplitudes[: self._harmonics.size]

    def _point(self, blocks: ComplexArray, saturated: NDArray[np.bool_]) -> _Point:
        """Return the point of the mean of blocks, shape (count, harmonics, channels)."""
        count = blocks.shape[0]
        mean = blocks.mean(axis=0)
        variance = np.sum(np.abs(blocks[:, 0] - mean[0]) ** 2, axis=0) / (2.0 * (count - 1))
        half_width = stats.t.isf(self._tail, 2 * (count - 1)) * np.sqrt(variance / count)
        confidence = half_width_db(mean[0], half_width)
        distortion = np.sqrt(np.sum(np.abs(mean[1:]) ** 2, axis=0))
        averaged = count * self._block / self._rig.rate_hz
        return _Point(mean[0], confidence, np.sqrt(2.0 * variance), distortion, saturated.copy(), averaged)


def _response(
    name: str,
    load: str,
    level_db_sl: float,
    controller_hash: str,
    column: int,
    frequencies: NDArray[np.float64],
    points: list[_Point],
    reference: float,
    confidence_db: float,
) -> Response:
    confidence = np.array([point.confidence_db[column] for point in points])
    return Response(
        channel=name,
        load=load,
        level_db_sl=level_db_sl,
        method="stepped-sine",
        frequency_hz=frequencies,
        amplitude_v=np.array([point.amplitude[column] for point in points]),
        reference=np.full(frequencies.size, reference),
        confidence_db=confidence,
        noise_v=np.array([point.noise_v[column] for point in points]),
        distortion_v=np.array([point.distortion_v[column] for point in points]),
        saturated=np.array([point.saturated[column] for point in points]),
        reached=confidence <= confidence_db,
        averaged_s=np.array([point.averaged_s for point in points]),
        controller_hash=controller_hash,
    )
