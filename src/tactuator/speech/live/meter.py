"""What a live stream asks of the fingers and what they feel, twenty times a second."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.measure.levels import WindowLevels
from tactuator.rig.rig import Rig, Trace
from tactuator.speech.live.stream import LiveStream

BLOCK_S, WINDOW_S, POINTS = 0.05, 0.2, 48
"""Length of a block; the window of its levels, whose lines are 5 Hz apart; stretches of its spectra."""


@dataclass(frozen=True, eq=False)
class LiveBlock:
    """A twentieth of a second of a live stream.

    Parameters
    ----------
    time_s: of its end, from the stream's begin.
    felt_db_sl: by finger, over the last 0.2 s from 10 Hz on, as the sensor reads it, its hum and noise included; NaN
        without a sensor.
    asked_db_sl: likewise, of the reference.
    delay_s: from the source to the finger, the least and the greatest by the frequency that is felt.
    dropouts: so far, what the rig missed included.
    muted: whether it is.
    frequency_hz, asked_spectrum_db_sl, felt_spectrum_db_sl: spectra, (channels, frequencies).
    """

    time_s: float
    felt_db_sl: Mapping[str, float]
    asked_db_sl: Mapping[str, float]
    delay_s: tuple[float, float]
    dropouts: int
    muted: bool
    frequency_hz: FloatArray = field(repr=False)
    asked_spectrum_db_sl: FloatArray = field(repr=False)
    felt_spectrum_db_sl: FloatArray = field(repr=False)


class LiveMeter:
    """Makes blocks of the trace of a stream on a rig."""

    def __init__(self, stream: LiveStream, rig: Rig) -> None:
        self._stream, self._rig = stream, rig
        self._levels = WindowLevels(rig.display, WINDOW_S, POINTS)
        self._rows = np.zeros((2, self._levels.length, len(rig.channels)))
        self._pieces: list[tuple[FloatArray, FloatArray]] = []
        self._step, self._new = round(BLOCK_S * rig.rate_hz), 0
        self._sensed = np.array([name not in rig.without_sensor for name in rig.channels])

    def delays(self) -> dict[str, float]:
        """Return the delay of each stage, seconds."""
        display = self._rig.display
        card = 0 if display.sound is None else display.sound.latency_samples
        rig_s = self._rig.lead_s + (card + display.delay_samples) / display.rate_hz
        return self._stream.delays() | {"rig": rig_s}

    def push(self, trace: Trace) -> Iterator[LiveBlock]:
        """Yield the blocks that a piece of the trace completes."""
        first = 0
        while first < len(trace):
            last = first + self._step - self._new
            self._pieces.append((trace.reference[first:last], trace.position_v[first:last]))
            self._new += len(self._pieces[-1][0])
            first = last
            if self._new == self._step:
                new = np.stack([np.concatenate(each) for each in zip(*self._pieces, strict=True)])
                self._rows = np.concatenate((self._rows, new), axis=1)[:, -self._levels.length :]
                self._pieces, self._new = [], 0
                yield self._block()

    def _block(self) -> LiveBlock:
        asked, felt = (self._levels.amplitudes(self._levels.windowed(rows)) for rows in self._rows)
        asked_spectrum, asked_db = self._levels.of(asked)
        felt_spectrum, felt_db = self._levels.of(self._levels.over_threshold(felt))
        state, names = self._stream.state, self._rig.channels
        fixed_s, by_frequency = sum(self.delays().values()), self._stream.coding_delays.values()
        return LiveBlock(
            state.seconds,
            dict(zip(names, np.where(self._sensed, felt_db, np.nan).tolist(), strict=True)),
            dict(zip(names, asked_db.tolist(), strict=True)),
            (fixed_s + min(by_frequency), fixed_s + max(by_frequency)),
            state.dropouts + state.missed,
            state.muted,
            self._levels.frequency_hz,
            asked_spectrum,
            np.where(self._sensed[:, None], felt_spectrum, np.nan),
        )
