"""The answer of an actuator to a broadband command that repeats: level, wiring, record, and response by lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import signal

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.model.description import Channel
from tactuator.model.load import DERIVATIVES
from tactuator.rig.rig import Rig
from tactuator.signals.decibels import db

PERIOD_S = 4.0
_BEYOND = 1.6
"""The command reaches so far beyond the band, that modes beside it show."""
_CREST_ROUNDS = 30
_OFF_MAINS_HZ = 1.0


@dataclass(frozen=True, eq=False)
class Wave:
    """One period of a command of unit peak, (n,), with all lines between two frequencies; each line's power falls with
    frequency. bins: the excited lines.
    """

    samples: FloatArray
    bins: np.ndarray[tuple[int, ...], np.dtype[np.int64]]
    rate_hz: float

    @property
    def frequency_hz(self) -> FloatArray:
        """Return the frequencies of the excited lines, hertz."""
        return np.asarray(self.bins * self.rate_hz / self.samples.size)


def broadband(rate_hz: float, band_hz: tuple[float, float], mains_hz: float | None, rng: np.random.Generator) -> Wave:
    """Return a period of 4 s with every line from half the band's lower edge to 1.6 times its upper one, but those
    within 1 Hz of a multiple of mains_hz; amplitudes fall as 1/f, and random phases are made less peaked by clipping.
    """
    count = round(PERIOD_S * rate_hz)
    spacing = rate_hz / count
    bins = np.arange(max(1, round(0.5 * band_hz[0] / spacing)), round(_BEYOND * band_hz[1] / spacing))
    if mains_hz:
        hertz = bins * spacing
        bins = bins[np.abs(hertz - mains_hz * np.maximum(np.round(hertz / mains_hz), 1.0)) > _OFF_MAINS_HZ]
    size = 1.0 / bins
    phase = rng.uniform(0.0, 2.0 * np.pi, bins.size)
    best, least = np.zeros(count), np.inf
    for _ in range(_CREST_ROUNDS):
        spectrum = np.zeros(count // 2 + 1, dtype=np.complex128)
        spectrum[bins] = size * np.exp(1j * phase)
        wave = np.fft.irfft(spectrum, count)
        peak = float(np.max(np.abs(wave)))
        if peak < least:
            best, least = wave / peak, peak
        phase = np.angle(np.fft.rfft(np.clip(wave, -0.85 * peak, 0.85 * peak))[bins])
    return Wave(best, bins, rate_hz)


@dataclass(frozen=True, eq=False)
class Heard:
    """Periods of an answer to a wave of `volts`. command, position: (periods, n) volts; others_v: of every channel's
    sensor the rms of what follows the command, (channels,).
    """

    wave: Wave
    volts: float
    command: FloatArray
    position: FloatArray
    others_v: FloatArray

    def response(self) -> tuple[ComplexArray, FloatArray]:
        """Return the response at the excited lines, (m,), and its relative standard error from what differs between the
        periods.
        """
        heard = np.fft.rfft(self.position, axis=1)[:, self.wave.bins]
        asked = np.fft.rfft(self.command, axis=1)[:, self.wave.bins].mean(axis=0)
        mean = heard.mean(axis=0)
        scatter = np.mean(np.abs(heard - mean) ** 2, axis=0) / max(1, len(heard) - 1)
        width = 9
        smooth = signal.convolve(np.pad(scatter, width // 2, mode="edge"), np.ones(width) / width, mode="valid")
        return mean / asked, np.sqrt(0.5 * smooth) / np.maximum(np.abs(mean), 1e-300)

    def above_noise_db(self) -> float:
        """Return what 19 of 20 lines stand above the noise in one period, dB."""
        _, error = self.response()
        return float(-db(np.quantile(error, 0.95) * np.sqrt(2.0 * len(self.position))))

    def moved_mm(self, channel: Channel) -> float:
        """Return the peak displacement, mm, of what moves at the excited lines, by the sensor."""
        spectrum = np.fft.rfft(self.position.mean(axis=0))
        moved = np.zeros(spectrum.size, dtype=np.complex128)
        speed = (2j * np.pi * self.wave.frequency_hz) ** DERIVATIVES[channel.quantity]
        moved[self.wave.bins] = spectrum[self.wave.bins] / speed / channel.sensor_gain_v_per_mm
        return float(np.max(np.abs(np.fft.irfft(moved, self.position.shape[1]))))


def hear(rig: Rig, name: str, wave: Wave, volts: float, periods: int) -> Heard:
    """Drive one channel with a wave of `volts` for a period that settles and `periods` that are kept."""
    column = rig.channels.index(name)
    count = wave.samples.size
    command = np.zeros(((periods + 1) * count, len(rig.channels)))
    command[:, column] = volts * np.tile(wave.samples, periods + 1)
    trace = rig.drive(command)
    kept = trace.position_v[count:].reshape(periods, count, len(rig.channels))
    spectra = np.fft.rfft(kept.mean(axis=0), axis=0)[wave.bins]
    others = np.sqrt(2.0 * np.sum(np.abs(spectra) ** 2, axis=0)) / count
    asked = trace.command_v[count:, column].reshape(periods, count)
    return Heard(wave, volts, asked, kept[:, :, column], others)


@dataclass(frozen=True)
class Level:
    """The level at which a channel is recorded. volts: peak; above_noise_db; moved_mm: peak; bound_by: what keeps it
    from being greater.
    """

    volts: float
    above_noise_db: float
    moved_mm: float
    bound_by: str


_FIRST_SHARE, _STEP, _TRIES = 0.01, 4.0, 6
_WANTED_DB, _LEAST_DB = 30.0, 3.0
_TRAVEL_SHARE, _RANGE_SHARE, _INPUT_SHARE = 0.4, 0.8, 0.5


def find_level(rig: Rig, channel: Channel, wave: Wave, input_range_v: float) -> Level:
    """Raise the command from a hundredth of the range until 19 of 20 lines stand 30 dB above the noise, or until
    travel, range or the input (input_range_v) would be passed.

    Raises BadInput where the sensor does not hear its own output, and says which channel's does.
    """
    range_v = channel.converter.range_v
    volts, bound = _FIRST_SHARE * range_v, ""
    for _ in range(_TRIES):
        heard = hear(rig, channel.name, wave, volts, 2)
        level, moved = heard.above_noise_db(), heard.moved_mm(channel)
        rooms = {
            "noise": 10.0 ** ((_WANTED_DB - level) / 20.0),
            "travel": _TRAVEL_SHARE * channel.travel_mm / max(moved, 1e-12) if level > _LEAST_DB else np.inf,
            "range": _RANGE_SHARE * range_v / volts,
            "input": _INPUT_SHARE * input_range_v / float(np.max(np.abs(heard.position))),
        }
        bound = min(rooms, key=lambda name: rooms[name])
        if rooms[bound] <= 1.3:
            break
        volts *= min(_STEP, rooms[bound])
    _require_own(rig, channel.name, heard, level)
    return Level(heard.volts, level, moved, bound)


def _require_own(rig: Rig, name: str, heard: Heard, level_db: float) -> None:
    loudest = int(np.argmax(heard.others_v))
    own = rig.channels.index(name)
    if loudest != own and heard.others_v[loudest] > 3.0 * heard.others_v[own]:
        raise BadInput(
            f"channel {name!r} is answered by the sensor of {rig.channels[loudest]!r}",
            "wires as the display file says (output and input in [sound])",
        )
    if level_db < _LEAST_DB:
        raise BadInput(
            f"channel {name!r}: its sensor does not hear {heard.volts:.3g} V at its output ({level_db:.0f} dB above "
            "the noise)",
            "a sensor and an actuator that are connected, or a larger range_v",
        )
