"""Steps 2, 3, 4 and 7: the sensors calibrated, the motors identified and measured, hum and resonance as felt."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

import tactuator as tt
from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.recursive import RecursiveEstimate, identify_recursively
from tactuator.model.controller import Controller
from tactuator.model.description import Channel
from tactuator.paper.plan import MAINS_HZ, MOTOR_HZ, PROPORTIONAL_GAINS, Plan, Progress
from tactuator.signals.decibels import db
from tactuator.signals.excitation import paper_mix
from tactuator.signals.spectra import lock_in
from tactuator.verbs.identified import CalibrationResult
from tactuator.verbs.response import FeltLevels

GAUGE_ERROR_MM = 0.01
"""Standard error of one reading of the dial gauge (its division)."""
RECORD_S = 60.0
_POSITION_COUNT = 21
_SETTLE_S, _READ_S = 3.0, 0.5
_TRAVEL_SHARE = 0.8


def calibrate(plan: Plan) -> dict[str, CalibrationResult]:
    """Calibrate every channel's sensor gain from steady positions over 80 % of the travel, read by gauge and by sensor.

    The gauge errs by GAUGE_ERROR_MM; the sensor is averaged over half a second.
    """
    rig = tt.SimulatedRig(plan.display, plan.seed_of("calibration"))
    rng = np.random.default_rng(plan.seed_of("dial gauge"))
    readings: dict[str, list[float]] = {name: [] for name in rig.channels}

    def steady(samples: FloatArray) -> float:
        return float(np.mean(samples[-round(_READ_S * rig.rate_hz) :]))

    def note(name: str, displacement_mm: FloatArray) -> None:
        readings[name].append(steady(displacement_mm))

    for name in rig.channels:
        rig.finger(name).attach(partial(note, name))
    reaching_v = np.array([_travel_v(channel) / abs(channel.plant.response(0.0)) for channel in plan.display.channels])
    sensed = []
    for share in np.linspace(-_TRAVEL_SHARE, _TRAVEL_SHARE, _POSITION_COUNT):
        trace = rig.drive(np.tile(share * reaching_v, (round((_SETTLE_S + _READ_S) * rig.rate_hz), 1)))
        sensed.append([steady(column) for column in trace.position_v.T])
    calibrations: dict[str, CalibrationResult] = {}
    for read, name, volts in zip(readings.values(), rig.channels, np.transpose(sensed), strict=True):
        displacement_mm = np.array(read) + GAUGE_ERROR_MM * rng.standard_normal(_POSITION_COUNT)
        calibrations[name] = tt.calibrate((displacement_mm, volts), GAUGE_ERROR_MM)
    return calibrations


def _travel_v(channel: Channel) -> float:
    """Return the sensor's volts at the end of the travel, by the display file."""
    return channel.travel_mm * channel.sensor_gain_v_per_mm


@dataclass(frozen=True)
class IdentifiedMotor:
    """A channel's estimate, and its greatest error against the simulation's truth over 0.4-300 Hz, dB."""

    channel: str
    estimate: RecursiveEstimate
    frf_error_db_max: float


def identify_motors(plan: Plan, progress: Progress) -> dict[str, IdentifiedMotor]:
    """Identify a second-order model of every channel by recursive least squares, from a record under the paper's mix of
    steps, noise and sinusoids, without controller and without finger.
    """
    rig = tt.SimulatedRig(plan.display, plan.seed_of("identification record"))
    rng = np.random.default_rng(plan.seed_of("excitation"))
    channels = plan.display.channels
    mixes = [
        paper_mix(RECORD_S, rig.rate_hz, c.converter.range_v, rng, plant=c.plant, travel_v=_TRAVEL_SHARE * _travel_v(c))
        for c in channels
    ]
    trace = rig.drive(np.stack(mixes, axis=1))
    motors = {}
    for index, channel in enumerate(channels):
        estimate = identify_recursively(trace.command_v[:, index], trace.position_v[:, index], trace.rate_hz)
        hertz = np.geomspace(*channel.threshold.band_hz, 400)
        error = db(estimate.model.response(hertz) / channel.plant.response(hertz))
        motors[channel.name] = IdentifiedMotor(channel.name, estimate, float(np.max(np.abs(error))))
        progress("identification", (index + 1) / len(channels))
    return motors


@dataclass(frozen=True)
class OpenLoopResponse:
    """The motors' own response, channel by channel: y over u at frequency_hz (n,), complex; sampled and continuous
    models are evaluated beside it by whoever draws it."""

    frequency_hz: FloatArray
    response: dict[str, ComplexArray]


def measure_motors(plan: Plan, progress: Progress) -> OpenLoopResponse:
    """Measure by stepped sine straight into the motors, at MOTOR_HZ, as loud as half the range or a fifth of the travel
    allows.
    """
    rig = tt.SimulatedRig(plan.display, plan.seed_of("open-loop response"))
    rows = []
    for done, hertz in enumerate(MOTOR_HZ, start=1):
        amplitude_v = np.array(
            [
                min(
                    0.5 * channel.converter.range_v,
                    0.2 * _travel_v(channel) / float(np.abs(channel.plant.response(hertz))),
                )
                for channel in plan.display.channels
            ]
        )
        settle = round(max(2.0, 1.0 / hertz) * rig.rate_hz)
        count = settle + round(max(1.0, 2.0 / hertz) * rig.rate_hz)
        trace = rig.drive(np.sin(2.0 * np.pi * hertz * np.arange(count) / rig.rate_hz)[:, None] * amplitude_v)
        lines = np.append(hertz, [line for line in MAINS_HZ * np.arange(1, 6) if abs(line - hertz) > 1.0])
        command, position = (
            lock_in(values[settle:], lines, rig.rate_hz)[0] for values in (trace.command_v, trace.position_v)
        )
        rows.append(position / command)
        progress("motor response", done / len(MOTOR_HZ))
    return OpenLoopResponse(np.array(MOTOR_HZ), dict(zip(rig.channels, np.array(rows).T, strict=True)))


@dataclass(frozen=True)
class NoiseProbe:
    """Felt noise of each channel under a resting finger, by proportional gain and under the designed controller."""

    proportional: dict[float, FeltLevels]
    designed: FeltLevels


def probe_noise(plan: Plan, controller: Controller, progress: Progress) -> NoiseProbe:
    """Hold the display at rest under every gain, then under the designed controller, and judge the command."""
    proportional = {}
    for done, gain in enumerate(PROPORTIONAL_GAINS, start=1):
        rig = tt.SimulatedRig(plan.display, plan.seed_of(f"noise under gain {gain:g}"))
        proportional[gain] = tt.noise(rig, controller, gains=[gain])
        progress("noise", done / (len(PROPORTIONAL_GAINS) + 1))
    designed = tt.noise(tt.SimulatedRig(plan.display, plan.seed_of("noise under the designed loop")), controller)
    progress("noise", 1.0)
    return NoiseProbe(proportional, designed)
