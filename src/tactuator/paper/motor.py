"""Steps 3 and 7: each motor identified from a record, and its response measured to 400 Hz beside the models."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.recursive import RecursiveEstimate, identify_recursively
from tactuator.model.description import Channel
from tactuator.paper.plan import MAINS_HZ, MOTOR_HZ, Plan, Progress
from tactuator.rig.rig import Trace
from tactuator.rig.simulated import SimulatedRig
from tactuator.signals.decibels import db
from tactuator.signals.excitation import paper_mix
from tactuator.signals.spectra import lock_in

RECORD_S = 60.0
_TRAVEL_SHARE = 0.8


@dataclass(frozen=True)
class IdentifiedMotor:
    """A channel's estimate, and its greatest error against the simulation's truth over 0.4-300 Hz, dB."""

    channel: str
    estimate: RecursiveEstimate
    frf_error_db_max: float


def record_motors(plan: Plan) -> Trace:
    """Record every channel under the paper's mix of steps, noise and sinusoids, without controller and
    without finger.
    """
    rig = SimulatedRig(plan.display, plan.seed_of("identification record"))
    rng = np.random.default_rng(plan.seed_of("excitation"))
    command = np.stack([_excitation(one, rig.rate_hz, rng) for one in plan.display.channels], axis=1)
    return rig.drive(command)


def _excitation(channel: Channel, rate_hz: float, rng: np.random.Generator) -> FloatArray:
    travel_v = _TRAVEL_SHARE * channel.travel_mm * channel.sensor_gain_v_per_mm
    return paper_mix(RECORD_S, rate_hz, channel.converter.range_v, rng, plant=channel.plant, travel_v=travel_v)


def identify_motors(plan: Plan, trace: Trace, progress: Progress) -> dict[str, IdentifiedMotor]:
    """Identify a second-order model of every channel of the record by recursive least squares."""
    found = {}
    for index, channel in enumerate(plan.display.channels):
        estimate = identify_recursively(trace.command_v[:, index], trace.position_v[:, index], trace.rate_hz)
        hertz = np.geomspace(*channel.threshold.band_hz, 400)
        error = db(estimate.model.response(hertz) / channel.plant.response(hertz))
        found[channel.name] = IdentifiedMotor(channel.name, estimate, float(np.max(np.abs(error))))
        progress("identification", (index + 1) / len(plan.display.channels))
    return found


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
    rig = SimulatedRig(plan.display, plan.seed_of("open-loop response"))
    rows = []
    for done, hertz in enumerate(MOTOR_HZ, start=1):
        amplitude = np.array([_tone_v(channel, hertz) for channel in plan.display.channels])
        settle = round(max(2.0, 1.0 / hertz) * rig.rate_hz)
        count = settle + round(max(1.0, 2.0 / hertz) * rig.rate_hz)
        angle = 2.0 * np.pi * hertz * np.arange(count) / rig.rate_hz
        trace = rig.drive(np.sin(angle)[:, None] * amplitude)
        lines = np.append(hertz, [line for line in MAINS_HZ * np.arange(1, 6) if abs(line - hertz) > 1.0])
        command, position = (
            lock_in(values[settle:], lines, rig.rate_hz)[0] for values in (trace.command_v, trace.position_v)
        )
        rows.append(position / command)
        progress("motor response", done / len(MOTOR_HZ))
    table = np.array(rows)
    return OpenLoopResponse(np.array(MOTOR_HZ), {name: table[:, k] for k, name in enumerate(rig.channels)})


def _tone_v(channel: Channel, hertz: float) -> float:
    travel_v = channel.travel_mm * channel.sensor_gain_v_per_mm
    return min(0.5 * channel.converter.range_v, 0.2 * travel_v / float(np.abs(channel.plant.response(hertz))))
