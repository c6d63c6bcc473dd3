"""The level of a response: asked, measured, and predicted by the controller's own model; objective i judged by it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.measure.options import MeasurementOptions
from tactuator.measure.response import stepped_sine, swept_responses
from tactuator.model.controller import Controller
from tactuator.model.description import Channel, Display, Environment
from tactuator.model.plant import DERIVATIVES
from tactuator.model.plausibility import doubtful
from tactuator.model.verdict import LEVEL_ERROR, Finding, Outcome, Verdict, compared, in_jnd, verdict_of
from tactuator.perception.curve import AMPLITUDE_JND_DB
from tactuator.rig.rig import Rig
from tactuator.signals.decibels import db, from_db
from tactuator.signals.discretise import discretise
from tactuator.signals.loop import TwoDegreeLoop
from tactuator.signals.multisine import Multisine
from tactuator.signals.record import Response
from tactuator.synthesis.design import headroom
from tactuator.synthesis.felt import friction_loss_db, gain_beside_hum
from tactuator.synthesis.touch import adapted_response


@dataclass(frozen=True)
class ChannelPrediction:
    """One channel under a controller, touched by the load of that name (None: untouched)."""

    channel: Channel
    loop: TwoDegreeLoop

    @classmethod
    @lru_cache(maxsize=16)  # one is asked for in every trial
    def of(cls, controller: Controller, name: str, load: str | None = None) -> ChannelPrediction:
        """Return the prediction for a channel of `controller`. Raises BadInput for an unknown channel or load."""
        channel, designed = controller.display.channel(name), controller.channel(name)
        rate = controller.rate_hz
        loaded = channel.loaded_plant(None if load is None else channel.load(load))
        plant = discretise(loaded, rate, "zoh", controller.delay_samples)
        return cls(channel, TwoDegreeLoop(designed.prefilter(rate), designed.feedback(rate), plant))

    def command(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return the volts of command per threshold unit (the computing delay not counted)."""
        return self.loop.command_response(_off_rest(frequency_hz))

    def displacement(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return the millimetres at the finger per threshold unit."""
        frequency = _off_rest(frequency_hz)
        speed = (2j * np.pi * frequency) ** DERIVATIVES[self.channel.quantity]
        return np.asarray(self.loop.moved_response(frequency) / self.channel.sensor_gain_v_per_mm / speed)

    def felt(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return the felt amplitude (threshold units) per threshold unit asked: 1 where the design is exact.

        The threshold curve's weight has zero phase: the phase is that of the displacement.
        """
        return self.displacement(frequency_hz) / self.channel.threshold.curve.displacement_mm(frequency_hz)


def _off_rest(frequency_hz: ArrayLike) -> NDArray[np.float64]:
    """Return the frequencies with a microhertz in the place of zero, where an integrator's response is infinite over
    infinite.
    """
    return np.maximum(np.asarray(frequency_hz, dtype=np.float64), 1e-6)


def level_within_limits(
    controller: Controller, names: Sequence[str], frequency_hz: FloatArray, level_db_sl: float, played: Multisine | None
) -> float:
    """Return level_db_sl, or what of it stays within comfort, command and travel by the controller's model, in tenths
    of a dB. Tones at frequency_hz (n,) are played one by one, or `played` is, all of whose lines have level_db_sl.
    """
    hertz, most = frequency_hz if played is None else played.frequency_hz, 0.0
    for name in names:
        prediction = ChannelPrediction.of(controller, name)
        channel, ones = prediction.channel, np.ones(hertz.size)
        shares = (
            ones / from_db(controller.display.objectives.comfort_db_sl),
            prediction.command(hertz) / controller.channel(name).limits.command_v,
            prediction.displacement(hertz) / channel.travel_mm,
        )
        for share in shares:
            if played is None:
                peak = from_db(level_db_sl) * np.max(np.abs(share))
            else:
                amplitude, phase = played.amplitude * np.abs(share), played.phase_rad + np.angle(share)
                peak = np.max(np.abs(replace(played, amplitude=amplitude, phase_rad=phase).one_period()))
            most = max(most, float(peak))
    # share of a limit that a level chosen here takes: what the model leaves out has the rest
    beyond_db = float(db(most / 0.9))
    return level_db_sl if beyond_db <= 0.0 else float(np.floor(10.0 * (level_db_sl - beyond_db))) / 10.0


_REMEDY = "where `check` calls i met, a new model (identify) and a design for it; else more poles in [prefilter]"


def asked_v(response: Response, display: Display) -> FloatArray:
    """Return the peak volts at the sensor that the response asked for, (m,): the reference above threshold, or what the
    contours of its channel make of the level.
    """
    channel = display.channel(response.channel)
    beyond = channel.strength.asked_db_sl(response.level_db_sl, response.frequency_hz) - response.level_db_sl
    return np.asarray(response.reference * channel.threshold_voltage(response.frequency_hz) * from_db(beyond))


def error_db(response: Response, display: Display) -> FloatArray:
    """Return the sensation level measured minus the level asked, dB, (m,)."""
    return db(response.magnitude_v / asked_v(response, display))


def expected_v(response: Response, controller: Controller) -> FloatArray:
    """Return the peak volts at the sensor that the controller's own model expects of each point, (m,): the shipped
    sections on the nominal plant under the response's load, with the weights nearest to it where they are learnt.
    """
    load = None if response.load == "none" else response.load
    answer = expected_response(controller, response.channel, load, response.frequency_hz)
    return np.asarray(_reshaped(response, controller) * np.abs(answer))


DITHERED, _BLIND = 0.6, 1e-3
"""Noise, in steps of the A/D, from which on a reading follows all that moves; share of a motion that nobody reads."""


def images_db(display: Display, name: str, frequency_hz: FloatArray) -> FloatArray:
    """Return by how much, dB, (m,), images of the held command change what the sensor of a channel reads: of an
    accelerometer, which nothing filters ahead of its A/D for all we know. Sound cards have such filters.
    """
    plant = discretise(display.channel(name).plant, display.rate_hz, "zoh", display.delay_samples)
    if plant.held is None or display.sound is not None:
        return np.zeros(frequency_hz.shape)
    return np.abs(db(plant.response(frequency_hz) / plant.moved_response(frequency_hz)))


def reading_doubt_db(
    controller: Controller,
    name: str,
    frequency_hz: FloatArray,
    amplitude_v: FloatArray,
    beside_v_rms: FloatArray | float = 0.0,
) -> FloatArray:
    """Return by how much, dB, (m,), images, and the steps of the A/D, may change the reading of sinusoids of these peak
    volts at the sensor, wherever it rests between two codes; beside_v_rms: of what moves beside each.
    """
    channel = controller.display.channel(name)
    step_v, environment = channel.converter.step_v, channel.environment
    noise_v = np.broadcast_to(np.hypot(environment.noise_v_rms, beside_v_rms), amplitude_v.shape)
    doubt, coarse = images_db(controller.display, name, frequency_hz), noise_v < DITHERED * step_v
    if np.any(coarse):
        feedback = ChannelPrediction.of(controller, name).loop.feedback
        sensitivity = None if feedback is None else feedback.sensitivity
        for at in np.flatnonzero(coarse):
            read = gain_beside_hum(channel, amplitude_v[at : at + 1], float(noise_v[at]), sensitivity)
            doubt[at] += np.max(np.abs(db(np.maximum(read, _BLIND))))
    return doubt


def as_read(response: Response, controller: Controller, confidence_db: float) -> Response:
    """Return the response with what images and the A/D's steps leave unknown in its confidence, and whether it still
    has `confidence_db`. The lines of a multisine move the sensor for each other.
    """
    peak_v = expected_v(response, controller)
    power = 0.5 * peak_v**2
    beside = np.sqrt(np.sum(power) - power) if response.method == "multisine" else 0.0
    doubt = reading_doubt_db(controller, response.channel, response.frequency_hz, peak_v, beside)
    if not np.any(doubt):
        return response
    confidence = response.confidence_db + doubt
    return replace(response, confidence_db=confidence, reached=confidence <= confidence_db)


_PLACES, _NEAR = 3, 0.03
"""Tones that are played between points for a channel, at most; relative distance within which one represents others."""


def with_tones(
    rig: Rig, controller: Controller, responses: Sequence[Response], asked: MeasurementOptions, rng: np.random.Generator
) -> tuple[Response, ...]:
    """Return responses, as they were read, with the tones that it took to judge them: where a sweep of the band passes
    what is allowed between the points; and, beside a multisine, where friction takes most of a tone alone.
    """
    display = controller.display
    loops = {each.channel: ChannelPrediction.of(controller, each.channel).loop for each in responses}

    def reach_db_sl(hertz: FloatArray) -> FloatArray:
        most = display.objectives.comfort_db_sl
        rooms = [headroom(display.channel(name), loop, hertz, most).level_db_sl for name, loop in loops.items()]
        return np.asarray(np.min(rooms, axis=0))

    places: set[float] = set()
    for response, swept in zip(responses, swept_responses(rig, asked, reach_db_sl, rng), strict=True):
        places.update(_worst_hz(swept, display))
        if response.method == "multisine":
            places.add(float(response.frequency_hz[np.argmax(_rubbed(response, controller))]))
    if not places:
        return tuple(responses)
    tones = [as_read(each, controller, asked.confidence_db) for each in stepped_sine(rig, sorted(places), asked)]
    return tuple(_joined(*pair, controller) for pair in zip(responses, tones, strict=True))


def _worst_hz(swept: Response, display: Display) -> list[float]:
    """Return the lines of a sweep, hertz, that represent those with a certain error which may exceed the tolerance."""
    error = np.abs(error_db(swept, display))
    passes = (error > display.objectives.flatness_db) & (swept.confidence_db < error) & ~np.any(swept.saturated)
    chosen: list[float] = []
    for hertz in swept.frequency_hz[passes][np.argsort(-error[passes])].tolist():
        if len(chosen) < _PLACES and not any(abs(hertz / other - 1.0) < _NEAR for other in chosen):
            chosen.append(hertz)
    return chosen


def _rubbed(response: Response, controller: Controller) -> FloatArray:
    """Return the root of friction's loss of a tone alone over the greatest, by the model; of 4 mV if none is stated."""
    prediction = ChannelPrediction.of(controller, response.channel)
    channel, usual = prediction.channel, prediction.channel.environment
    least = replace(usual, friction_v=usual.friction_v or Environment.friction_v)
    with_friction = replace(channel, environment=least)
    loss = friction_loss_db(with_friction, prediction.loop, response.frequency_hz, response.level_db_sl)
    return np.sqrt(np.abs(loss) / max(float(np.max(np.abs(loss))), 1e-12))


def _joined(response: Response, tones: Response, controller: Controller) -> Response:
    """Return a response with tones among its points or in their places. By how much a tone surely differs from a
    multisine's line in its place is in the confidence of every line, as friction has its share there.
    """
    _, lines, alone = np.intersect1d(response.frequency_hz, tones.frequency_hz, return_indices=True)
    doubt = response.confidence_db[lines] + tones.confidence_db[alone]
    ratio = tones.magnitude_v[alone] / np.maximum(response.magnitude_v[lines], 1e-300)
    apart = np.max(np.abs(db(ratio))[doubt < np.inf] - doubt[doubt < np.inf], initial=0.0)
    doubtful_db = apart * _rubbed(response, controller) if apart > 0.0 else 0.0
    kept = ~np.isin(response.frequency_hz, tones.frequency_hz)
    order = np.argsort(np.append(response.frequency_hz[kept], tones.frequency_hz))
    joined: dict[str, Any] = {
        name: np.append(value[kept], getattr(tones, name))[order]
        for name, value in vars(replace(response, confidence_db=response.confidence_db + doubtful_db)).items()
        if isinstance(value, np.ndarray)
    }
    return replace(response, **joined)


def _reshaped(response: Response, controller: Controller) -> FloatArray:
    """Return the amplitude of what the prefilter gets, threshold units, (m,): the reference, reshaped where it is."""
    strength = controller.channel(response.channel).strength
    reference = np.broadcast_to(response.reference, response.frequency_hz.shape)
    if strength is None:
        return np.asarray(reference)
    return np.asarray(
        reference * np.abs(strength.response(response.level_db_sl, response.frequency_hz, controller.rate_hz))
    )


def expected_response(controller: Controller, name: str, load: str | None, frequency_hz: FloatArray) -> ComplexArray:
    """Return the volts of y per threshold unit that the model expects of a channel under a load (None: free), (m,)."""
    touched = ChannelPrediction.of(controller, name, load)
    adaptive = controller.channel(name).feed_forward
    if adaptive is None or load is None:
        return touched.loop.position_response(frequency_hz)
    free, weight = ChannelPrediction.of(controller, name).loop, touched.channel.load(load)
    return adapted_response(adaptive, free, touched.loop, weight, frequency_hz, controller.display.rate_hz)


@dataclass(frozen=True, eq=False)
class ResponseLevels:
    """Levels of a response at each of its frequencies, dB SL, (m,): asked for; felt, by the sensor; and predicted by
    the controller's own model, under the response's load and without one. The error is felt minus requested level; the
    part that the model explains, by prefilter and by load, is given beside it.
    """

    asked_db_sl: FloatArray
    felt_db_sl: FloatArray
    predicted_db_sl: FloatArray
    predicted_free_db_sl: FloatArray

    @classmethod
    def of(cls, response: Response, controller: Controller) -> ResponseLevels:
        """Return the levels of a response that was measured under `controller`."""
        threshold_v = controller.display.channel(response.channel).threshold_voltage(response.frequency_hz)
        asked = controller.display.channel(response.channel).strength.asked_db_sl(
            response.level_db_sl, response.frequency_hz
        )
        free = expected_response(controller, response.channel, None, response.frequency_hz)
        free_v = _reshaped(response, controller) * np.abs(free)
        predicted = [db(volts / threshold_v) for volts in (expected_v(response, controller), free_v)]
        return cls(asked, asked + error_db(response, controller.display), *predicted)

    @property
    def error_db(self) -> FloatArray:
        """Return the level felt minus the level asked, dB."""
        return self.felt_db_sl - self.asked_db_sl

    @property
    def error_jnd(self) -> FloatArray:
        """Return the error's size in just-noticeable differences of amplitude."""
        return np.abs(self.error_db) / AMPLITUDE_JND_DB

    @property
    def worst_first(self) -> list[int]:
        """Return the places of the points, the one with the greatest error first."""
        places: list[int] = np.argsort(-np.abs(self.error_db), kind="stable").tolist()
        return places

    @property
    def model_db(self) -> FloatArray:
        """Return the part of the error that the model expects, dB: predicted less asked."""
        return self.predicted_db_sl - self.asked_db_sl

    @property
    def prefilter_db(self) -> FloatArray:
        """Return the part of the error that the prefilter leaves by design, dB: predicted without a load less asked."""
        return self.predicted_free_db_sl - self.asked_db_sl

    @property
    def load_db(self) -> FloatArray:
        """Return the part of the error that the load makes by the model, dB: predicted under it minus without it."""
        return self.predicted_db_sl - self.predicted_free_db_sl

    @property
    def unpredicted_db(self) -> FloatArray:
        """Return the part of the error that the model does not expect, dB: felt minus predicted. It is of friction, of
        noise, and of a plant or a load that is another than the model's.
        """
        return self.felt_db_sl - self.predicted_db_sl


def response_verdict(responses: Sequence[Response], display: Display) -> Verdict:
    """Return the verdict on objective i of every response: not met where the error passes flatness_db by more than its
    confidence, not judged where the confidence leaves it open, a limit was reached, or a load was on."""
    findings = [*(_finding(response, display) for response in responses), *doubtful(display)]
    return verdict_of(findings, channels=display.channels)


def _finding(response: Response, display: Display) -> Finding:
    """Return the finding on the point that decides: one that surely passes what is allowed before one that may."""
    signed_db, allowed = error_db(response, display), display.objectives.flatness_db
    error = np.abs(signed_db)
    doubt = response.confidence_db
    surely, perhaps = error > allowed + doubt, error + doubt > allowed
    deciding = surely if np.any(surely) else perhaps if np.any(perhaps) else np.ones(error.shape, dtype=bool)
    worst = int(np.argmax(np.where(deciding, error, -np.inf)))
    value, at = float(error[worst]), float(response.frequency_hz[worst])
    finding = unread(compared("i", response.channel, response.load, LEVEL_ERROR, value, allowed, "dB", at))
    finding = replace(finding, side=float(np.sign(signed_db[worst])))
    if response.load != "none":
        remark = "for information only: objective iv judges what a load changes"
        return replace(finding, outcome=Outcome.NOT_JUDGED, remark=remark, counts=False)
    if finding.value is None:
        return finding
    beside = f"{in_jnd(value)}; confidence {doubt[worst]:.2g} dB"
    if bool(np.any(response.saturated)):
        limited = response.frequency_hz[response.saturated]
        more = f" and {limited.size - 1} more" if limited.size > 1 else ""
        words = "a limit (command, converter or travel_mm) was reached"
        remark = f"{beside}; {words} at {limited.min():.4g} Hz{more}: a lower level"
        return replace(finding, outcome=Outcome.NOT_JUDGED, remark=remark)
    if np.any(perhaps) and not np.any(surely):
        tones = "`method` stepped, as friction takes more of a tone alone; " if response.method == "multisine" else ""
        remedy = "a smaller `confidence_db`, or a higher level if converters are coarse"
        if (images := images_db(display, response.channel, response.frequency_hz)[worst]) > 0.5 * doubt[worst]:
            remedy = f"images of the command change what the sensor reads by {images:.2g} dB: a higher rate_hz"
        return replace(finding, outcome=Outcome.NOT_JUDGED, remark=f"{beside} leaves it open: {tones}{remedy}")
    return replace(finding, remark=f"{beside}; {_REMEDY}" if finding.outcome is Outcome.NOT_MET else beside)


def unread(finding: Finding) -> Finding:
    """Return a finding, not judged where the sensor read nothing at all."""
    if finding.value is None or np.isfinite(finding.value):
        return finding
    remark = "the sensor reads nothing, less than a step of the A/D: finer steps, or a higher level of what is played"
    return replace(finding, outcome=Outcome.NOT_JUDGED, value=None, remark=remark)
