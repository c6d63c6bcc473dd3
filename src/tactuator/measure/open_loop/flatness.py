"""Felt flatness of an equalised channel: measured at a level over its band, in parts that stay within its limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.display.controller import Controller
from tactuator.measure.error import error_db
from tactuator.measure.multisine_response import multisine_response
from tactuator.measure.prediction import ChannelPrediction
from tactuator.perception.levels import COMFORT_DB_SL
from tactuator.rig.rig import Rig
from tactuator.signals.decibels import from_db

_LINES, _CREST = 48, 3.5
_LIMIT_SHARE = 0.9


@dataclass(frozen=True, eq=False)
class Flatness:
    """Felt level less the level asked, at lines over a band: frequency_hz ascending, error_db, confidence_db, (m,).
    limited: a line was played while something was cut.
    """

    frequency_hz: FloatArray
    error_db: FloatArray
    confidence_db: FloatArray
    limited: bool

    @property
    def worst_db(self) -> float:
        """Return the greatest error, dB, its sign kept."""
        return float(self.error_db[np.argmax(np.abs(self.error_db))])


def felt_flatness(
    rig: Rig,
    controller: Controller,
    name: str,
    level_db_sl: float,
    rng: np.random.Generator,
    mains_hz: float | None,
    longest_s: float,
) -> Flatness:
    """Measure the loaded controller's felt level over the channel's band: 48 lines and more about its resonances, each
    at level_db_sl, as many at a time as command, travel and comfort allow.
    """
    display = controller.display
    band_hz = display.channel(name).threshold.band_hz
    lines = _lines(controller, name, band_hz)
    groups = _groups(controller, name, lines, level_db_sl)
    parts = []
    for group in groups:
        (response,) = multisine_response(
            rig, group, level_db_sl, rng,
            channels=[name], longest_s=longest_s, mains_hz=mains_hz, band_hz=band_hz, exactly=False, confidence_db=0.25,
        )  # fmt: skip
        parts.append((response.frequency_hz, error_db(response, display), response.confidence_db, response.saturated))
    frequency, error, confidence, limited = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(frequency, kind="stable")
    return Flatness(frequency[order], error[order], confidence[order], bool(np.any(limited)))


def _lines(controller: Controller, name: str, band_hz: tuple[float, float]) -> FloatArray:
    """Return frequencies over the band and about the plant's lightly damped roots, which lie between others."""
    low, high = band_hz
    chosen = [np.geomspace(1.01 * low, 0.99 * high, _LINES)]
    plant = controller.display.channel(name).plant
    for root in (*plant.poles, *plant.zeros):
        hertz, sharp = abs(root) / (2.0 * np.pi), abs(root.real) / max(abs(root), 1e-12)
        if root.imag > 0.0 and low < hertz < high and sharp < 0.2:
            about = hertz * (1.0 + max(sharp, 2e-3) * np.array([-2.0, -1.0, -0.4, 0.0, 0.4, 1.0, 2.0]))
            chosen.append(about[(about > low) & (about < high)])
    return np.unique(np.concatenate(chosen))


def _groups(controller: Controller, name: str, lines: FloatArray, level_db_sl: float) -> list[FloatArray]:
    """Return the lines in interleaved groups whose sums stay within command, travel and comfort."""
    prediction = ChannelPrediction.of(controller, name)
    channel = prediction.channel
    share = float(from_db(level_db_sl))
    asked = {
        "command": share * np.abs(prediction.command(lines)) / channel.converter.range_v,
        "travel": share * np.abs(prediction.displacement(lines)) / channel.travel_mm,
        "comfort": np.full(lines.size, share / float(from_db(COMFORT_DB_SL))),
    }
    for count in (1, 2, 3, 4, 6, 8, 12, 16, 24):
        groups = [slice(first, None, count) for first in range(count)]
        peaks = [_CREST * np.sqrt(0.5 * np.sum(part[group] ** 2)) for group in groups for part in asked.values()]
        if max(peaks) <= _LIMIT_SHARE:
            break
    return [lines[group] for group in groups]
