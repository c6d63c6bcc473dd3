"""The paper's study from beginning to end: every step in its order, each standing on the ones before."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

import tactuator as tt
from tactuator.measure.noise import noise_verdict
from tactuator.model.description import Display
from tactuator.model.verdict import FELT_LESS_ASKED, Finding, Verdict, compared, verdict_of
from tactuator.paper.device import (
    IdentifiedMotor,
    NoiseProbe,
    OpenLoopResponse,
    calibrate,
    identify_motors,
    measure_motors,
    probe_noise,
)
from tactuator.paper.loops import (
    PaperLoop,
    Prefilters,
    bits_needed,
    judge_prefilters,
    paper_controller,
    paper_loop,
    reshaped_controller,
)
from tactuator.paper.plan import LEVELS_DB_SL, Plan, Progress
from tactuator.paper.response import LOADED, UNLOADED, ResponsePoint, Spoken, measure_responses, speak
from tactuator.paper.thresholds import KnownThreshold, observers_at_work
from tactuator.perception.curve import ThresholdCurve
from tactuator.signals.decibels import db
from tactuator.speech.reading import SpeechFile
from tactuator.synthesis.verdict import RESONANCE, judge
from tactuator.verbs.designed import ControllerResult
from tactuator.verbs.identified import CalibrationResult
from tactuator.wordlength.bits import Needed

JUDGED_AT_DB_SL = 30.0
"""The response is judged where neither friction nor saturation interferes."""


def judge_objectives(
    plan: Plan, controller: ControllerResult, responses: tuple[ResponsePoint, ...], noise: NoiseProbe
) -> Verdict:
    """Return the verdict by what was measured; max|T|, which nobody can measure at rest, by the controller's model."""
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
            (abs(float(db(point.measured_v / point.target_v))), point)
            for point in responses
            if (point.channel, point.load) == (channel.name, UNLOADED)
        ]
        value, worst = max(errors, key=lambda pair: pair[0])
        allowed = plan.display.objectives.flatness_db
        finding = compared("i", channel.name, UNLOADED, FELT_LESS_ASKED, value, allowed, "dB", worst.frequency_hz)
        yield replace(finding, remark=f"measured at {JUDGED_AT_DB_SL:g} dB SL, confidence {worst.ci_db:.2f} dB")


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
"""The steps that progress is told of, in their order."""


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
    calibration: dict[str, CalibrationResult]
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
    """Run the whole study; file: the plan's speech file as `check_speech` found it, so that a bad one is
    refused first.
    """
    controller = paper_controller(plan.display)
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
    """Measure the response at 0 dB SL of the same display with its friction taken away: what is missing with it is
    friction.
    """
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
