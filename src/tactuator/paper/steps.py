"""Steps 5 to 8, 10 and 12: the paper's C around its motor with its margins, the prefilters and the bits that they need;
every channel's response at the paper's levels, without and with a finger; speech as felt.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import tactuator as tt
from tactuator.api.designed import ControllerResult
from tactuator.api.parameters import paper_controller
from tactuator.api.response import MeasuredResponses
from tactuator.api.speech import RenderResult
from tactuator.arrays import FloatArray
from tactuator.measure.felt import FeltReport
from tactuator.model.description import Channel, Display
from tactuator.paper.plan import LEVELS_DB_SL, RESPONSE_HZ, Plan, Progress
from tactuator.perception.curve import ThresholdCurve
from tactuator.signals.decibels import db, from_db
from tactuator.signals.discretise import discretise
from tactuator.signals.loop import FeedbackLoop, TwoDegreeLoop
from tactuator.signals.loop_figures import Margins, margins
from tactuator.signals.systems import SampledSystem
from tactuator.speech.limiter import FingerLimiting
from tactuator.speech.reading import SpeechFile, sample_path, scan_speech
from tactuator.synthesis import paper
from tactuator.synthesis.prefilter import PrefilterFit, fit_prefilter
from tactuator.wordlength.bits import FORMS, BitsNeeded, Needed, filter_bits, loop_bits


def reshaped_controller(display: Display, curve: ThresholdCurve) -> ControllerResult:
    """Return a controller for another curve: C stays, the prefilters follow the curve where it covers the band."""
    channels = []
    for channel in display.channels:
        low, high = channel.threshold.band_hz
        band = (max(low, float(curve.frequency_hz[0])), min(high, float(curve.frequency_hz[-1])))
        channels.append(replace(channel, threshold=replace(channel.threshold, curve=curve, band_hz=band)))
    return ControllerResult.of(paper_controller(replace(display, channels=tuple(channels))))


@dataclass(frozen=True)
class Judged:
    """Error of |H| against the curve over the band, dB: greatest, root mean square even in log frequency, and at every
    frequency_hz, shape (n,)."""

    poles: int
    max_error_db: float
    rms_error_db: float
    frequency_hz: FloatArray
    error_db: FloatArray


@dataclass(frozen=True)
class Prefilters:
    """The paper's F as printed (continuous) and as its bilinear transform runs; ours for every channel (sampled)."""

    paper: Judged
    paper_sampled: Judged
    fitted: dict[str, PrefilterFit]

    @property
    def worst_fitted(self) -> PrefilterFit:
        """Return the fit of the channel with the greatest error."""
        return max(self.fitted.values(), key=lambda fit: fit.max_error_db)


def judge_prefilters(display: Display) -> Prefilters:
    """Judge the paper's F on its own motor, and a prefilter of the same order fitted to H/T for every channel."""
    index = display.channels[0]
    c = discretise(paper.FEEDBACK, display.rate_hz, "bilinear")
    plant = sampled_loop(display, index).plant
    sampled = TwoDegreeLoop(discretise(paper.PREFILTER, display.rate_hz, "bilinear"), c, plant)
    fitted = {
        channel.name: fit_prefilter(channel, c, display.rate_hz, display.delay_samples, poles=paper.PREFILTER_POLES)
        for channel in display.channels
    }
    printed = TwoDegreeLoop(paper.PREFILTER, paper.FEEDBACK, paper.PLANT)
    return Prefilters(_judged(index, printed), _judged(index, sampled), fitted)


def _judged(channel: Channel, loop: TwoDegreeLoop) -> Judged:
    """Return the error with 0 dB put at the curve's level at its lowest frequency."""
    curve = channel.threshold.curve
    low, high = channel.threshold.band_hz
    tabled = curve.frequency_hz[(curve.frequency_hz >= low) & (curve.frequency_hz <= high)]
    even = np.geomspace(low, high, 1200)
    frequency = np.unique(np.append(even, tabled))
    wanted = curve.level_db_re_1um_at(frequency) - curve.level_db_re_1um_at(curve.frequency_hz[0])
    error = db(np.abs(loop.position_response(frequency))) - wanted
    rms = float(np.sqrt(np.mean(error[np.isin(frequency, even)] ** 2)))
    return Judged(paper.PREFILTER_POLES, float(np.max(np.abs(error))), rms, frequency, error)


RATES_HZ = (4000.0, 8000.0, 16000.0, 32000.0)


def bits_needed() -> Needed:
    """Return the bits for the paper's F, and for its C in the loop with one sample of delay."""
    f: dict[str, dict[float, BitsNeeded]] = {form: {} for form in FORMS}
    c: dict[str, dict[float, BitsNeeded]] = {form: {} for form in FORMS if form != "direct"}
    for rate_hz in RATES_HZ:
        late = SampledSystem(np.empty(0), np.empty(0), 1.0, rate_hz, 1)
        plant = discretise(paper.PLANT, rate_hz, "zoh") * late
        for form in FORMS:
            f[form][rate_hz] = filter_bits(discretise(paper.PREFILTER, rate_hz, "bilinear"), form)
            if form in c:
                c[form][rate_hz] = loop_bits(discretise(paper.FEEDBACK, rate_hz, "bilinear"), plant, form)
    return {"prefilter F": f, "feedback C": c}


@dataclass(frozen=True)
class PaperLoop:
    """The loop of the paper's equations and the loop as it runs, with the margins of each."""

    continuous: FeedbackLoop
    continuous_margins: Margins
    sampled: FeedbackLoop
    sampled_margins: Margins


def paper_loop(display: Display) -> PaperLoop:
    """Return the loops as the paper prints them and as they run: bilinear C, held P, the computing delay."""
    continuous = FeedbackLoop(paper.FEEDBACK, paper.PLANT)
    sampled = sampled_loop(display, display.channels[0])
    return PaperLoop(continuous, margins(continuous), sampled, margins(sampled))


def sampled_loop(display: Display, channel: Channel) -> FeedbackLoop:
    """Return the paper's C on one of the display's channels, as it runs."""
    plant = discretise(channel.plant, display.rate_hz, "zoh", display.delay_samples)
    return FeedbackLoop(discretise(paper.FEEDBACK, display.rate_hz, "bilinear"), plant)


@dataclass(frozen=True)
class Spoken:
    """Speech on the display. file: what was presented; report: felt against asked; limiting: of each finger."""

    file: SpeechFile
    report: FeltReport
    limiting: tuple[FingerLimiting, ...]


def check_speech(plan: Plan) -> SpeechFile:
    """Return the plan's speech file, read through. Raises BadInput if it cannot be used: call it first."""
    return scan_speech(sample_path() if plan.speech is None else plan.speech)


def speak(plan: Plan, controller: ControllerResult, file: SpeechFile, progress: Progress) -> Spoken:
    """Play the file coded `direct` at LEVEL_DB_SL on all simulated channels; measure at the finger ports."""
    with TemporaryDirectory() as folder:
        out, felt = (Path(folder) / f"{name}.wav" for name in ("reference", "felt"))
        spoken = tt.render(file.path, controller, out, felt=felt, seed=plan.seed_of("speech"))
    assert isinstance(spoken, RenderResult)
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
        """Return the level felt minus the level asked, dB."""
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
        assert isinstance(result, MeasuredResponses)
        for measured in result.responses:
            hertz = measured.frequency_hz
            expected = np.abs(controller.response(measured.channel, hertz)) * from_db(level)
            target = controller.display.channel(measured.channel).threshold_voltage(hertz) * from_db(level)
            columns = (hertz, expected, target, measured.magnitude_v, measured.confidence_db, measured.saturated)
            rows = zip(*(column.tolist() for column in columns), strict=True)
            points += [ResponsePoint(measured.channel, load, level, *row) for row in rows]
        progress("response", (index + 1) / len(runs))
    return tuple(points)


def worst_error_db(points: tuple[ResponsePoint, ...], load: str, level_db_sl: float) -> float:
    """Return the greatest |felt minus asked|, dB, of a load and level over all channels, saturated points left out."""
    errors = [
        abs(point.error_db)
        for point in points
        if (point.load, point.level_db_sl, point.saturated) == (load, level_db_sl, False)
    ]
    return max(errors)
