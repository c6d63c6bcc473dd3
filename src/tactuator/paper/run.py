"""The paper's study from beginning to end: every step in its order, each standing on the ones before."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactuator.identification.calibration import Calibration
from tactuator.model.controller import Controller
from tactuator.model.verdict import Verdict
from tactuator.paper.calibration import calibrate
from tactuator.paper.controllers import paper_controller, reshaped_controller
from tactuator.paper.loops import PaperLoop, paper_loop
from tactuator.paper.motor import IdentifiedMotor, OpenLoopResponse, identify_motors, measure_motors, record_motors
from tactuator.paper.noise import NoiseProbe, probe_noise
from tactuator.paper.objectives import judge_objectives
from tactuator.paper.plan import Plan, Progress
from tactuator.paper.prefilters import Prefilters, judge_prefilters
from tactuator.paper.resolution import bits_needed
from tactuator.paper.response import UNLOADED, ResponsePoint, measure_responses, nominal_response
from tactuator.paper.speech import Spoken, speak
from tactuator.paper.thresholds import KnownThreshold, observers_at_work
from tactuator.perception.curve import ThresholdCurve
from tactuator.rig.rig import Trace
from tactuator.speech.reading import SpeechFile
from tactuator.wordlength.bits import Needed

STEPS = (
    *("calibration", "identification", "motor response", "loop", "prefilter", "noise", "response"),
    *("friction", "thresholds", "reshaped", "speech"),
)
"""The steps that progress is told of, in their order."""


@dataclass(frozen=True)
class Reshaped:
    """The controller for the new curve, its greatest error against that curve at the curve's own frequencies, dB, and
    its measured response."""

    controller: Controller
    max_error_db: float
    responses: tuple[ResponsePoint, ...]


@dataclass(frozen=True)
class PaperStudy:
    """Results of the study, step by step."""

    plan: Plan
    calibration: dict[str, Calibration]
    record: Trace
    motors: dict[str, IdentifiedMotor]
    open_loop: OpenLoopResponse
    loop: PaperLoop
    prefilters: Prefilters
    resolution: Needed
    controller: Controller
    noise: NoiseProbe
    responses: tuple[ResponsePoint, ...]
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
        record = record_motors(plan)
        motors = identify_motors(plan, record, progress)
        open_loop = measure_motors(plan, progress)
        loop = paper_loop(plan.display)
        progress("loop", 1.0)
        prefilters = judge_prefilters(plan.display)
        resolution = bits_needed()
        progress("prefilter", 1.0)
        noise = probe_noise(plan, controller, progress)
        responses = measure_responses(plan, controller, progress)
        without_friction = _without_friction(plan, controller, progress)
        spoken = speak(plan, controller, file, progress)
        detected = detected_by(progress)
    reshaped = _reshape(plan, detected.curve, progress)
    verdict = judge_objectives(plan, controller, responses, noise)
    return PaperStudy(
        plan,
        calibration,
        record,
        motors,
        open_loop,
        loop,
        prefilters,
        resolution,
        controller,
        noise,
        responses,
        without_friction,
        detected.thresholds,
        detected.curve,
        reshaped,
        spoken,
        verdict,
    )


def _without_friction(plan: Plan, controller: Controller, progress: Progress) -> tuple[ResponsePoint, ...]:
    """Measure the response at 0 dB SL of the same display with its friction taken away: what is missing with it is
    friction.
    """
    channels = tuple(
        replace(one, environment=replace(one.environment, friction_v=0.0)) for one in controller.display.channels
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
            np.abs(nominal_response(controller, one.name, curve.frequency_hz))
            / one.threshold_voltage(curve.frequency_hz)
        )
        for one in controller.display.channels
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
