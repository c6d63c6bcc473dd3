"""A model of an actuator from its answer to a broadband command that repeats.

The level is raised until the response is clear of the noise, the wiring is checked, and the response is taken line by
line; a model is fitted to the record, or to the response itself where none follows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.identification.by_response import identify_response
from tactuator.identification.options import IdentifyOptions
from tactuator.model.description import Channel
from tactuator.model.plant import DERIVATIVES
from tactuator.model.plant_model import PlantModel
from tactuator.model.response_plant import plant_of_response
from tactuator.rig.rig import Rig
from tactuator.signals.decibels import db
from tactuator.signals.discretise import discretise
from tactuator.signals.multisine import Multisine, multisine
from tactuator.signals.record import FrequencyResponse
from tactuator.signals.spectra import frequency_response, mean_over_frequency, nearest_mains
from tactuator.signals.systems import ContinuousSystem

PERIOD_S = 4.0
"""Lines 0.25 Hz apart: a mode of Q 30 at 50 Hz has seven within its width."""
_BEYOND = 1.6
"""The command reaches so far beyond the band, that modes beside it show."""
_CREST_ROUNDS, _OFF_MAINS_HZ = 30, 1.0
"""Rounds of clipping for a low crest factor; distance of every line from mains, hertz."""
_MEAN = 9
"""Lines (2 Hz) over which errors and departures are averaged."""


def broadband(
    rate_hz: float, band_hz: tuple[float, float], mains_hz: float | None, rng: np.random.Generator
) -> Multisine:
    """Return a period of 4 s, of unit peak, with every line from half the band's lower edge to 1.6 times its upper one,
    but those within 1 Hz of a multiple of mains_hz; amplitudes fall as 1/f.
    """
    count = round(PERIOD_S * rate_hz)
    spacing = rate_hz / count
    bins = np.arange(max(1, round(0.5 * band_hz[0] / spacing)), round(_BEYOND * band_hz[1] / spacing))
    if mains_hz:
        hertz = bins * spacing
        bins = bins[np.abs(hertz - nearest_mains(hertz, mains_hz)) > _OFF_MAINS_HZ]
    wave = multisine(rate_hz, count, bins, 1.0 / bins, rng, rounds=_CREST_ROUNDS)
    return replace(wave, amplitude=wave.amplitude / float(np.max(np.abs(wave.one_period()))))


@dataclass(frozen=True, eq=False)
class Recording:
    """Periods of an answer to a wave of `volts`. command, position: (periods, n) volts; others_v: of every channel's
    sensor the rms of what follows the command, (channels,).
    """

    wave: Multisine
    volts: float
    command: FloatArray
    position: FloatArray
    others_v: FloatArray

    def response(self) -> tuple[ComplexArray, FloatArray]:
        """Return the response at the excited lines, (m,), and its relative standard error between periods."""
        bins = self.wave.bins
        command, position = (np.fft.rfft(volts, axis=1)[:, bins] for volts in (self.command, self.position))
        response, variance = frequency_response(command, position)
        smooth = mean_over_frequency(variance, bins, bins, fewest=_MEAN)
        return response, np.sqrt(0.5 * smooth) / np.maximum(np.abs(response), 1e-300)

    def above_noise_db(self) -> float:
        """Return the signal-to-noise ratio that 19 of 20 lines reach in one period, dB."""
        _, error = self.response()
        return float(-db(np.quantile(error, 0.95) * np.sqrt(2.0 * len(self.position))))

    def moved_mm(self, channel: Channel) -> float:
        """Return the peak displacement, mm, of what moves at the excited lines, by the sensor."""
        spectrum = np.fft.rfft(self.position.mean(axis=0))
        moved = np.zeros(spectrum.size, dtype=np.complex128)
        speed = (2j * np.pi * self.wave.frequency_hz) ** DERIVATIVES[channel.quantity]
        moved[self.wave.bins] = spectrum[self.wave.bins] / speed / channel.sensor_gain_v_per_mm
        return float(np.max(np.abs(np.fft.irfft(moved, self.position.shape[1]))))


def record_wave(rig: Rig, name: str, wave: Multisine, volts: float, periods: int) -> Recording:
    """Drive one channel with a wave of `volts` for a period that settles and `periods` that are kept."""
    column = rig.channels.index(name)
    count = wave.period
    command = np.zeros(((periods + 1) * count, len(rig.channels)))
    command[:, column] = volts * wave.samples(periods + 1)
    trace = rig.drive(command)
    kept = trace.position_v[count:].reshape(periods, count, len(rig.channels))
    spectra = np.fft.rfft(kept.mean(axis=0), axis=0)[wave.bins]
    others = np.sqrt(2.0 * np.sum(np.abs(spectra) ** 2, axis=0)) / count
    asked = trace.command_v[count:, column].reshape(periods, count)
    return Recording(wave, volts, asked, kept[:, :, column], others)


@dataclass(frozen=True)
class Level:
    """Level at which a channel is recorded. volts, moved_mm: peak; bound_by: what keeps it from being greater."""

    volts: float
    above_noise_db: float
    moved_mm: float
    bound_by: str


_FIRST_SHARE, _STEP, _TRIES = 0.01, 4.0, 6
"""The first level, of the range, the greatest step from one to the next, and steps: four reach the range."""
_WANTED_DB, _LEAST_DB = 30.0, 3.0
"""Above the noise: for errors of 0.3 dB in a line, and from where on an answer counts as one."""
_TRAVEL_SHARE, _RANGE_SHARE, _INPUT_SHARE = 0.4, 0.8, 0.5
"""What a record may take of travel, command and input: a crest factor and a resonance are left room."""


def find_level(rig: Rig, channel: Channel, wave: Multisine, input_range_v: float) -> Level:
    """Raise the command from a hundredth of the range until 19 of 20 lines are 30 dB above the noise, or until
    travel, range or the input (input_range_v) would be passed.

    Raises BadInput where the sensor does not measure its own output, and says which channel's does.
    """
    range_v = channel.converter.range_v
    volts, bound = _FIRST_SHARE * range_v, ""
    for _ in range(_TRIES):
        recording = record_wave(rig, channel.name, wave, volts, 2)
        level, moved = recording.above_noise_db(), recording.moved_mm(channel)
        rooms = {
            "noise": 10.0 ** ((_WANTED_DB - level) / 20.0),
            "travel": _TRAVEL_SHARE * channel.travel_mm / max(moved, 1e-12) if level > _LEAST_DB else np.inf,
            "range": _RANGE_SHARE * range_v / volts,
            "input": _INPUT_SHARE * input_range_v / float(np.max(np.abs(recording.position))),
        }
        bound = min(rooms, key=lambda name: rooms[name])
        if rooms[bound] <= 1.3:
            break
        volts *= min(_STEP, rooms[bound])
    _require_own(rig, channel.name, recording, level)
    return Level(recording.volts, level, moved, bound)


def _require_own(rig: Rig, name: str, recording: Recording, level_db: float) -> None:
    loudest = int(np.argmax(recording.others_v))
    column = rig.channels.index(name)
    if loudest != column and recording.others_v[loudest] > 3.0 * recording.others_v[column]:
        raise BadInput(
            f"channel {name!r} is answered by the sensor of {rig.channels[loudest]!r}",
            "wires as the display file says (output and input in [sound])",
        )
    if level_db < _LEAST_DB:
        raise BadInput(
            f"channel {name!r}: its sensor does not measure {recording.volts:.3g} V at its output "
            f"({level_db:.0f} dB above the noise)",
            "a sensor and an actuator that are connected, or a larger range_v",
        )


FORMS = ((5, 5), (3, 3), (7, 7), (4, 4))
"""Poles and zeros that are tried: a mode, its high-pass, and another mode or two, as acceleration or displacement."""
_FOLLOWS_DB, _HELD_DB = 0.4, 0.3
"""Departure from fresh noise at which a model follows, and of the held plant from its own: of a tolerance of 1 dB."""
_POINTS, _SHARP = 90, 0.06
"""Points of a plant of levels, and how much denser they are where the levels turn, for a median turn."""
_LINES, _SLOW_SHARE = 240, 0.2
"""Lines given to a fit, even in log frequency; share of the band's lower edge below which a zero is at rest."""
_FAR, _FALLS_OFF = 10.0, 4.0
"""Of the band's upper edge: where nothing was measured, and where a plant that does not fall off is made to."""


@dataclass(frozen=True, eq=False)
class PlantEstimate:
    """A plant that fits what was measured. by: "model" or "response"; model: what `identify` made, where it does;
    departure_db: greatest departure from the response to fresh noise in the band, beyond twice its own error.
    """

    plant: ContinuousSystem
    by: str
    model: PlantModel | None
    departure_db: float
    remarks: tuple[str, ...]


def estimate_plant(
    channel: Channel, recording: Recording, fresh: Recording, band_hz: tuple[float, float]
) -> PlantEstimate:
    """Return the plant of a channel: the first model whose magnitude keeps to fresh noise within 0.4 dB over the band,
    the best of them otherwise; where none comes within 1 dB, a plant of the response by itself.
    """
    late_s = _bulk_delay_s(recording)
    given = _points(recording, late_s)
    best: PlantEstimate | None = None
    remarks: list[str] = []
    for poles, zeros in FORMS:
        try:
            fit = identify_response(given, IdentifyOptions(poles, zeros, quantity=channel.quantity, friction=False))
        except BadInput as error:
            remarks.append(f"{poles} poles: {error}")
            continue
        model = replace(fit.model, delay_s=fit.model.delay_s + late_s)
        whole = ContinuousSystem.from_polynomials(model.num, model.den, model.delay_s)
        near = near_band(whole, band_hz)
        for plant in (at_rest(system, band_hz) for system in ([whole] if near is whole else [whole, near])):
            if not (plant.is_stable and plant.is_proper and _held_well(plant, fresh, band_hz)):
                continue
            off = departure_db(plant, fresh, band_hz)
            if best is None or off < best.departure_db:
                best = PlantEstimate(plant, "model", model, off, fit.distrust)
            if off <= _FOLLOWS_DB:
                return best
    if best is None or best.departure_db > 1.0:
        plant = at_rest(_plant_of_response(recording, band_hz), band_hz)
        off = departure_db(plant, fresh, band_hz)
        if best is None or off < best.departure_db:
            best = PlantEstimate(plant, "response", None, off, tuple(remarks))
    return best


def at_rest(plant: ContinuousSystem, band_hz: tuple[float, float]) -> ContinuousSystem:
    """Return the plant with its slowest zeros at s = 0 if they cannot be distinguished from zero: nothing was measured
    there, and a prefilter would need more than any actuator gives.
    """
    slow = np.abs(plant.zeros) < _SLOW_SHARE * 2.0 * np.pi * band_hz[0]
    return ContinuousSystem(np.where(slow, 0.0, plant.zeros), plant.poles, plant.gain, plant.delay_s)


def near_band(plant: ContinuousSystem, band_hz: tuple[float, float]) -> ContinuousSystem:
    """Return the plant without poles and zeros beyond ten times the band, where nothing was measured. Where it would
    not fall off there, it gets poles of Butterworth's at four times the band, and its dead time is less by theirs.

    A pole beyond the sampling rate does nothing in the band. But a plant that still answers there, held from sample to
    sample, answers in the band with the held command's images.
    """
    top = 2.0 * np.pi * band_hz[1]
    poles, zeros = (values[np.abs(values) <= _FAR * top] for values in (plant.poles, plant.zeros))
    if poles.size == plant.poles.size and zeros.size == plant.zeros.size:
        return plant
    far_zeros, far_poles = (values[np.abs(values) > _FAR * top] for values in (plant.zeros, plant.poles))
    gain = plant.gain * float(np.real(np.prod(-far_zeros) / np.prod(-far_poles)))
    count = max(2, zeros.size - poles.size + 1) if zeros.size >= poles.size else 0
    corner = _FALLS_OFF * top
    added = corner * np.exp(1j * np.pi * (0.5 + (np.arange(count) + 0.5) / max(1, count)))
    late_s = float(np.sum(np.real(-1.0 / added)))
    all_poles = np.concatenate([poles, added])
    return ContinuousSystem(zeros, all_poles, gain * corner**count, max(0.0, plant.delay_s - late_s))


def _held_well(plant: ContinuousSystem, recording: Recording, band_hz: tuple[float, float]) -> bool:
    """Return whether the plant answers in most of the band as it does held from sample to sample, which its prefilter
    sees. A deep antiresonance moves a little when it is held, and is let be.
    """
    frequency = recording.wave.frequency_hz
    inside = frequency[(frequency >= band_hz[0]) & (frequency <= band_hz[1])]
    rate_hz = recording.wave.rate_hz
    held = discretise(replace(plant, delay_s=plant.delay_s % (1.0 / rate_hz)), rate_hz, "zoh")
    return bool(np.median(np.abs(db(np.abs(held.response(inside) / plant.response(inside))))) <= _HELD_DB)


def _bulk_delay_s(recording: Recording) -> float:
    """Return a delay, seconds, that is less than the answer's own by 10 ms or less: where its impulse response begins.

    Between lines of even distance in log frequency a card's delay of 100 ms turns the phase by more than half a turn.
    """
    response, _ = recording.response()
    spectrum = np.zeros(recording.wave.period // 2 + 1, dtype=np.complex128)
    spectrum[recording.wave.bins] = response
    impulse = np.abs(np.fft.irfft(spectrum, recording.wave.period))
    begun = int(np.flatnonzero(impulse > 0.5 * np.max(impulse))[0])
    # what is left of an answer's delay for the fit: no mechanism answers later than 10 ms by itself
    return max(0.0, begun / recording.wave.rate_hz - 0.01)


def _points(recording: Recording, late_s: float) -> FrequencyResponse:
    """Return the response at lines evenly spaced in log frequency, with phase, late_s earlier than measured."""
    response, error = recording.response()
    frequency = recording.wave.frequency_hz
    response = response * np.exp(2j * np.pi * frequency * late_s)
    wanted = np.geomspace(frequency[0], frequency[-1], _LINES)
    chosen = np.unique(np.searchsorted(frequency, wanted).clip(0, frequency.size - 1))
    value = response[chosen]
    return FrequencyResponse(frequency[chosen], np.abs(value), np.angle(value), np.maximum(error[chosen], 1e-3))


def departure_db(plant: ContinuousSystem, recording: Recording, band_hz: tuple[float, float]) -> float:
    """Return the greatest departure of the plant's magnitude from the measured response, dB, in means over nine
    lines (2 Hz), beyond twice the error of such a mean.
    """
    response, error = recording.response()
    frequency = recording.wave.frequency_hz
    inside = (frequency >= band_hz[0]) & (frequency <= band_hz[1])
    modelled = plant.response(frequency[inside])
    ratio = np.abs(response[inside]) / np.abs(modelled)
    at_hz = frequency[inside]
    mean, unsure = mean_over_frequency(np.stack([ratio, error[inside]]), at_hz, at_hz, fewest=_MEAN)
    return float(np.max(np.abs(db(mean)) - db(1.0 + 2.0 * unsure / np.sqrt(_MEAN))))


def _plant_of_response(recording: Recording, band_hz: tuple[float, float]) -> ContinuousSystem:
    response, error = recording.response()
    frequency = recording.wave.frequency_hz
    inside = (frequency >= 0.95 * band_hz[0]) & (frequency <= 1.05 * band_hz[1])
    return plant_of_levels(frequency[inside], db(np.abs(response[inside])), error[inside])


def plant_of_levels(
    frequency_hz: FloatArray, level_db: FloatArray, deviation: FloatArray | float = 3e-3
) -> ContinuousSystem:
    """Return a plant of these levels (m,), dB of volts for a volt, by some 90 points, more where they turn sharply.

    deviation: relative standard error of the magnitudes. Raises BadInput where nothing follows them.
    """
    place = np.log(frequency_hz)
    turns = np.abs(np.gradient(np.gradient(level_db, place), place))
    density = 1.0 + _SHARP * np.minimum(turns / max(1e-9, float(np.median(turns))), 40.0)
    grown = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(place))])
    chosen = np.unique(np.searchsorted(grown, np.linspace(0.0, grown[-1], _POINTS)).clip(0, place.size - 1))
    error = np.maximum(np.broadcast_to(deviation, frequency_hz.shape)[chosen], 1e-3)
    points = FrequencyResponse(frequency_hz[chosen], 10.0 ** (level_db[chosen] / 20.0), None, error)
    return plant_of_response(points).system
