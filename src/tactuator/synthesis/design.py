"""Design of a display's controller: loop, prefilter, anti-windup, limits and the report, channel by channel."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice, takewhile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactuator import __version__
from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput, NoDesign
from tactuator.model.controller import AntiWindup, ChannelController, Controller, FeedForward, Limits, StrengthShaping
from tactuator.model.description import Channel, Display
from tactuator.model.plant import DERIVATIVES
from tactuator.model.plausibility import channel_reasons
from tactuator.perception.curve import COMFORT_DB_SL
from tactuator.processors import single_threaded
from tactuator.signals.decibels import db
from tactuator.signals.discretise import discretise
from tactuator.signals.loop import TwoDegreeLoop
from tactuator.signals.spectra import third_octave_bands
from tactuator.signals.systems import ContinuousSystem, SampledSystem
from tactuator.synthesis import paper
from tactuator.synthesis.assessment import MemberAssessment, assess, loop_report
from tactuator.synthesis.family import Member, fit_words, plant_family
from tactuator.synthesis.limits import Task
from tactuator.synthesis.loop_synthesis import diagnosis, require_consistent, synthesise
from tactuator.synthesis.prefilter import PrefilterFit, fit_prefilter
from tactuator.synthesis.sections import anti_windup, feedback_sections
from tactuator.synthesis.strength import fit_strength
from tactuator.synthesis.touch import design_feed_forward, fed_response, require_adaptive

_SERVES, _GOOD = 0.75, 1.95
"""Error of a prefilter over the flatness allowed: of one that serves, and, times its poles, of a good one."""
_NEAR_DB = 1.5
"""Mean |S|, dB, beyond the best loop's, from which on no further loop is tried if one serves."""
_ALIKE = 0.3
"""Difference of roots, as a share of their size, up to which the loop of one plant leads to that of the other."""
_AS_GOOD = 1.1
"""Prefilter error, over that of the channel that a search started from, up to which no better loop is looked for."""
_TOWARDS_TOUCHED = 0.75
"""Share of what is not fed forward that the prefilter gives beforehand. At 20 dB SL the touched display varies more."""
_RAISED_MAX_DB = 0.4
"""The most that the free display gives away for a touched one: a load beyond what can be fed forward takes far more."""


def design_controller(display: Display, poles: int | None = None, error_db: float | None = None) -> Controller:
    """Design the controller of a display, every channel to its own requirements.

    poles: of every prefilter, in place of the file's. error_db: choose for each prefilter the fewest poles that keep
    this error instead.

    Raises BadInput for a plant that cannot be controlled or requirements that contradict each other, NoDesign where
    the search finds no loop: the message says which requirements bind, and what would be possible.
    """
    designed: dict[str, ChannelController] = {}
    for channel in display.channels:
        first = first_alike(display, channel)
        former = None if first is None else designed[first.name]
        try:
            designed[channel.name] = design_channel(display, channel, poles, error_db, former)
        except (BadInput, NoDesign) as error:
            for reason in channel_reasons(channel, display.rate_hz):
                error.add_note(f"likely why: {reason}")
            raise
    return Controller(display, tuple(designed.values()), __version__)


def first_alike(display: Display, channel: Channel) -> Channel | None:
    """Return the first channel before `channel` with the same requirements of its loop, as many loads and models, and
    roots of the plant that differ by less than _ALIKE, or None.
    """

    def asked(of: Channel) -> tuple[object, ...]:
        return of.feedback, len(of.loads), len(of.family), of.plant.zeros.size, of.plant.poles.size

    def is_near(other: Channel) -> bool:
        both = (np.append(np.sort_complex(of.plant.zeros), np.sort_complex(of.plant.poles)) for of in (channel, other))
        own, theirs = both
        return bool(np.all(np.abs(own - theirs) <= _ALIKE * np.abs(theirs)))

    before = takewhile(lambda other: other.name != channel.name, display.channels)
    return next((other for other in before if asked(other) == asked(channel) and is_near(other)), None)


def design_channel(
    display: Display,
    channel: Channel,
    poles: int | None = None,
    error_db: float | None = None,
    former: ChannelController | None = None,
) -> ChannelController:
    """Design the controller of one channel of `display`; former: that of the `first_alike`, if any.

    Of the loops that keep every requirement, in the order of their mean |S|, the first is taken whose prefilter is
    good for its number of poles (1.95/poles of the flatness objective, or error_db); otherwise the one with the best
    prefilter among those within 1.5 dB of the least mean, as long as that prefilter serves.
    """
    with single_threaded():  # sums that BLAS splits over threads round differently
        return _designed(display, channel, poles, error_db, former)


def _designed(
    display: Display, channel: Channel, poles: int | None, error_db: float | None, former: ChannelController | None
) -> ChannelController:
    require_suitable(channel, display.rate_hz)
    if display.touch.adaptive:
        require_adaptive(display, channel, is_looped=channel.feedback.structure != "none")
    if poles is not None and error_db is not None:
        raise BadInput(f"poles {poles} and an error of {error_db:g} dB are both asked for", "one of them")
    family = plant_family(channel, display.rate_hz, display.delay_samples)
    count = poles if poles is not None else None if error_db is not None else channel.prefilter.poles
    serves = _SERVES * display.objectives.flatness_db if error_db is None else error_db
    good = serves if count is None else _GOOD / count * display.objectives.flatness_db
    near = None
    if former is not None:
        # the same loop around this plant: its gain counts at the crossover, beyond the poles
        near, gain = former.feedback(display.rate_hz), display.channel(former.name).plant.gain / channel.plant.gain
        near = None if near is None else replace(near, gain=near.gain * gain)
        good = max(good, _AS_GOOD * former.report["prefilter"]["max_error_db"])
    designs: list[tuple[PrefilterFit, SampledSystem | None]] = []
    least = -np.inf
    failed: BadInput | None = None

    def is_served() -> bool:
        return any(fit.max_error_db <= serves for fit, _ in designs)

    peak = display.objectives.resonance_peak
    candidates = feedback_candidates(channel, display.rate_hz, family, peak, near)
    # loops for which a prefilter is fitted, at most
    for mean_db, feedback in islice(candidates, 12):
        least = mean_db if not designs else least
        if mean_db > least + _NEAR_DB and is_served():
            break
        try:
            fit = fit_prefilter(channel, feedback, display.rate_hz, display.delay_samples, count, serves)
        except BadInput as error:
            failed = error
            continue
        designs.append((fit, feedback))
        if fit.max_error_db <= good:
            break
    if not designs:
        assert failed is not None
        raise failed
    fit, feedback = min(designs, key=lambda design: (design[0].poles, design[0].max_error_db))
    return assemble(display, channel, feedback, fit, family)


def feedback_candidates(
    channel: Channel,
    rate_hz: float,
    family: tuple[Member, ...],
    resonance_peak: float,
    near: SampledSystem | None = None,
) -> Iterator[tuple[float, SampledSystem | None]]:
    """Yield each C that the channel's structure asks for: synthesised (the best first, with the mean |S| in dB), given
    (bilinear), or none.
    """
    requirements = channel.feedback
    if requirements.structure == "none":
        yield 0.0, None
    elif requirements.structure == "paper":
        yield 0.0, discretise(requirements.controller or paper.FEEDBACK, rate_hz, "bilinear")
    else:
        require_consistent(channel, rate_hz, resonance_peak)
        task = Task.of(family, requirements, rate_hz, resonance_peak)
        candidates = synthesise(task, near)
        best = next(candidates, None)
        if best is None:
            refusal = NoDesign(f"channel {channel.name!r}: the search, which is local, found no loop within the limits")
            for note in filter(None, (channel.unknown_words, *diagnosis(task))):
                refusal.add_note(note)
            raise refusal
        yield best
        yield from candidates


def assemble(
    display: Display,
    channel: Channel,
    feedback: SampledSystem | None,
    fit: PrefilterFit,
    family: tuple[Member, ...] | None = None,
) -> ChannelController:
    """Return a channel's controller from a feedback controller (or none) and a prefilter, with its report.

    On an adaptive display the prefilter is fitted anew, with as many poles, so that it gives beforehand part of what a
    finger still takes.

    Raises UnstableLoop if the loop is unstable on any plant of the channel's family.
    """
    members = family or plant_family(channel, display.rate_hz, display.delay_samples)
    sections, gains = None, AntiWindup()
    assessments: tuple[MemberAssessment, ...] = ()
    if feedback is not None:
        sections = feedback_sections(feedback)
        feedback = SampledSystem.from_sections(sections, display.rate_hz)
        assessments = assess(feedback, members, channel.feedback.rejection_band_hz)
        gains = anti_windup(sections, assessments[0].margins.crossover_hz, display.rate_hz)
    prefilter = SampledSystem.from_sections(fit.sections, display.rate_hz)
    nominal = TwoDegreeLoop(prefilter, feedback, members[0].sampled)
    fed = None
    if display.touch.adaptive:
        fed = design_feed_forward(display, channel, nominal)
        raised_db = partial(_still_taken_db, channel, fed, nominal, members)
        fit = fit_prefilter(channel, feedback, display.rate_hz, display.delay_samples, fit.poles, raised_db=raised_db)
        nominal = replace(nominal, prefilter=SampledSystem.from_sections(fit.sections, display.rate_hz))
        fed = design_feed_forward(display, channel, nominal)
    at_rest = np.abs(nominal.position_response(channel.threshold.band_hz[0] * 1e-6))  # far below the band, never zero
    travel_v = channel.travel_mm * channel.sensor_gain_v_per_mm
    shaping = fit_strength(channel, display.rate_hz, display.objectives.flatness_db)
    return ChannelController(
        name=channel.name,
        threshold_voltage_dc=max(float(at_rest), np.finfo(float).tiny),
        prefilter_sos=fit.sections,
        feedback_sos=sections,
        anti_windup=gains,
        limits=Limits(channel.converter.range_v, travel_v, display.objectives.comfort_db_sl),
        designed_for=tuple(member.name for member in members),
        report=_report(display, channel, nominal, fit, assessments, members, fed, shaping),
        feed_forward=fed,
        strength=shaping,
    )


def _loaded(
    channel: Channel, fed: FeedForward | None, free: TwoDegreeLoop, members: Sequence[Member], frequency_hz: FloatArray
) -> Iterator[tuple[str, TwoDegreeLoop, ComplexArray | None]]:
    """Yield for each load on the nominal plant: its name, the loop under it, and H where it is fed forward, (n,)."""
    for member in members[1:]:
        if member.model == 0:
            loop = replace(free, plant=member.sampled)
            rate_hz = member.sampled.rate_hz
            yield member.name, loop, fed_response(fed, channel, free, loop, member.load, frequency_hz, rate_hz)


def _still_taken_db(
    channel: Channel, fed: FeedForward, free: TwoDegreeLoop, members: Sequence[Member], frequency_hz: FloatArray
) -> FloatArray:
    """Return _TOWARDS_TOUCHED of what the channel's loads take of the level, in the mean, although they are fed
    forward: part of their mass is not. Never more than _RAISED_MAX_DB.
    """
    response = free.position_response(frequency_hz)
    touched = [answer for _, _, answer in _loaded(channel, fed, free, members, frequency_hz) if answer is not None]
    taken_db = [db(np.abs(response / answer)) for answer in touched] or [np.zeros_like(frequency_hz)]
    return np.asarray(np.clip(_TOWARDS_TOUCHED * np.mean(taken_db, axis=0), -_RAISED_MAX_DB, _RAISED_MAX_DB))


BINDING = ("travel", "command", "comfort")
_LEVEL_STEP_DB = 0.05
"""Step of the levels of a reference that are tried."""


@dataclass(frozen=True)
class Headroom:
    """At frequency_hz (n,): the greatest sinusoidal reference in dB SL, and which limit stops it."""

    frequency_hz: FloatArray
    level_db_sl: FloatArray
    binding: tuple[str, ...]

    def document(self) -> dict[str, Any]:
        """Return the headroom as in controller.json."""
        return {
            "frequency_hz": self.frequency_hz.tolist(),
            "level": self.level_db_sl.tolist(),
            "binding": list(self.binding),
        }

    def before(self, shaping: StrengthShaping | None, rate_hz: float) -> Headroom:
        """Return the headroom of the reference that comes in: no level up to it is reshaped to more than this one."""
        if shaping is None:
            return self
        asked = np.arange(0.0, COMFORT_DB_SL + 1.5 * _LEVEL_STEP_DB, _LEVEL_STEP_DB)
        raised = np.array([db(np.abs(shaping.response(level, self.frequency_hz, rate_hz))) for level in asked])
        over = asked[:, None] + raised > self.level_db_sl
        first = np.where(over.any(axis=0), np.argmax(over, axis=0), asked.size - 1)
        low = self.level_db_sl - raised[0]
        return replace(self, level_db_sl=np.where(first > 0, asked[first] - _LEVEL_STEP_DB, low))


def headroom(
    channel: Channel,
    loop: TwoDegreeLoop,
    frequency_hz: FloatArray,
    comfort_db_sl: float,
    answer: ComplexArray | None = None,
) -> Headroom:
    """Return the headroom of the channel's loop at `frequency_hz` (hertz, shape (n,)), for one sinusoid at a time.

    travel: displacement at +/- travel_mm. command: the command at the converter's range less the motor's offset.
    comfort: comfort_db_sl, asked for or felt, whichever comes first. answer: H where something is fed forward besides,
    (n,); the command is then what moves the loop's plant so far.
    """
    moved = loop.moved_response(frequency_hz) if answer is None else answer
    position = np.abs(moved)
    speed = (2.0 * np.pi * frequency_hz) ** DERIVATIVES[channel.quantity]
    displacement_mm = position / channel.sensor_gain_v_per_mm / speed
    driven = loop.command_response(frequency_hz) if answer is None else moved / loop.plant.response(frequency_hz)
    command = np.abs(driven)
    room_v = channel.converter.range_v - abs(channel.converter.offset_v)
    felt_error = db(displacement_mm / channel.threshold.curve.displacement_mm(frequency_hz))
    comfortable = comfort_db_sl - np.maximum(felt_error, 0.0)  # where less is felt than asked, no more may be asked
    levels = np.vstack([db(channel.travel_mm / displacement_mm), db(room_v / command), comfortable])
    which = np.argmin(levels, axis=0)
    return Headroom(frequency_hz, levels[which, np.arange(which.size)], tuple(BINDING[i] for i in which))


def headroom_grid_hz(channel: Channel) -> NDArray[np.float64]:
    """Return the edges of the band and the third octaves between them."""
    low, high = channel.threshold.band_hz
    centres = [round(band.centre_hz, 6) for band in third_octave_bands(low, high)]
    return np.array(sorted({low, high, *(f for f in centres if low <= f <= high)}))


def _report(
    display: Display,
    channel: Channel,
    nominal: TwoDegreeLoop,
    fit: PrefilterFit,
    assessments: tuple[MemberAssessment, ...],
    members: tuple[Member, ...],
    fed: FeedForward | None,
    shaping: StrengthShaping | None,
) -> dict[str, Any]:
    grid, rate_hz = headroom_grid_hz(channel), display.rate_hz
    comfort = display.objectives.comfort_db_sl
    report: dict[str, Any] = loop_report(assessments, channel) if assessments else {}
    report["prefilter"] = {
        "poles": fit.poles,
        "max_error_db": fit.max_error_db,
        "rms_error_db": fit.rms_error_db,
        "worst_hz": fit.worst_hz,
    }
    report["headroom_db_sl"] = headroom(channel, nominal, grid, comfort).before(shaping, rate_hz).document()
    report["headroom_db_sl_loaded"] = {
        load: headroom(channel, loop, grid, comfort, answer).before(shaping, rate_hz).document()
        for load, loop, answer in _loaded(channel, fed, nominal, members, grid)
    }
    return report


def require_suitable(channel: Channel, rate_hz: float) -> None:
    """Raise BadInput if the channel's plant, or a model of its family, cannot be designed for at `rate_hz`.

    Whether a loop can be found for an unstable plant, or one with zeros right of the axis, is the synthesis's to say.
    """
    looped = channel.feedback.structure != "none"
    _require_known(channel, looped)
    if channel.recorded is not None and channel.recorded.distrust and np.any(channel.plant.poles.real > 0.0):
        raise BadInput(f"channel {channel.name!r}: the plant grows by itself", "that of a model that is to be trusted")
    for model, plant in enumerate((channel.plant, *channel.family)):
        where = f"channel {channel.name!r}: the plant{fit_words(channel, model)}"
        _require_sound(plant, where, looped)
        _require_below_nyquist(plant, where, rate_hz)
    if channel.feedback.structure == "integrator-lead-lag" and np.any(channel.plant.zeros == 0.0):
        got = f"channel {channel.name!r}: the plant gives nothing at rest (zero at s = 0): an integrator would run away"
        raise BadInput(got, 'structure = "none", or a plant of displacement')


def _require_known(channel: Channel, looped: bool) -> None:
    """Raise BadInput where a prefilter would equalise what nobody measured: without a loop all rests on the plant. The
    gain of a loop falls to one above the rejection band, and there at least it has to be known.
    """
    where = f"channel {channel.name!r}: {channel.unknown_words or channel.known_words}"
    edge_hz = channel.feedback.rejection_band_hz[1]
    if looped and not channel.is_known(edge_hz):
        raise BadInput(where, f"a model that is valid at {edge_hz:g} Hz, the rejection band's edge, and over band_hz")
    if not looped and channel.unknown_words:
        raise BadInput(f"{where}; allowed without a loop: a band within that")


def _require_sound(plant: ContinuousSystem, where: str, looped: bool) -> None:
    if not looped and not plant.is_stable:
        worst = plant.poles[np.argmax(plant.poles.real)]
        raise BadInput(
            f"{where} runs away without a loop (a pole at {worst:.4g} rad/s)",
            'every pole left of the axis, or structure = "integrator-lead-lag"',
        )
    at_low = plant.gain * float(np.real(np.prod(-plant.zeros[plant.zeros != 0.0])))
    at_low /= float(np.real(np.prod(-plant.poles[plant.poles != 0.0])))
    if looped and plant.is_stable and at_low < 0.0:
        raise BadInput(
            f"{where} has a negative gain at rest ({at_low:.4g})",
            "a positive one: by [converter] polarity = -1, and record again or negate one of the record's columns",
        )


def _require_below_nyquist(plant: ContinuousSystem, where: str, rate_hz: float) -> None:
    pairs = plant.poles[plant.poles.imag > 0.0]
    fastest_hz = float(np.max(np.abs(pairs), initial=0.0)) / (2.0 * np.pi)
    if fastest_hz >= 0.5 * rate_hz:
        raise BadInput(
            f"{where} has a pole pair at {fastest_hz:.4g} Hz, above half the rate",
            f"below {0.5 * rate_hz:g} Hz, or a higher rate_hz",
        )
