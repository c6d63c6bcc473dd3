"""Calibration of a display without loop: model, usable band, equaliser, and the felt level verified at the sensor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, NoDesign
from tactuator.measure.broadband import (
    Level,
    PlantEstimate,
    Recording,
    broadband,
    estimate_plant,
    find_level,
    plant_of_levels,
    record_wave,
)
from tactuator.measure.error import ChannelPrediction, error_db
from tactuator.measure.options import MeasurementOptions
from tactuator.measure.response import multisine_response
from tactuator.model.controller import Controller
from tactuator.model.description import Channel, Display
from tactuator.model.plant import DERIVATIVES
from tactuator.perception.curve import COMFORT_DB_SL
from tactuator.rig.rig import Rig, require_sensors
from tactuator.rig.sound.rig import SoundRig
from tactuator.signals.decibels import db, from_db
from tactuator.signals.systems import ContinuousSystem
from tactuator.synthesis.design import design_controller

RANGE_SHARE, TRAVEL_SHARE = 0.9, 0.9
"""What a tone in the usable band takes of command and travel: 0.9 dB are left for the model's error."""
_GRID = 600
"""Frequencies at which the reach is looked at: 1 % apart over 500 to 1."""


@dataclass(frozen=True, eq=False)
class UsableBand:
    """Band of one channel. band_hz: where `level_db_sl` can be reached; frequency_hz, reach_db_sl: (n,), the greatest
    level by command and travel; ends: what binds at either end: "asked", "command" or "travel".
    """

    band_hz: tuple[float, float]
    level_db_sl: float
    frequency_hz: FloatArray
    reach_db_sl: FloatArray
    ends: tuple[str, str]


def usable_band(
    channel: Channel, plant: ContinuousSystem, asked_hz: tuple[float, float], level_db_sl: float
) -> UsableBand:
    """Return the widest band (in octaves) within `asked_hz` in which a tone at level_db_sl needs at most 0.9 of the
    range and of the travel, by `plant`. Raises BadInput if it is narrower than half an octave.
    """
    frequency = np.geomspace(*asked_hz, _GRID)
    threshold_mm = channel.threshold.curve.displacement_mm(frequency)
    speed = (2.0 * np.pi * frequency) ** DERIVATIVES[channel.quantity]
    mm_for_volt = np.abs(plant.response(frequency)) / channel.sensor_gain_v_per_mm / speed
    by_command = db(RANGE_SHARE * channel.converter.range_v * mm_for_volt / threshold_mm)
    by_travel = db(TRAVEL_SHARE * channel.travel_mm / threshold_mm)
    reach = np.minimum(by_command, by_travel)
    enough = np.concatenate([[False], reach >= level_db_sl, [False]])
    edges = np.flatnonzero(enough[1:] != enough[:-1])
    stretches = [(first, last - 1) for first, last in list(pairwise(edges))[::2]]
    if not stretches:
        raise BadInput(
            f"channel {channel.name!r} reaches {float(np.max(reach)):.1f} dB SL at most",
            f"a lower level than {level_db_sl:g} dB SL, or more volts",
        )
    first, last = (int(index) for index in max(stretches, key=lambda ends: ends[1] - ends[0]))
    if frequency[last] < np.sqrt(2.0) * frequency[first]:
        raise BadInput(
            f"channel {channel.name!r} reaches {level_db_sl:g} dB SL from {frequency[first]:.4g} to "
            f"{frequency[last]:.4g} Hz only",
            "half an octave or more (a lower level, or more volts)",
        )

    def end(index: int, outermost: int) -> str:
        if index == outermost:
            return "asked"
        return "command" if by_command[index] <= by_travel[index] else "travel"

    ends = (end(first, 0), end(last, _GRID - 1))
    return UsableBand((float(frequency[first]), float(frequency[last])), level_db_sl, frequency, reach, ends)


_LINES, _CREST, _LIMIT_SHARE = 48, 3.5, 0.9
"""Lines over the band, a ninth of an octave apart from 10 to 400 Hz; peak of many over their rms; share of a limit."""


@dataclass(frozen=True, eq=False)
class Flatness:
    """Felt level minus the level asked, at lines over a band: frequency_hz ascending, error_db, confidence_db, (m,).
    limited: a line was played while something was cut.
    """

    frequency_hz: FloatArray
    error_db: FloatArray
    confidence_db: FloatArray
    limited: bool

    @property
    def worst_db(self) -> float:
        """Return the greatest error, dB, its sign kept."""
        return float(self.error_db[np.argmax(np.abs(self.error_db))])


def felt_flatness(
    rig: Rig, controller: Controller, name: str, request: CalibrationRequest, rng: np.random.Generator
) -> Flatness:
    """Measure the loaded controller's felt level over the channel's band: 48 lines and more about its resonances, each
    at the level asked, as many at a time as command, travel and comfort allow. A group that was cut after all is
    measured again in halves: its lines are up to 2 % off the requested ones, which matters at an antiresonance.
    """
    display = controller.display
    band_hz = display.channel(name).threshold.band_hz
    options = MeasurementOptions(
        request.level_db_sl, channels=[name], longest_s=request.longest_s, mains_hz=request.mains_hz, band_hz=band_hz
    )
    groups = _groups(controller, name, _lines(controller, name, band_hz), request.level_db_sl)
    parts = []
    while groups:
        group = groups.pop(0)
        (response,) = multisine_response(rig, group, options, rng, exactly=False)
        if group.size > 1 and np.any(response.saturated):
            groups += [group[::2], group[1::2]]
            continue
        parts.append((response.frequency_hz, error_db(response, display), response.confidence_db, response.saturated))
    frequency, error, confidence, limited = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(frequency, kind="stable")
    return Flatness(frequency[order], error[order], confidence[order], bool(np.any(limited)))


def _lines(controller: Controller, name: str, band_hz: tuple[float, float]) -> FloatArray:
    """Return frequencies over the band and about the plant's lightly damped roots, which lie between others."""
    low, high = band_hz
    chosen = [np.geomspace(1.01 * low, 0.99 * high, _LINES)]
    plant = controller.display.channel(name).plant
    for root in (*plant.poles, *plant.zeros):
        hertz, sharp = abs(root) / (2.0 * np.pi), abs(root.real) / max(abs(root), 1e-12)
        if root.imag > 0.0 and low < hertz < high and sharp < 0.2:
            about = hertz * (1.0 + max(sharp, 2e-3) * np.array([-2.0, -1.0, -0.4, 0.0, 0.4, 1.0, 2.0]))
            chosen.append(about[(about > low) & (about < high)])
    return np.unique(np.concatenate(chosen))


def _groups(controller: Controller, name: str, lines: FloatArray, level_db_sl: float) -> list[FloatArray]:
    """Return the lines in groups whose sums stay within command, travel and comfort: a line that asks for much is
    played alone, and what is left is interleaved.
    """
    prediction = ChannelPrediction.of(controller, name)
    channel = prediction.channel
    share = float(from_db(level_db_sl))
    asked = np.stack(
        [
            share * np.abs(prediction.command(lines)) / channel.converter.range_v,
            share * np.abs(prediction.displacement(lines)) / channel.travel_mm,
            np.full(lines.size, share / float(from_db(COMFORT_DB_SL))),
        ]
    )

    def split(places: NDArray[np.intp]) -> list[NDArray[np.intp]]:
        part = asked[:, places]
        peak = np.minimum(np.sum(part, axis=1), _CREST * np.sqrt(0.5 * np.sum(part**2, axis=1)))
        if places.size == 1 or np.max(peak) <= _LIMIT_SHARE:
            return [places]
        most = int(np.argmax(np.max(part, axis=0)))
        if np.max(part[:, most]) > 0.5 * _LIMIT_SHARE:
            return [places[most : most + 1], *split(np.delete(places, most))]
        return [*split(places[::2]), *split(places[1::2])]

    return [lines[places] for places in split(np.arange(lines.size))]


KEPT_PERIODS, FRESH_PERIODS = 5, 2
"""Periods of a record, and of the fresh noise that a model is held against."""
_ERRORS_DB = (0.3, 0.5, 0.7)
"""Errors allowed of an equaliser, one after the other: of a tolerance of 1 dB, the rest is the model's."""
_MARGIN = 0.7
"""Of the tolerance: a flatness below it is not corrected."""
_ROUNDS = 2
"""Corrections at most: each takes a measurement of the whole band."""


@dataclass(frozen=True)
class CalibrationRequest:
    """Wishes of a calibration. band_hz: within which the usable band is sought; level_db_sl: at which it must be
    usable and is verified; mains_hz: kept off, 0: none.
    """

    band_hz: tuple[float, float]
    level_db_sl: float = 20.0
    mains_hz: float = 50.0
    longest_s: float = 12.0


@dataclass(frozen=True, eq=False)
class CalibratedChannel:
    """Findings on one channel. first: the flatness of the first equaliser, last: of the one that is kept; rounds:
    how often it was corrected by what was measured at the level itself.
    """

    name: str
    level: Level
    estimate: PlantEstimate
    usable: UsableBand
    first: Flatness
    last: Flatness
    rounds: int

    def shortfall(self, allowed_db: float) -> str:
        """Return in words why it is not felt flat within allowed_db; "" where it is."""
        last = self.last
        at_hz = float(last.frequency_hz[np.argmax(np.abs(last.error_db))])
        if last.limited:
            return "the command was cut at its range while a tone was played: a lower level, or more volts"
        if abs(last.worst_db) > allowed_db:
            return f"{last.worst_db:+.2f} dB at {at_hz:.4g} Hz, corrected {self.rounds} times"
        return ""


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A calibrated display: the controller that was verified, and its channels."""

    controller: Controller
    channels: tuple[CalibratedChannel, ...]

    @property
    def flat(self) -> bool:
        """Return whether every channel is felt flat within the display's tolerance."""
        allowed = self.controller.display.objectives.flatness_db
        return not any(channel.shortfall(allowed) for channel in self.channels)


@dataclass(frozen=True, eq=False)
class KnownChannel:
    """A channel as recorded and identified, before an equaliser. recording: five periods of a broadband command."""

    channel: Channel
    level: Level
    recording: Recording
    estimate: PlantEstimate
    usable: UsableBand


class NoEqualiser(NoDesign):
    """There is no prefilter for what was measured. display: with plants and bands as found; known: its channels."""

    def __init__(self, reason: str, display: Display, known: tuple[KnownChannel, ...]) -> None:
        super().__init__(reason)
        self.display, self.known = display, known


def calibrate(
    rig: SoundRig, asked: CalibrationRequest, rng: np.random.Generator, note: Callable[[str], None] = lambda text: None
) -> Calibrated:
    """Calibrate every channel of the rig's display: level, record, model held against fresh noise, usable band,
    equaliser, felt flatness; where that is not within 0.7 of the tolerance, the plant is corrected by what was measured
    and equalised again, twice at most.

    Raises BadInput where a sensor does not measure its own actuator, or nothing can be reached; NoEqualiser, with what
    was measured; DeviceFault.
    """
    require_sensors(rig, rig.channels)
    rig.feed_far_ahead()
    known = [_known(rig, place, asked, rng, note) for place in range(len(rig.channels))]
    if rig.display.sound is not None and not rig.display.sound.latency_samples:
        known = _put_back(rig, known)
    display = rig.display
    note("equalising")
    controller = _first(display, known)
    first = _measured(rig, controller, asked, rng, note)
    last, rounds = first, 0
    for _ in range(_ROUNDS):
        if _worst(last) <= _MARGIN * display.objectives.flatness_db:
            break
        note("correcting")
        plants = [
            _corrected(controller, each.channel.name, flat)
            if abs(flat.worst_db) > _MARGIN * display.objectives.flatness_db
            else None
            for each, flat in zip(known, last, strict=True)
        ]
        try:
            described = zip(controller.display.channels, plants, strict=True)
            channels = [each if plant is None else replace(each, plant=plant) for each, plant in described]
            again = _designed(display, channels)
        except (BadInput, NoDesign):
            break  # keep what was measured
        felt = _measured(rig, again, asked, rng, note)
        if _worst(felt) >= _worst(last):
            break
        controller, last, rounds = again, felt, rounds + 1
    rig.load(controller)
    calibrated = (
        CalibratedChannel(each.channel.name, each.level, each.estimate, each.usable, before, after, rounds)
        for each, before, after in zip(known, first, last, strict=True)
    )
    return Calibrated(controller, tuple(calibrated))


def _known(
    rig: SoundRig, place: int, asked: CalibrationRequest, rng: np.random.Generator, note: Callable[[str], None]
) -> KnownChannel:
    display = rig.display
    channel = display.channels[place]
    input_v = display.sound.wires[place].input_full_scale_v if display.sound is not None else np.inf
    waves = [broadband(display.rate_hz, asked.band_hz, asked.mains_hz, rng) for _ in range(2)]
    note(f"{channel.name}: level")
    level = find_level(rig, channel, waves[0], input_v)
    note(f"{channel.name}: recording at {level.volts:.3g} V")
    recording = record_wave(rig, channel.name, waves[0], level.volts, KEPT_PERIODS)
    fresh = record_wave(rig, channel.name, waves[1], level.volts, FRESH_PERIODS)
    note(f"{channel.name}: identifying")
    estimate = estimate_plant(channel, recording, fresh, asked.band_hz)
    usable = usable_band(channel, estimate.plant, asked.band_hz, asked.level_db_sl)
    threshold = replace(channel.threshold, band_hz=usable.band_hz)
    identified = replace(
        channel,
        plant=estimate.plant,
        threshold=threshold,
        valid_hz=asked.band_hz,
        loads=(),
        family=(),
        covariance=(),
        model_error_db=max(0.0, estimate.departure_db),
    )
    return KnownChannel(identified, level, recording, estimate, usable)


def _put_back(rig: SoundRig, known: list[KnownChannel]) -> list[KnownChannel]:
    """Return the channels without the dead time that all of them have, which the rig compensates from now on, so that
    sensor and reference are aligned in the rows of a trial. A plant that is a measured response has no dead time and is
    left out.
    """
    late = [int(each.estimate.plant.delay_s * rig.rate_hz) for each in known if each.estimate.by == "model"]
    if not late or min(late) == 0:
        return known
    rig.put_back(min(late))
    shorter = []
    for each in known:
        plant = each.channel.plant
        plant = replace(plant, delay_s=max(0.0, plant.delay_s - min(late) / rig.rate_hz))
        shorter.append(replace(each, channel=replace(each.channel, plant=plant)))
    return shorter


def _first(display: Display, known: list[KnownChannel]) -> Controller:
    """Return the controller for what was measured. Raises NoEqualiser, with what was measured."""
    channels = [each.channel for each in known]
    try:
        return _designed(display, channels)
    except (BadInput, NoDesign) as error:
        raise NoEqualiser(str(error), replace(display, channels=tuple(channels)), tuple(known)) from None


def _designed(display: Display, channels: list[Channel]) -> Controller:
    described = replace(display, channels=tuple(channels))
    for allowed_db in _ERRORS_DB:
        try:
            return design_controller(described, None, allowed_db)
        except (BadInput, NoDesign):
            if allowed_db == _ERRORS_DB[-1]:
                raise
    raise AssertionError("the last error is raised")


def _measured(
    rig: SoundRig,
    controller: Controller,
    asked: CalibrationRequest,
    rng: np.random.Generator,
    note: Callable[[str], None],
) -> list[Flatness]:
    rig.load(controller)
    felt = []
    for name in rig.channels:
        note(f"{name}: verifying")
        felt.append(rig.repeated(partial(felt_flatness, rig, controller, name, asked, rng)))
    return felt


def _worst(felt: list[Flatness]) -> float:
    return max(abs(flat.worst_db) for flat in felt)


def _corrected(controller: Controller, name: str, flat: Flatness) -> ContinuousSystem:
    """Return the plant whose magnitude, under this controller, is felt as it was measured: at the level itself, where a
    spring that hardens answers otherwise than to the record. It is the plant that the controller was designed on, and
    what it is wrong by: so it goes on as before outside the band.
    """
    prediction = ChannelPrediction.of(controller, name)
    channel = prediction.channel
    missing_db = flat.error_db - db(np.abs(prediction.felt(flat.frequency_hz)))
    # relative error to which a correction is followed: a tenth of the tolerance
    wrong = plant_of_levels(flat.frequency_hz, missing_db, 0.01)
    plant = channel.plant
    return ContinuousSystem(
        np.concatenate([plant.zeros, wrong.zeros]),
        np.concatenate([plant.poles, wrong.poles]),
        plant.gain * wrong.gain,
        plant.delay_s,
    )
