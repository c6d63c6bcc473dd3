"""A measurement of the response at a rig, told point by point against what the controller's model expects."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.console.held_rig.orders import MeasureOrder, Points
from tactuator.io.response import write_responses
from tactuator.measure.error import ChannelPrediction, error_db, expected_level_db_sl
from tactuator.measure.options import MeasurementOptions
from tactuator.measure.stepped_sine import stepped_sine
from tactuator.model.controller import Controller
from tactuator.rig.rig import Rig
from tactuator.signals.decibels import db
from tactuator.signals.record import Response


def measured(rig: Rig, order: MeasureOrder, tell: Callable[[tuple[Response, ...]], None]) -> tuple[Response, ...]:
    """Measure as `measure` does, and call `tell` with the responses so far after every point."""
    options = MeasurementOptions(
        order.level_db_sl,
        channels=order.channels,
        load=order.load,
        confidence_db=order.confidence_db,
        longest_s=order.longest_s,
        mains_hz=order.mains_hz,
        band_hz=order.band_hz,
        controller_hash=order.controller.content_hash,
    )
    return stepped_sine(rig, np.array(order.frequency_hz), options, so_far=tell)


def points_of(responses: tuple[Response, ...], order: MeasureOrder, folder: Path, over: bool) -> Points:
    """Return what a page shows of a measurement, and the file that `measure --out response.csv` would write of it."""
    path = folder / "response.csv"
    write_responses(path, responses)
    display = order.controller.display
    shown = [
        {
            "channel": one.channel,
            "load": one.load,
            "frequency_hz": one.frequency_hz.tolist(),
            "level_db_sl": _finite(one.level_db_sl + error_db(one, display)),
            "expected_db_sl": _finite(expected_level_db_sl(one, order.controller)),
            "confidence_db": _finite(one.confidence_db),
            "saturated": one.saturated.tolist(),
            "reached": one.reached.tolist(),
        }
        for one in responses
    ]
    done = len(responses[0].frequency_hz) if responses else 0
    return Points({"responses": shown}, done, len(order.frequency_hz), path.read_text("utf-8"), over)


def expected_curves(controller: Controller, level_db_sl: float, frequency_hz: FloatArray) -> list[dict[str, Any]]:
    """Return the level (dB SL) that the controller's model expects at each frequency, for every channel, without load
    and under each load.
    """
    curves = []
    for channel in controller.display.channels:
        threshold_v = channel.threshold_voltage(frequency_hz)
        for load in (None, *(one.name for one in channel.loads)):
            there = ChannelPrediction.of(controller, channel.name, load).loop.position_response(frequency_hz)
            level = level_db_sl + db(np.abs(there) / threshold_v)
            curves.append({"channel": channel.name, "load": load or "none", "level_db_sl": level.tolist()})
    return curves


def _finite(values: FloatArray) -> list[float | None]:
    """Return numbers as JSON has them: None for a level of nothing (a sensor that stands still) or no confidence."""
    return [float(value) if np.isfinite(value) else None for value in values]
