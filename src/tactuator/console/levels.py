"""Levels of a rig's channels over the last second, in dB SL."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.console.scope import SIGNALS, Rows, ScopeSamples
from tactuator.measure.levels import FLOOR_DB_SL, HANN_SUM, WindowLevels
from tactuator.model.description import Display
from tactuator.signals.decibels import db

SECONDS = 1.0
"""Length of the window: the lines of its spectrum are 1 Hz apart, and a Hann window's are 1.5 Hz wide."""
_POINTS = 160


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
        self._display, self._window = display, WindowLevels(display, SECONDS, _POINTS)
        self._length, self.frequency_hz = self._window.length, self._window.frequency_hz

    def of(self, samples: ScopeSamples, tone_hz: float | None = None) -> list[ChannelLevel] | None:
        """Return the levels of the last second, channel by channel; None while less than that is there. tone_hz: of the
        tone that is played, if one is.
        """
        rows = samples.rows(samples.end - self._length, samples.end)
        return None if len(rows) < self._length or not np.all(np.isfinite(rows)) else self.of_rows(rows, tone_hz)

    def of_rows(self, rows: Rows, tone_hz: float | None = None) -> list[ChannelLevel]:
        """Return the levels of one second of rows (n, series), channel by channel."""
        count, window = len(self._display.channels), self._window
        windowed = window.windowed(rows[:, SIGNALS.index("position") * count :].astype(np.float64))
        command = rows[:, SIGNALS.index("command") * count :][:, :count]
        means = command.mean(axis=0, dtype=np.float64).tolist()
        amplitudes_v = window.amplitudes(windowed)
        units = window.over_threshold(amplitudes_v)
        stretches, levels = window.of(units)
        found = []
        for index in range(count):
            tone_db_sl = None if tone_hz is None else self._tone(index, windowed[:, index], tone_hz)
            peak_hz = self._peak_hz(amplitudes_v[:, index], units[:, index])
            peak_db_sl = self._tone(index, windowed[:, index], peak_hz)
            level = float(levels[index])
            found.append(ChannelLevel(stretches[index], level, tone_db_sl, means[index], peak_hz, peak_db_sl))
        return found

    def _tone(self, index: int, windowed: FloatArray, tone_hz: float) -> float:
        """Return the level of a sinusoid of that frequency on a channel, dB SL."""
        turns = tone_hz / self._display.rate_hz * np.arange(self._length)
        volts = np.abs(np.exp(-2j * np.pi * turns) @ windowed) * 2.0 / (HANN_SUM * self._length)
        with np.errstate(divide="ignore"):
            return max(float(db(volts / self._display.channels[index].threshold_voltage(tone_hz))), FLOOR_DB_SL)

    def _peak_hz(self, spectrum: FloatArray, units: FloatArray) -> float:
        """Return the frequency of the strongest sinusoid: the greater neighbour of a Hann window's line shows how far
        it is from the line (Rife & Vincent 1970).
        """
        line = int(self._window.edges[0]) + int(np.argmax(units[self._window.edges[0] : self._window.last]))
        side = 1 if spectrum[line + 1] > spectrum[line - 1] else -1
        ratio = float(spectrum[line + side] / max(spectrum[line], np.finfo(float).tiny))
        return (line + side * min((2.0 * ratio - 1.0) / (ratio + 1.0), 1.0)) / SECONDS
