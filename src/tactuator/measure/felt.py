"""The felt level of a reference beside the level asked, both in dB SL, in third-octave bands over time.

The displacement at the finger is weighted by the inverse threshold curve with zero phase; the display's own delay and
phase, those of the designed H without load, are taken out, so that levels of the same moments are compared.

A chunk is transformed once; each band's bins, weighted and moved down to zero frequency, give the band's complex
envelope at a low rate. Its mean square over a frame is twice the band's power there: the level of the sinusoid of equal
power, 10 log10 of the mean square envelope. Bands up to 40 Hz are looked at over 500 ms, those above over 100 ms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import chain
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from tactuator.errors import BadInput
from tactuator.measure.error import ChannelPrediction
from tactuator.model.controller import Controller
from tactuator.perception.curve import FELT_BAND_HZ
from tactuator.plain import brief
from tactuator.rig.rig import Rig, with_felt
from tactuator.signals.decibels import db
from tactuator.signals.excitation import raised_ends
from tactuator.signals.spectra import Band, SlidingWindow, third_octave_bands

LONG_FRAME_S, SHORT_FRAME_S, LONG_UP_TO_HZ = 0.5, 0.1, 40.0
"""Seconds of a frame in bands up to 40 Hz and above it: the first holds a period of 2 Hz."""
EDGE = 0.1
"""Width of a band's raised-cosine edges, of its bandwidth; the squares of neighbours add up to one."""

CHUNK_S, MARGIN_S = 12.0, 2.0
"""Seconds of a stream that are transformed at once, and before and after them: a band 0.46 Hz wide rings for 2 s."""
ENVELOPE_RATE_HZ = 160.0
"""More than twice the width of the widest band, of whose envelope the square is taken."""
ENVELOPE = round(ENVELOPE_RATE_HZ * (CHUNK_S + 2.0 * MARGIN_S))
"""Samples of a chunk's envelope."""


Spectrum = NDArray[np.complex64] | NDArray[np.complex128]
Levels = NDArray[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class BandFrames:
    """Levels of some time. long_db: (..., frames of 0.5 s, bands to 40 Hz); short_db: (..., of 0.1 s, above)."""

    long_db: Levels
    short_db: Levels


@dataclass(frozen=True)
class BandAnalysis:
    """Third-octave bands from 2 to 300 Hz at a sampling rate of rate_hz."""

    rate_hz: float
    bands: tuple[Band, ...] = field(init=False)
    _bins: dict[Band, tuple[int, NDArray[np.float32]]] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        bands = third_octave_bands(*FELT_BAND_HZ)
        object.__setattr__(self, "bands", tuple(band for band in bands if band.high_hz <= FELT_BAND_HZ[1]))
        object.__setattr__(self, "_bins", {band: self._weights(band) for band in self.bands})

    @property
    def long_bands(self) -> tuple[Band, ...]:
        """Return the bands that are examined over 500 ms."""
        return tuple(band for band in self.bands if band.centre_hz <= LONG_UP_TO_HZ * 1.02)

    @property
    def short_bands(self) -> tuple[Band, ...]:
        """Return the bands that are examined over 100 ms."""
        return self.bands[len(self.long_bands) :]

    @property
    def chunk(self) -> int:
        """Return the number of samples of a whole chunk, margins included."""
        return round((CHUNK_S + 2.0 * MARGIN_S) * self.rate_hz)

    @property
    def margin(self) -> int:
        """Return the number of samples of a chunk before and after its frames."""
        return round(MARGIN_S * self.rate_hz)

    def window(self, signals: int) -> SlidingWindow:
        """Return the window that cuts a stream of so many signals into chunks, float32: 24 bits reach 140 dB below the
        greatest displacement.
        """
        return SlidingWindow(signals, self.chunk, round(CHUNK_S * self.rate_hz), self.margin, np.float32)

    def frames(self, spectra: Spectrum, seconds: float = CHUNK_S) -> BandFrames:
        """Return the levels in the frames that lie wholly within `seconds` after a chunk's margin; `spectra`: its rfft,
        (..., bins). Four signals that go together take little longer than one.
        """
        padded = np.zeros((len(self.bands), *spectra.shape[:-1], ENVELOPE), dtype=spectra.dtype)
        for row, band in zip(padded, self.bands, strict=True):
            start, weights = self._bins[band]
            row[..., : len(weights)] = spectra[..., start : start + len(weights)] * weights
        envelope = scipy.fft.ifft(padded) * (2.0 * ENVELOPE / self.chunk)
        power = np.moveaxis(envelope.real**2 + envelope.imag**2, 0, -1)[..., round(ENVELOPE_RATE_HZ * MARGIN_S) :, :]
        long = len(self.long_bands)
        return BandFrames(
            _frame_levels(power[..., :long], LONG_FRAME_S, seconds),
            _frame_levels(power[..., long:], SHORT_FRAME_S, seconds),
        )

    def _weights(self, band: Band) -> tuple[int, NDArray[np.float32]]:
        step = self.rate_hz / self.chunk
        half_edge = 0.5 * EDGE * (band.high_hz - band.low_hz)
        start, stop = int(np.ceil((band.low_hz - half_edge) / step)), int((band.high_hz + half_edge) / step) + 1
        frequency = np.arange(start, stop) * step
        up = np.clip((frequency - band.low_hz) / (2.0 * half_edge) + 0.5, 0.0, 1.0)
        down = np.clip((band.high_hz - frequency) / (2.0 * half_edge) + 0.5, 0.0, 1.0)
        return start, (np.sin(0.5 * np.pi * up) * np.sin(0.5 * np.pi * down)).astype(np.float32)


def _frame_levels(power: Levels, frame_s: float, seconds: float) -> Levels:
    """Return the levels of the whole frames within `seconds`, (..., frames, bands), of power (..., samples, bands)."""
    count, samples = int((seconds + 1e-9) / frame_s), round(ENVELOPE_RATE_HZ * frame_s)
    *signals, _, bands = power.shape
    means = power[..., : count * samples, :].reshape(*signals, count, samples, bands).mean(axis=-2)
    with np.errstate(divide="ignore"):
        return np.asarray(10.0 * np.log10(means))


Sink = Callable[[NDArray[np.float64]], None]

HEARD_DB_SL = 10.0
"""Only bands asked for at this level or above are compared: below, friction and noise are what there is."""


@dataclass(frozen=True, eq=False)
class FingerFelt:
    """One finger's levels, dB SL. *_long: (frames of 0.5 s, bands to 40 Hz); *_short: (frames of 0.1 s, bands above).

    asked_db_sl, felt_db_sl: over the whole, one value a band, at centre_hz.
    """

    finger: str
    centre_hz: Levels
    asked_long: Levels
    felt_long: Levels
    asked_short: Levels
    felt_short: Levels
    asked_db_sl: Levels
    felt_db_sl: Levels

    __repr__ = brief

    @property
    def difference_db(self) -> Levels:
        """Return the level error over the whole, for every band; NaN where less than 10 dB SL was asked."""
        return np.where(self.asked_db_sl >= HEARD_DB_SL, self.felt_db_sl - self.asked_db_sl, np.nan)

    @property
    def rms_db(self) -> float:
        """Return the root mean square of `difference_db` over the bands that count; NaN if none does."""
        counted = self.difference_db[np.isfinite(self.difference_db)]
        return float(np.sqrt(np.mean(counted**2))) if counted.size else float("nan")


@dataclass(frozen=True, eq=False)
class FeltReport:
    """Every finger's comparison. peak_db_sl: the greatest sample of the reference."""

    fingers: tuple[FingerFelt, ...]
    peak_db_sl: float

    __repr__ = brief

    @property
    def worst_rms_db(self) -> float:
        """Return the greatest of the fingers' `rms_db`; NaN if no finger has one."""
        values = [finger.rms_db for finger in self.fingers if np.isfinite(finger.rms_db)]
        return max(values) if values else float("nan")

    def figures(self) -> dict[str, dict[str, float | int]]:
        """Return, by finger, the rms over the whole, and the median and 95th percentile of the frames' rms."""
        return {finger.finger: _figures(finger) for finger in self.fingers}


_analysis = lru_cache(maxsize=2)(BandAnalysis)


@lru_cache(maxsize=2)
def _weights(controller: Controller) -> NDArray[np.complex64]:
    """Return what makes each channel's displacement felt amplitude, in phase with the reference, (channels, lines).

    They are kept for the next file under the same controller.
    """
    frequency = scipy.fft.rfftfreq(_analysis(controller.rate_hz).chunk, 1.0 / controller.rate_hz)
    weights = []
    for channel in controller.display.channels:
        prediction = ChannelPrediction.of(controller, channel.name)
        response = prediction.felt(frequency)
        phase = response / np.maximum(np.abs(response), 1e-300)
        weights.append(np.conj(phase) / prediction.channel.threshold.curve.displacement_mm(frequency))
    stacked = np.stack(weights).astype(np.complex64)
    stacked.flags.writeable = False
    return stacked


class FeltComparison:
    """Takes reference and displacement block by block; memory grows by the levels alone.

    sink: is given the felt signal, blocks (n, channels) in threshold units at the moments of the reference's samples.
    """

    def __init__(self, controller: Controller, sink: Sink | None = None) -> None:
        self.analysis = _analysis(controller.rate_hz)
        self._sink = sink
        self._names = tuple(channel.name for channel in controller.display.channels)
        self._weights = _weights(controller)
        self._window = self.analysis.window(2 * len(self._names))
        self._frames: list[list[BandFrames]] = [[] for _ in range(2 * len(self._names))]
        self._taper = raised_ends(self.analysis.chunk, self.analysis.margin // 2)
        self._peak = 0.0

    def push(self, asked: ArrayLike, displacement_mm: ArrayLike) -> None:
        """Count in blocks (n, channels) of the reference (threshold units) and of the displacement at the fingers."""
        reference, displacement = np.asarray(asked, dtype=float), np.asarray(displacement_mm, dtype=float)
        if reference.shape != displacement.shape or reference.ndim != 2 or reference.shape[1] != len(self._names):
            raise BadInput(
                f"asked has shape {reference.shape}, displacement {displacement.shape}", f"both (n, {len(self._names)})"
            )
        if reference.size:
            self._peak = max(self._peak, float(np.max(np.abs(reference))))
        for _ in self._window.push(reference, displacement):
            self._count(self._window.rows, CHUNK_S)

    def _count(self, chunk: Levels, seconds: float) -> None:
        fingers = len(self._names)
        is_same = bool((chunk[1:fingers] == chunk[0]).all())  # fingers often have the same reference
        spectra = scipy.fft.rfft(chunk[fingers - 1 if is_same else 0 :] * self._taper)
        spectra[-fingers:] *= self._weights
        if self._sink is not None:
            start = self.analysis.margin
            stop = start + round(seconds * self.analysis.rate_hz)
            felt = scipy.fft.irfft(spectra[-fingers:], self.analysis.chunk)
            self._sink(felt[:, start:stop].T.astype(np.float64))
        levels = self.analysis.frames(spectra, seconds)
        for row, frames in enumerate(self._frames):
            signal = max(0, row + len(spectra) - len(self._frames))
            frames.append(BandFrames(levels.long_db[signal], levels.short_db[signal]))

    def finish(self) -> FeltReport:
        """Return the comparison of all that was pushed."""
        for count in self._window.finish():
            self._count(self._window.rows, min(CHUNK_S, count / self.analysis.rate_hz))
        centres = np.array([band.centre_hz for band in self.analysis.bands])
        fingers = []
        for index, name in enumerate(self._names):
            (asked_long, asked_short, asked), (felt_long, felt_short, felt) = (
                _joined(self._frames[row]) for row in (index, len(self._names) + index)
            )
            fingers.append(FingerFelt(name, centres, asked_long, felt_long, asked_short, felt_short, asked, felt))
        return FeltReport(tuple(fingers), float(db(self._peak)))


def frame_differences_db(asked_db: Levels, felt_db: Levels) -> Levels:
    """Return the rms level error over bands, one for each frame with a band asked for at 10 dB SL or above."""
    counted = asked_db >= HEARD_DB_SL
    squares = np.where(counted, felt_db - np.where(counted, asked_db, 0.0), 0.0) ** 2
    squares = np.where(counted, squares, 0.0)
    some = counted.any(axis=1)
    return np.asarray(np.sqrt(squares[some].sum(axis=1) / counted[some].sum(axis=1)))


def _joined(parts: list[BandFrames]) -> tuple[Levels, Levels, Levels]:
    long_db, short_db = (np.concatenate([getattr(part, kind) for part in parts]) for kind in ("long_db", "short_db"))
    parts.clear()
    return long_db, short_db, np.concatenate((_mean_level(long_db), _mean_level(short_db)))


def _mean_level(levels_db: Levels) -> Levels:
    if not len(levels_db):
        return np.full(levels_db.shape[1], -np.inf)
    with np.errstate(divide="ignore"):
        return np.asarray(10.0 * np.log10((10.0 ** (levels_db / 10.0)).mean(axis=0, dtype=np.float64)))


def _figures(finger: FingerFelt) -> dict[str, float | int]:
    figures: dict[str, float | int] = {"rms_db": finger.rms_db}
    long = frame_differences_db(finger.asked_long, finger.felt_long)
    short = frame_differences_db(finger.asked_short, finger.felt_short)
    kinds = (
        (f"{1e3 * LONG_FRAME_S:.0f}ms", long),
        (f"{1e3 * SHORT_FRAME_S:.0f}ms", short),
        ("all", np.concatenate((long, short))),
    )
    for name, values in kinds:
        figures[f"frames_{name}"] = len(values)
        middle, high = np.percentile(values, (50.0, 95.0)).tolist() if len(values) else (np.nan, np.nan)
        figures[f"median_db_{name}"], figures[f"p95_db_{name}"] = middle, high
    return figures


SETTLE_S = 0.5
"""How long is listened after the reference's end."""


def compare_felt(
    rig: Rig, controller: Controller, references: Iterable[NDArray[np.float64]], sink: Sink | None = None
) -> FeltReport:
    """Load `controller`, play blocks of reference (n, channels) from rest and half a second of zeros in which the
    display comes to rest, and compare what was felt with what was asked; sink: as of `FeltComparison`.
    """
    rig.load(controller)
    comparison = FeltComparison(controller, sink)
    silence = np.zeros((round(SETTLE_S * rig.rate_hz), len(rig.channels)))
    for trace, displacement_mm in with_felt(rig, rig.stream(chain(references, [silence]))):
        comparison.push(trace.reference, displacement_mm)
    return comparison.finish()
