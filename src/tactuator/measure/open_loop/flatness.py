"""Felt flatness of an equalised channel: measured at a level over its band, in parts that stay within its limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.measure.error import error_db
from tactuator.measure.multisine_response import multisine_response
from tactuator.measure.prediction import ChannelPrediction
from tactuator.model.controller import Controller
from tactuator.perception.curve import COMFORT_DB_SL
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
    at level_db_sl, as many at a time as command, travel and comfort allow. A group that was cut after all is measured
    again in halves: its lines stand up to 2 % beside those that were asked for, which is much at an antiresonance.
    """
    display = controller.display
    band_hz = display.channel(name).threshold.band_hz
    lines = _lines(controller, name, band_hz)
    groups = _groups(controller, name, lines, level_db_sl)
    parts = []
    while groups:
        group = groups.pop(0)
        (response,) = multisine_response(
            rig, group, level_db_sl, rng,
            channels=[name], longest_s=longest_s, mains_hz=mains_hz, band_hz=band_hz, exactly=False, confidence_db=0.25,
        )  # fmt: skip
        if group.size > 1 and np.any(response.saturated):
            groups += [group[::2], group[1::2]]
            continue
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
    """Return the lines in groups whose sums stay within command, travel and comfort: a line that asks for much is
    played alone, and what is left is interleaved.
    """
    prediction = ChannelPrediction.of(controller, name)
    channel = prediction.channel
    share = float(from_db(level_db_sl))
    asked = np.stack(
        [
            share * np.abs(prediction.command(lines)) / channel.converter.range_v,
            share * np.abs(prediction.displacement(lines)) / channel.travel_mm,
            np.full(lines.size, share / float(from_db(COMFORT_DB_SL))),
        ]
    )

    def split(places: NDArray[np.intp]) -> list[NDArray[np.intp]]:
        part = asked[:, places]
        peak = np.minimum(np.sum(part, axis=1), _CREST * np.sqrt(0.5 * np.sum(part**2, axis=1)))
        if places.size == 1 or np.max(peak) <= _LIMIT_SHARE:
            return [places]
        most = int(np.argmax(np.max(part, axis=0)))
        if np.max(part[:, most]) > 0.5 * _LIMIT_SHARE:
            return [places[most : most + 1], *split(np.delete(places, most))]
        return [*split(places[::2]), *split(places[1::2])]

    return [lines[places] for places in split(np.arange(lines.size))]
