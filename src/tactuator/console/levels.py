"""Levels of a rig's channels over the last second, in dB SL."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from tactuator.arrays import FloatArray
from tactuator.console.scope import SIGNALS, Rows, ScopeSamples
from tactuator.model.description import Channel, Display
from tactuator.signals.decibels import db

SECONDS = 1.0
"""Length of the window: the lines of its spectrum are 1 Hz apart, and a Hann window's are 1.5 Hz wide."""
_POINTS = 160
_HANN_POWER, _HANN_SUM = 0.375, 0.5
"""Mean square, and mean, of a Hann window."""
_FLOOR_DB_SL = -120.0


@dataclass(frozen=True, eq=False)
class ChannelLevel:
    """Levels of one channel over the last second. spectrum_db_sl: at Levels.frequency_hz, the greatest line of each
    stretch, as a sinusoid of that amplitude; level_db_sl: of the sinusoid with the power of all lines of the band, each
    weighted by the threshold curve; the hum and noise of the sensor itself are among them. tone_db_sl: of the tone that
    is played, if one is. command_mean_v: what the command holds against. peak_hz, peak_db_sl: of the strongest
    sinusoid, between the lines.
    """

    spectrum_db_sl: FloatArray
    level_db_sl: float
    tone_db_sl: float | None
    command_mean_v: float
    peak_hz: float
    peak_db_sl: float


class Levels:
    """Levels of a display's channels in dB SL, from the voltage of its sensors and its threshold curves."""

    def __init__(self, display: Display) -> None:
        self._length = round(SECONDS * display.rate_hz)
        lines = scipy.fft.rfftfreq(self._length, 1.0 / display.rate_hz)
        top = min(0.45 * display.rate_hz, max(2.0 * channel.threshold.band_hz[1] for channel in display.channels))
        edges = np.unique(np.round(np.geomspace(2.0, top, _POINTS + 1) * SECONDS).astype(int))
        self._edges = edges[:-1]
        self._last = int(edges[-1])
        self.frequency_hz: FloatArray = np.sqrt(lines[edges[:-1]] * lines[np.maximum(edges[1:] - 1, edges[:-1])])
        self._display = display
        self._channels = [_Weight.of(channel, lines) for channel in display.channels]
        self._window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(self._length) / self._length)

    def of(self, samples: ScopeSamples, tone_hz: float | None = None) -> list[ChannelLevel] | None:
        """Return the levels of the last second, channel by channel; None while less than that is there. tone_hz: of the
        tone that is played, if one is.
        """
        rows = samples.rows(samples.end - self._length, samples.end)
        return None if len(rows) < self._length or not np.all(np.isfinite(rows)) else self.of_rows(rows, tone_hz)

    def of_rows(self, rows: Rows, tone_hz: float | None = None) -> list[ChannelLevel]:
        """Return the levels of one second of rows (n, series), channel by channel."""
        count = len(self._channels)
        position = rows[:, SIGNALS.index("position") * count :].astype(np.float64)
        command = rows[:, SIGNALS.index("command") * count :][:, :count]
        windowed = (position - position.mean(axis=0)) * self._window[:, None]
        means = command.mean(axis=0, dtype=np.float64).tolist()
        return [self._level(index, windowed[:, index], tone_hz, means[index]) for index in range(count)]

    def _tone(self, index: int, windowed: FloatArray, tone_hz: float) -> float:
        """Return the level of a sinusoid of that frequency on a channel, dB SL."""
        turns = tone_hz / self._display.rate_hz * np.arange(self._length)
        volts = np.abs(np.exp(-2j * np.pi * turns) @ windowed) * 2.0 / (_HANN_SUM * self._length)
        with np.errstate(divide="ignore"):
            return max(float(db(volts / self._display.channels[index].threshold_voltage(tone_hz))), _FLOOR_DB_SL)

    def _peak_hz(self, spectrum: FloatArray, units: FloatArray) -> float:
        """Return the frequency of the strongest sinusoid: the greater neighbour of a Hann window's line shows how far
        it is from the line (Rife & Vincent 1970).
        """
        line = int(self._edges[0]) + int(np.argmax(units[self._edges[0] : self._last]))
        side = 1 if spectrum[line + 1] > spectrum[line - 1] else -1
        ratio = float(spectrum[line + side] / max(spectrum[line], np.finfo(float).tiny))
        return (line + side * min((2.0 * ratio - 1.0) / (ratio + 1.0), 1.0)) / SECONDS

    def _level(self, index: int, windowed: FloatArray, tone_hz: float | None, command_mean_v: float) -> ChannelLevel:
        # in threshold units: amplitude of a sinusoid at each line
        weight, spectrum = self._channels[index], np.abs(scipy.fft.rfft(windowed))
        units = spectrum * 2.0 / (_HANN_SUM * self._length) * weight.per_volt
        most = np.maximum.reduceat(units[: self._last], self._edges)
        # a sinusoid's power is spread over three lines: the window's mean square against its squared mean
        power = float(np.sum(units[weight.band] ** 2)) * _HANN_SUM**2 / _HANN_POWER
        with np.errstate(divide="ignore"):
            level = max(float(db(np.sqrt(power))), _FLOOR_DB_SL)
            stretches = np.maximum(db(most), _FLOOR_DB_SL)
        tone_db_sl = None if tone_hz is None else self._tone(index, windowed, tone_hz)
        peak_hz = self._peak_hz(spectrum, units)
        peak_db_sl = self._tone(index, windowed, peak_hz)
        return ChannelLevel(stretches, level, tone_db_sl, command_mean_v, peak_hz, peak_db_sl)


@dataclass(frozen=True, eq=False)
class _Weight:
    """Threshold units per volt of the sensor at each line (0 at rest), and the lines of the channel's band."""

    per_volt: FloatArray
    band: FloatArray

    @classmethod
    def of(cls, channel: Channel, lines: FloatArray) -> _Weight:
        low, high = channel.threshold.band_hz
        threshold_v = channel.threshold_voltage(np.maximum(lines, lines[1]))
        # a window's side reaches two lines beyond: without the lowest two there is no leakage of the mean
        inside = (lines >= max(low, 2.0 * lines[1]) - 1e-9) & (lines <= high + 2.0 * lines[1])
        return cls(np.where(lines > 0.0, 1.0 / threshold_v, 0.0), inside)
