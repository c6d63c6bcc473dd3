"""The paper's study end to end, every step on the results of those before it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import tactuator as tt
from tactuator.api.controller import WordlengthResult, word_length
from tactuator.api.designed import ControllerResult
from tactuator.model.verdict import Verdict
from tactuator.paper.lab import DISPLAY, Lab, Truth, compare_with_truth, set_up
from tactuator.paper.measured import UNLOADED, Responses, Spoken, measure, other_fingers, speak, without_friction
from tactuator.paper.people import CURVE, Detected, people_at_work
from tactuator.paper.plan import LEVELS_DB_SL, Plan, Progress
from tactuator.paper.printed import CHANNEL, printed_controller
from tactuator.processors import single_threaded

STEPS = (
    *("calibration", "identification", "design", "noise", "printed", "response", "friction", "fingers"),
    *("speech", "thresholds", "reshaped"),
)
"""The steps, in their order."""
CODINGS = ("direct", "bands")
PRINTED, RESHAPED = "printed.json", "reshaped.json"


@dataclass(frozen=True)
class PaperStudy:
    """Results of the study. printed: the paper's own F and C, its figures of the channel CHANNEL alone; verdicts:
    `check` of both designs; reshaped: for the new curve, which it follows within reshaped_error_db.
    """

    plan: Plan
    lab: Lab
    truth: Truth
    verdict: Verdict
    responses: Responses
    without_friction: Responses
    other_fingers: Responses
    printed: ControllerResult
    printed_verdict: Verdict
    printed_responses: Responses
    resolution: WordlengthResult
    detected: Detected
    reshaped: ControllerResult
    reshaped_error_db: float
    reshaped_responses: Responses
    spoken: tuple[Spoken, ...]


@single_threaded()
def run_study(plan: Plan, folder: Path, speech: Path, progress: Progress) -> PaperStudy:
    """Run the whole study. folder: for the files of every step; speech: a file that was found to be one."""
    lab = set_up(plan, folder, progress)
    controller = lab.controller
    felt = tuple(level for level in LEVELS_DB_SL if level > 0.0)
    with people_at_work(plan, folder) as detected_by:  # they take longer than all the rest together
        printed = printed_controller(lab.display)
        printed.write(folder / PRINTED)
        printed_responses = measure(plan, printed, "printed", progress, levels_db_sl=felt)
        responses = measure(plan, controller, "response", progress)
        smooth = without_friction(plan, controller, progress)
        fingers = other_fingers(plan, controller, progress)
        spoken = tuple(speak(plan, controller, speech, coding) for coding in CODINGS)
        progress("speech", 1.0)
        verdict, printed_verdict = tt.check(controller), tt.check(printed)
        truth, resolution = compare_with_truth(plan, lab), word_length(printed)
        detected = detected_by()
        progress("thresholds", 1.0)
    reshaped = tt.design(folder / DISPLAY, curve=folder / CURVE)
    reshaped.write(folder / RESHAPED)
    reshaped_responses = measure(plan, reshaped, "reshaped", progress, levels_db_sl=(10.0, 30.0), loads=(UNLOADED,))
    hertz = detected.curve.frequency_hz
    errors = [
        20.0 * np.log10(np.abs(reshaped.response(channel.name, hertz)) / channel.threshold_voltage(hertz))
        for channel in reshaped.display.channels
    ]
    return PaperStudy(
        plan, lab, truth, verdict, responses, smooth, fingers, printed, printed_verdict,
        tuple(run for run in printed_responses if run.channel == CHANNEL), resolution, detected, reshaped,
        float(np.max(np.abs(errors))), reshaped_responses, spoken,
    )  # fmt: skip
