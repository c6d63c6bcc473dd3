"""Steps 8, 10 and 12: every channel's response at the paper's levels, without and with a finger; speech as felt."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import tactuator as tt
from tactuator.measure.felt import FeltReport
from tactuator.paper.plan import LEVELS_DB_SL, RESPONSE_HZ, Plan, Progress
from tactuator.signals.decibels import db, from_db
from tactuator.speech.limiter import FingerLimiting
from tactuator.speech.reading import SpeechFile, sample_path, scan_speech
from tactuator.verbs.designed import ControllerResult
from tactuator.verbs.speech import SpokenResult


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


def speak(plan: Plan, controller: ControllerResult, file: SpeechFile, progress: Progress) -> Spoken:
    """Play the file coded `direct` at LEVEL_DB_SL on all channels of the simulated display and measure it at the finger
    ports.
    """
    with TemporaryDirectory() as folder:
        out, felt = (Path(folder) / f"{name}.wav" for name in ("reference", "felt"))
        spoken = tt.render(file.path, controller, out, felt=felt, seed=plan.seed_of("speech"))
    assert isinstance(spoken, SpokenResult)
    assert spoken.rendered.felt is not None
    progress("speech", 1.0)
    return Spoken(file, spoken.rendered.felt, spoken.rendered.limiting)


UNLOADED, LOADED = "none", "finger"
CONFIDENCE_DB = {0.0: 1.0, 10.0: 0.3, 30.0: 0.1, 50.0: 0.1}
"""Half-width that averaging goes on for, by level."""


@dataclass(frozen=True)
class ResponsePoint:
    """One measured point, peak volts of y: expected from the shipped sections and the nominal plant, target from the
    curve, measured by the sensor with its half-width: 99 % for all points of a load and level together."""

    channel: str
    load: str
    level_db_sl: float
    frequency_hz: float
    expected_v: float
    target_v: float
    measured_v: float
    ci_db: float
    saturated: bool

    @property
    def error_db(self) -> float:
        """Return the level felt less the level asked, dB."""
        return float(db(self.measured_v / self.target_v))

    @property
    def unpredicted_db(self) -> float:
        """Return the part of the error that the unloaded model does not expect, dB: friction, noise, a load."""
        return float(db(self.measured_v / self.expected_v))


def measure_responses(
    plan: Plan,
    controller: ControllerResult,
    progress: Progress,
    *,
    step: str = "response",
    levels_db_sl: tuple[float, ...] = LEVELS_DB_SL,
    loads: tuple[str, ...] = (UNLOADED, LOADED),
) -> tuple[ResponsePoint, ...]:
    """Measure by stepped sine with lock-in at RESPONSE_HZ, all channels at once, every level, every load."""
    points: list[ResponsePoint] = []
    together = 1.0 - 0.01 / (len(RESPONSE_HZ) * len(controller.channels))
    runs = [(load, level) for load in loads for level in levels_db_sl]
    for index, (load, level) in enumerate(runs):
        rig = tt.SimulatedRig(controller.display, plan.seed_of(f"{step} at {level:g} dB SL, {load}"))
        result = tt.measure_response(
            rig, controller, RESPONSE_HZ, level, load, confidence_db=CONFIDENCE_DB[level], coverage=together
        )
        for measured in result.responses:
            hertz = measured.frequency_hz
            expected = np.abs(controller.response(measured.channel, hertz)) * from_db(level)
            target = controller.display.channel(measured.channel).threshold_voltage(hertz) * from_db(level)
            columns = (hertz, expected, target, measured.magnitude_v, measured.confidence_db, measured.saturated)
            for f, e, t, m, ci, limited in zip(*(column.tolist() for column in columns), strict=True):
                points.append(ResponsePoint(measured.channel, load, level, f, e, t, m, ci, limited))
        progress("response", (index + 1) / len(runs))
    return tuple(points)


def worst_error_db(points: tuple[ResponsePoint, ...], load: str, level_db_sl: float) -> float:
    """Return the greatest |felt less asked|, dB, of a load and level over all channels, saturated points left out."""
    errors = [
        abs(point.error_db)
        for point in points
        if (point.load, point.level_db_sl, point.saturated) == (load, level_db_sl, False)
    ]
    return max(errors)
