"""Step 2: each channel's sensor against a dial gauge at its finger port."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.identification.calibration import Calibration, fit_line
from tactuator.paper.plan import Plan
from tactuator.rig.simulated import SimulatedRig

GAUGE_ERROR_MM = 0.01
"""Standard error of one reading of the dial gauge (its division)."""

_POSITION_COUNT = 21
_SETTLE_S, _READ_S = 3.0, 0.5


def calibrate(plan: Plan) -> dict[str, Calibration]:
    """Calibrate every channel's sensor gain from steady positions over 80 % of the travel, read by gauge and by sensor.

    The gauge errs by GAUGE_ERROR_MM; the sensor is averaged over half a second.
    """
    rig = SimulatedRig(plan.display, plan.seed_of("calibration"))
    rng = np.random.default_rng(plan.seed_of("dial gauge"))
    readings: dict[str, list[float]] = {name: [] for name in rig.channels}
    for name in rig.channels:
        rig.finger(name).attach(_gauge(readings[name], rig.rate_hz))
    volts = []
    for share in np.linspace(-0.8, 0.8, _POSITION_COUNT):
        trace = rig.drive(np.tile(share * _reaching_travel(plan), (round((_SETTLE_S + _READ_S) * rig.rate_hz), 1)))
        volts.append([_steady(column, rig.rate_hz) for column in trace.position_v.T])
    sensed = np.array(volts)
    return {
        name: fit_line(
            np.array(readings[name]) + GAUGE_ERROR_MM * rng.standard_normal(_POSITION_COUNT),
            sensed[:, index],
            gauge_error_mm=GAUGE_ERROR_MM,
        )
        for index, name in enumerate(rig.channels)
    }


def _gauge(readings: list[float], rate_hz: float) -> Callable[[FloatArray], None]:
    """Return a dial gauge that notes the position at which each block has come to rest."""
    return lambda displacement_mm: readings.append(_steady(displacement_mm, rate_hz))


def _reaching_travel(plan: Plan) -> FloatArray:
    """Return the command (V) that would bring each channel to the end of its travel, by the display file, shape
    (channels,).
    """
    return np.array(
        [one.travel_mm * one.sensor_gain_v_per_mm / abs(one.plant.response(0.0)) for one in plan.display.channels]
    )


def _steady(samples: FloatArray, rate_hz: float) -> float:
    return float(np.mean(samples[-round(_READ_S * rate_hz) :]))
