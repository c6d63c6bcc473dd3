"""Comparison of the felt level of a reference with the level asked, both in dB SL, in third-octave bands.

The displacement at the finger is weighted by the inverse threshold curve with zero phase; the display's own delay and
phase, those of the designed H without load, are taken out, so that levels of the same moments are compared.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from tactuator.errors import BadInput
from tactuator.measure.band_levels import LONG_FRAME_S, SHORT_FRAME_S, BandAnalysis, BandFrames, Chunker
from tactuator.measure.prediction import ChannelPrediction
from tactuator.model.controller import Controller

Levels = NDArray[np.floating[Any]]
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

    @property
    def difference_db(self) -> Levels:
        """Return the felt less the asked level over the whole, for every band; NaN where less than 10 dB SL
        was asked.
        """
        return np.where(self.asked_db_sl >= HEARD_DB_SL, self.felt_db_sl - self.asked_db_sl, np.nan)

    @property
    def rms_db(self) -> float:
        """Return the root mean square of `difference_db` over the bands that count; NaN if none does."""
        return _rms(self.difference_db)

    def frame_rms_db(self) -> Levels:
        """Return the rms difference over the counted bands of every frame that has any, long frames first."""
        parts = ((self.asked_long, self.felt_long), (self.asked_short, self.felt_short))
        return np.concatenate([frame_differences_db(asked, felt) for asked, felt in parts])


@dataclass(frozen=True, eq=False)
class FeltReport:
    """Every finger's comparison. peak_db_sl: the greatest sample of the reference."""

    fingers: tuple[FingerFelt, ...]
    peak_db_sl: float

    @property
    def worst_rms_db(self) -> float:
        """Return the greatest of the fingers' `rms_db`; NaN if no finger has one."""
        values = [finger.rms_db for finger in self.fingers if np.isfinite(finger.rms_db)]
        return max(values) if values else float("nan")

    def figures(self) -> dict[str, dict[str, float | int]]:
        """Return, by finger, the rms over the whole and the median and 95th percentile of the frames' rms, of either
        kind.
        """
        return {finger.finger: _figures(finger) for finger in self.fingers}


@lru_cache(maxsize=2)
def _weights(controller: Controller) -> NDArray[np.complex64]:
    """Return what makes each channel's displacement felt amplitude, in phase with the reference, (channels, lines).

    They are kept for the next file under the same controller.
    """
    frequency = BandAnalysis(controller.rate_hz).frequency_hz()
    found = []
    for channel in controller.display.channels:
        prediction = ChannelPrediction.of(controller, channel.name)
        response = prediction.felt(frequency)
        phase = response / np.maximum(np.abs(response), 1e-300)
        found.append(np.conj(phase) / prediction.channel.threshold.curve.displacement_mm(frequency))
    weights = np.stack(found).astype(np.complex64)
    weights.flags.writeable = False
    return weights


class FeltComparison:
    """Takes reference and displacement block by block; memory grows by the levels alone.

    sink: is given the felt signal, blocks (n, channels) in threshold units at the moments of the reference's samples.
    """

    def __init__(self, controller: Controller, sink: Sink | None = None) -> None:
        self.analysis = BandAnalysis(controller.rate_hz)
        self._sink = sink
        self._names = tuple(channel.name for channel in controller.display.channels)
        self._weights = _weights(controller)
        self._chunker = Chunker(self.analysis, 2 * len(self._names))
        self._asked: list[list[BandFrames]] = [[] for _ in self._names]
        self._felt: list[list[BandFrames]] = [[] for _ in self._names]
        edge = self.analysis.margin // 2
        self._taper = np.ones(self.analysis.chunk, dtype=np.float32)
        self._taper[:edge] = 0.5 - 0.5 * np.cos(np.pi * (np.arange(edge) + 0.5) / edge)
        self._taper[-edge:] = self._taper[:edge][::-1]
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
        for chunk in self._chunker.push(np.concatenate((reference, displacement), axis=1)):
            self._count(chunk, None)

    def _count(self, chunk: NDArray[np.float32], seconds: float | None) -> None:
        limit = {} if seconds is None else {"seconds": seconds}
        spectra = fft.rfft(chunk * self._taper)
        half = len(self._names)
        if self._sink is not None:
            start = self.analysis.margin
            stop = start + (self.analysis.hop if seconds is None else round(seconds * self.analysis.rate_hz))
            felt = fft.irfft(spectra[half:] * self._weights, self.analysis.chunk)
            self._sink(felt[:, start:stop].T.astype(np.float64))
        for index in range(half):
            self._asked[index].append(self.analysis.frames(spectra[index], **limit))
            self._felt[index].append(self.analysis.frames(spectra[half + index] * self._weights[index], **limit))

    def finish(self) -> FeltReport:
        """Return the comparison of all that was pushed."""
        for chunk, seconds in self._chunker.finish():
            self._count(chunk, seconds)
        fingers = tuple(
            self._finger(name, asked, felt)
            for name, asked, felt in zip(self._names, self._asked, self._felt, strict=True)
        )
        with np.errstate(divide="ignore"):
            return FeltReport(fingers, float(20.0 * np.log10(self._peak)))

    def _finger(self, name: str, asked: list[BandFrames], felt: list[BandFrames]) -> FingerFelt:
        asked_long, asked_short = _joined(asked)
        felt_long, felt_short = _joined(felt)
        centres = np.array([band.centre_hz for band in self.analysis.bands])
        whole_asked = np.concatenate((_mean_level(asked_long), _mean_level(asked_short)))
        whole_felt = np.concatenate((_mean_level(felt_long), _mean_level(felt_short)))
        return FingerFelt(name, centres, asked_long, felt_long, asked_short, felt_short, whole_asked, whole_felt)


def frame_differences_db(asked_db: Levels, felt_db: Levels) -> Levels:
    """Return the rms over bands of the felt less the asked level, one value for every frame with a band asked for at 10
    dB SL or above.
    """
    counted = asked_db >= HEARD_DB_SL
    squares = np.where(counted, felt_db - np.where(counted, asked_db, 0.0), 0.0) ** 2
    squares = np.where(counted, squares, 0.0)
    some = counted.any(axis=1)
    return np.asarray(np.sqrt(squares[some].sum(axis=1) / counted[some].sum(axis=1)))


def _joined(parts: list[BandFrames]) -> tuple[Levels, Levels]:
    joined = np.concatenate([part.long_db for part in parts]), np.concatenate([part.short_db for part in parts])
    parts.clear()
    return joined


def _mean_level(levels_db: Levels) -> Levels:
    if not len(levels_db):
        return np.full(levels_db.shape[1], -np.inf)
    with np.errstate(divide="ignore"):
        return np.asarray(10.0 * np.log10((10.0 ** (levels_db / 10.0)).mean(axis=0, dtype=np.float64)))


def _rms(values: Levels) -> float:
    counted = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(counted**2))) if counted.size else float("nan")


def _figures(finger: FingerFelt) -> dict[str, float | int]:
    figures: dict[str, float | int] = {"rms_db": finger.rms_db}
    kinds = (
        (f"{1e3 * LONG_FRAME_S:.0f}ms", frame_differences_db(finger.asked_long, finger.felt_long)),
        (f"{1e3 * SHORT_FRAME_S:.0f}ms", frame_differences_db(finger.asked_short, finger.felt_short)),
        ("all", finger.frame_rms_db()),
    )
    for name, values in kinds:
        figures[f"frames_{name}"] = len(values)
        figures[f"median_db_{name}"] = float(np.median(values)) if len(values) else float("nan")
        figures[f"p95_db_{name}"] = float(np.percentile(values, 95)) if len(values) else float("nan")
    return figures
