"""The paper's study from its device to its verdicts: every step in its order, each standing on the ones before."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

import tactuator as tt
from tactuator.api.designed import ControllerResult
from tactuator.api.parameters import paper_controller
from tactuator.api.response import FeltLevels
from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.calibration import Calibration
from tactuator.identification.recursive import RecursiveEstimate, identify_recursively
from tactuator.measure.noise import noise_verdict
from tactuator.model.controller import Controller
from tactuator.model.description import Channel, Display
from tactuator.model.verdict import FELT_MINUS_ASKED, Finding, Verdict, compared, verdict_of
from tactuator.paper.plan import LEVELS_DB_SL, MAINS_HZ, MOTOR_HZ, PROPORTIONAL_GAINS, Plan, Progress
from tactuator.paper.steps import (
    LOADED,
    UNLOADED,
    PaperLoop,
    Prefilters,
    ResponsePoint,
    Spoken,
    bits_needed,
    judge_prefilters,
    measure_responses,
    paper_loop,
    reshaped_controller,
    speak,
)
from tactuator.paper.thresholds import KnownThreshold, observers_at_work
from tactuator.perception.curve import ThresholdCurve
from tactuator.signals.decibels import db
from tactuator.signals.excitation import paper_mix
from tactuator.signals.spectra import lock_in
from tactuator.speech.reading import SpeechFile
from tactuator.synthesis.objectives import RESONANCE, judge
from tactuator.wordlength.bits import Needed

JUDGED_AT_DB_SL = 30.0
"""The response is judged where neither friction nor saturation interferes."""


def judge_objectives(
    plan: Plan, controller: ControllerResult, responses: tuple[ResponsePoint, ...], noise: NoiseProbe
) -> Verdict:
    """Return the verdict by what was measured; max|T|, which cannot be measured at rest, by the controller's model."""
    at_level = [point for point in responses if point.level_db_sl == JUDGED_AT_DB_SL]
    heard = noise_verdict(noise.designed.channels, plan.display)
    modelled = judge(controller, plan.display)
    findings = [
        *_follows(plan, at_level),
        *(finding for objective in heard.objectives for finding in objective.findings),
        *(
            finding
            for objective in modelled.objectives
            for finding in objective.findings
            if finding.quantity == RESONANCE
        ),
        *_bears_load(plan, at_level),
    ]
    return verdict_of(findings)


def _follows(plan: Plan, responses: list[ResponsePoint]) -> Iterator[Finding]:
    """Judge objective i of every channel: the greatest error of a measured point against the curve."""
    for channel in plan.display.channels:
        errors = [
            (float(db(point.measured_v / point.target_v)), point)
            for point in responses
            if (point.channel, point.load) == (channel.name, UNLOADED)
        ]
        error, worst = max(errors, key=lambda pair: abs(pair[0]))
        allowed = plan.display.objectives.flatness_db
        finding = compared("i", channel.name, UNLOADED, FELT_MINUS_ASKED, abs(error), allowed, "dB", worst.frequency_hz)
        remark = f"measured at {JUDGED_AT_DB_SL:g} dB SL, confidence {worst.ci_db:.2f} dB"
        yield replace(finding, side=float(np.sign(error)), remark=remark)


def _bears_load(plan: Plan, responses: list[ResponsePoint]) -> Iterator[Finding]:
    """Judge objective iv of every channel: the greatest change by the finger up to `load_band_hz`."""
    tolerance = plan.display.objectives
    free = {(point.channel, point.frequency_hz): point.measured_v for point in responses if point.load == UNLOADED}
    for channel in plan.display.channels:
        changes = [
            (float(db(point.measured_v / free[point.channel, point.frequency_hz])), point.frequency_hz)
            for point in responses
            if (point.channel, point.load) == (channel.name, LOADED)
        ]
        low = max((abs(change), hertz) for change, hertz in changes if hertz <= tolerance.load_band_hz)
        value, at_hz = low
        finding = compared("iv", channel.name, LOADED, "change of |H|", value, tolerance.load_max_db, "dB", at_hz)
        change, worst_hz = max(changes, key=lambda pair: abs(pair[0]))
        yield replace(finding, remark=f"over the band {change:+.2f} dB at {worst_hz:.3g} Hz")


DEFAULT_POLES = 8
STEPS = (
    *("calibration", "identification", "motor response", "loop", "prefilter", "noise", "response"),
    *("default", "friction", "thresholds", "reshaped", "speech"),
)
"""The steps, in their order."""


@dataclass(frozen=True)
class Reshaped:
    """The controller for the new curve, its greatest error against that curve at the curve's own frequencies, dB, and
    its measured response."""

    controller: ControllerResult
    max_error_db: float
    responses: tuple[ResponsePoint, ...]


@dataclass(frozen=True)
class PaperStudy:
    """Results of the study, step by step."""

    plan: Plan
    calibration: dict[str, Calibration]
    motors: dict[str, IdentifiedMotor]
    open_loop: OpenLoopResponse
    loop: PaperLoop
    prefilters: Prefilters
    resolution: Needed
    controller: ControllerResult
    noise: NoiseProbe
    responses: tuple[ResponsePoint, ...]
    default: tuple[ResponsePoint, ...]
    without_friction: tuple[ResponsePoint, ...]
    thresholds: tuple[KnownThreshold, ...]
    curve: ThresholdCurve
    reshaped: Reshaped
    spoken: Spoken
    verdict: Verdict


def run_study(plan: Plan, file: SpeechFile, progress: Progress) -> PaperStudy:
    """Run the whole study; file: the plan's speech as `check_speech` found it: a bad one is refused first."""
    controller = ControllerResult.of(paper_controller(plan.display))
    with observers_at_work(plan, controller) as detected_by:  # they take longer than all the rest together
        calibration = calibrate(plan)
        progress("calibration", 1.0)
        motors = identify_motors(plan, progress)
        open_loop = measure_motors(plan, progress)
        loop = paper_loop(plan.display)
        progress("loop", 1.0)
        prefilters = judge_prefilters(plan.display)
        resolution = bits_needed()
        progress("prefilter", 1.0)
        noise = probe_noise(plan, controller, progress)
        responses = measure_responses(plan, controller, progress)
        default = _default(plan, progress)
        without_friction = _without_friction(plan, controller, progress)
        spoken = speak(plan, controller, file, progress)
        detected = detected_by(progress)
    reshaped = _reshape(plan, detected.curve, progress)
    verdict = judge_objectives(plan, controller, responses, noise)
    return PaperStudy(
        plan,
        calibration,
        motors,
        open_loop,
        loop,
        prefilters,
        resolution,
        controller,
        noise,
        responses,
        default,
        without_friction,
        detected.thresholds,
        detected.curve,
        reshaped,
        spoken,
        verdict,
    )


def default_display(display: Display) -> Display:
    """Return the display with what `init` writes for it: a prefilter of eight poles, and a finger fed forward."""
    channels = (
        replace(channel, prefilter=replace(channel.prefilter, poles=DEFAULT_POLES)) for channel in display.channels
    )
    return replace(display, channels=tuple(channels), touch=replace(display.touch, adaptive=True))


def _default(plan: Plan, progress: Progress) -> tuple[ResponsePoint, ...]:
    """Measure the controller that the product itself would make: the paper's display, designed as `init` proposes."""
    controller = tt.design(default_display(plan.display))
    levels = tuple(level for level in LEVELS_DB_SL if level > 0.0)
    return measure_responses(
        plan, controller, lambda _, done: progress("default", done), step="default response", levels_db_sl=levels
    )


def _without_friction(plan: Plan, controller: ControllerResult, progress: Progress) -> tuple[ResponsePoint, ...]:
    """Measure the response at 0 dB SL of the same display without its friction: the difference is friction."""
    channels = tuple(
        replace(channel, environment=replace(channel.environment, friction_v=0.0))
        for channel in controller.display.channels
    )
    smooth = replace(controller, display=replace(controller.display, channels=channels))
    return measure_responses(
        plan,
        smooth,
        lambda _, done: progress("friction", done),
        step="no friction",
        levels_db_sl=(0.0,),
        loads=(UNLOADED,),
    )


def _reshape(plan: Plan, curve: ThresholdCurve, progress: Progress) -> Reshaped:
    controller = reshaped_controller(plan.display, curve)
    errors = [
        20.0
        * np.log10(
            np.abs(controller.response(channel.name, curve.frequency_hz))
            / channel.threshold_voltage(curve.frequency_hz)
        )
        for channel in controller.display.channels
    ]
    responses = measure_responses(
        plan,
        controller,
        lambda _, done: progress("reshaped", done),
        step="reshaped response",
        levels_db_sl=(10.0, 30.0),
        loads=(UNLOADED,),
    )
    return Reshaped(controller, float(np.max(np.abs(errors))), responses)


GAUGE_ERROR_MM = 0.01
"""Standard error of one reading of the dial gauge (its division)."""
RECORD_S = 60.0
_POSITION_COUNT = 21
_SETTLE_S, _READ_S = 3.0, 0.5
_TRAVEL_SHARE = 0.8


def calibrate(plan: Plan) -> dict[str, Calibration]:
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
    calibrations: dict[str, Calibration] = {}
    for read, name, volts in zip(readings.values(), rig.channels, np.transpose(sensed), strict=True):
        displacement_mm = np.array(read) + GAUGE_ERROR_MM * rng.standard_normal(_POSITION_COUNT)
        calibrations[name] = tt.calibrate((displacement_mm, volts), GAUGE_ERROR_MM)
    return calibrations


def _travel_v(channel: Channel) -> float:
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
    models are evaluated where it is drawn."""

    frequency_hz: FloatArray
    response: dict[str, ComplexArray]


def measure_motors(plan: Plan, progress: Progress) -> OpenLoopResponse:
    """Measure by stepped sine straight into the motors at MOTOR_HZ, up to half the range or a fifth of the travel."""
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
