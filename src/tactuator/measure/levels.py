"""Levels of a display's channels over a short window, in dB SL: in stretches of the spectrum, and of the whole band."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from tactuator.arrays import FloatArray
from tactuator.model.description import Channel, Display
from tactuator.signals.decibels import db

HANN_POWER, HANN_SUM = 0.375, 0.5
"""Mean square, and mean, of a Hann window."""
FLOOR_DB_SL = -120.0


class WindowLevels:
    """Levels over windows of `seconds`, whose lines are 1/seconds apart, in about `points` stretches (frequency_hz)."""

    def __init__(self, display: Display, seconds: float, points: int) -> None:
        self.length = round(seconds * display.rate_hz)
        lines = scipy.fft.rfftfreq(self.length, 1.0 / display.rate_hz)
        top = min(0.45 * display.rate_hz, max(2.0 * channel.threshold.band_hz[1] for channel in display.channels))
        edges = np.unique(np.round(np.geomspace(2.0 / seconds, top, points + 1) * seconds).astype(int))
        self.edges, self.last = edges[:-1], int(edges[-1])
        self.frequency_hz: FloatArray = np.sqrt(lines[edges[:-1]] * lines[np.maximum(edges[1:] - 1, edges[:-1])])
        self._channels = [_Weight.of(channel, lines) for channel in display.channels]
        self._window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(self.length) / self.length)

    def windowed(self, rows: FloatArray) -> FloatArray:
        """Return a window of rows (length, channels), without their mean."""
        return np.asarray((rows - rows.mean(axis=0)) * self._window[:, None])

    def amplitudes(self, windowed: FloatArray) -> FloatArray:
        """Return the amplitude of a sinusoid at each line, (lines, channels), in the unit of the rows."""
        return np.asarray(np.abs(scipy.fft.rfft(windowed, axis=0)) * 2.0 / (HANN_SUM * self.length))

    def over_threshold(self, amplitudes_v: FloatArray) -> FloatArray:
        """Return amplitudes at the sensors in threshold units."""
        return amplitudes_v * np.column_stack([weight.per_volt for weight in self._channels])

    def of(self, units: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the levels of amplitudes in threshold units: the greatest line of each stretch, (channels, stretches),
        and the sinusoid with the power of all lines of a channel's band, (channels,).
        """
        most = np.maximum.reduceat(units[: self.last], self.edges, axis=0)
        # a sinusoid's power is spread over three lines: the window's mean square against its squared mean
        power = np.array(
            [np.sum(column[weight.band] ** 2) for column, weight in zip(units.T, self._channels, strict=True)]
        )
        with np.errstate(divide="ignore"):
            level = np.maximum(db(np.sqrt(power * HANN_SUM**2 / HANN_POWER)), FLOOR_DB_SL)
            return np.maximum(db(most.T), FLOOR_DB_SL), np.asarray(level)


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
