"""Step 12: speech, band-limited to 300 Hz, as the reference of every finger; felt against asked."""

from __future__ import annotations

from dataclasses import dataclass

from tactuator.measure.felt import FeltReport, compare_felt
from tactuator.model.controller import Controller
from tactuator.paper.plan import Plan, Progress
from tactuator.rig.simulated import SimulatedRig
from tactuator.speech.limiter import FingerLimiting
from tactuator.speech.reading import SpeechFile, sample_path, scan_speech
from tactuator.speech.render import rendering


@dataclass(frozen=True)
class Spoken:
    """Speech on the display. file: what was presented; report: felt against asked; limiting: what the limiter took from
    each finger.
    """

    file: SpeechFile
    report: FeltReport
    limiting: tuple[FingerLimiting, ...]


def check_speech(plan: Plan) -> SpeechFile:
    """Return the plan's speech file, read through. Raises BadInput for one that cannot be used: call it before all else
    is run.
    """
    return scan_speech(sample_path() if plan.speech is None else plan.speech)


def speak(plan: Plan, controller: Controller, file: SpeechFile, progress: Progress) -> Spoken:
    """Play the file coded `direct` at LEVEL_DB_SL on all channels of the simulated display and measure it at the finger
    ports.
    """
    rig = SimulatedRig(controller.display, plan.seed_of("speech"))
    with rendering(file.path, controller) as reference:
        report = compare_felt(rig, controller, reference.blocks())
        progress("speech", 1.0)
        return Spoken(file, report, reference.limiting)
