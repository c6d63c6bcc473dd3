"""The level of a live signal: a slow automatic gain towards a level in dB SL, and a gate that learns the noise."""

from __future__ import annotations

import math
from collections import deque
from typing import Annotated

import numpy as np
from pydantic import Field

from tactuator.arrays import FloatArray
from tactuator.parameters import Number, Positive, table
from tactuator.perception.curve import check_level
from tactuator.signals.decibels import db, from_db
from tactuator.speech.options import LEVEL_DB_SL

SPEECH_DB = -28.0
"""Level of what a coding makes of speech at -26 dB of full scale, as telephony has it: the gain begins with that."""
FAST_S, SLOW_S, SPEECH_S = 0.01, 0.1, 0.5
"""Time constants of power: for the gate, for the noise, and for the level of speech while the gate is open."""
QUIET_S, QUIETS = 0.5, 16
"""The noise is the least power of the last 16 windows of half a second: a steady sound counts as noise after 8 s."""
HANG_S, OPEN_S, SHUT_S = 0.2, 0.005, 0.05
"""The gate stays open so long behind speech, and fades within the others."""
BELOW_SPEECH_DB, NOISY_DB = 20.0, -60.0
"""Noise is so much below the loudest so far, or less than the second, of full scale, where it is quiet."""
LEAST_DB = -80.0
"""Of full scale: less opens no gate."""


@table("")
class LevelSettings:
    """How loud is felt what comes.

    gain_db: a fixed gain, the level in dB SL of a sinusoid of full scale, in place of the automatic one.
    """

    level_db_sl: Annotated[Number, Field(description="Of speech, dB SL.")] = LEVEL_DB_SL
    gain_db: Annotated[
        Number | None,
        Field(ge=-40.0, le=140.0, description="Fixed gain: dB SL of a sinusoid of full scale; no automatic gain."),
    ] = None
    attack_s: Annotated[Positive, Field(description="Time constant of less gain, s.")] = 0.3
    release_s: Annotated[Positive, Field(description="Time constant of more gain, s.")] = 3.0
    range_db: Annotated[Number, Field(ge=0.0, le=60.0, description="Automatic gain up and down, dB each.")] = 20.0
    gate_db: Annotated[Number, Field(ge=0.0, le=60.0, description="Gate: dB above the noise; 0: none.")] = 10.0

    def __post_init__(self) -> None:
        check_level(self.level_db_sl)


class LiveLevel:
    """Gives coded blocks (n, channels), of full scale 1, a level in threshold units.

    gain_db: now, dB SL at full scale. open: whether the gate is.
    """

    def __init__(self, settings: LevelSettings, rate_hz: float) -> None:
        self._settings, self._rate_hz = settings, rate_hz
        fixed = settings.gain_db
        self._middle_db = settings.level_db_sl - SPEECH_DB
        self.gain_db = self._middle_db if fixed is None else fixed
        self._fast = self._slow = self._loudest = 0.0
        self._speech = 0.0
        self._quiet: deque[float] = deque([np.inf], QUIETS)
        self._in_window_s, self._hang_s = -QUIET_S, 0.0  # nothing is learnt from the first half second
        self._gate = 1.0 if settings.gate_db == 0.0 else 0.0

    @property
    def open(self) -> bool:
        """Return whether the gate lets through."""
        return self._settings.gate_db == 0.0 or self._hang_s > 0.0

    @property
    def _noise(self) -> float:
        """Return the power that counts as noise: what never paused so far is not, if it is loud."""
        most = max(self._loudest * 10.0 ** (-BELOW_SPEECH_DB / 10.0), 0.5 * 10.0 ** (NOISY_DB / 10.0))
        least = min(self._quiet)
        return min(least, most) if math.isfinite(least) else 0.0

    def push(self, rows: FloatArray) -> FloatArray:
        """Return the rows at their level."""
        seconds = len(rows) / self._rate_hz
        power = float(np.einsum("ij,ij->j", rows, rows).max()) / len(rows)
        self._listen(power, seconds)
        former = float(from_db(self.gain_db)) * self._gate
        if self._settings.gain_db is None and self.open:
            self._adapt(power, seconds)
        towards = 1.0 if self.open else 0.0
        most = seconds / (OPEN_S if towards else SHUT_S)
        self._gate += min(max(towards - self._gate, -most), most)
        gain = float(from_db(self.gain_db)) * self._gate
        if gain == former:
            return np.asarray(rows * gain)
        line = former + (gain - former) / len(rows) * np.arange(1, len(rows) + 1)
        return np.asarray(rows * line[:, None])

    def _listen(self, power: float, seconds: float) -> None:
        """Learn the noise, and open the gate for what is louder."""
        self._fast += (power - self._fast) * min(1.0, seconds / FAST_S)
        if power > 0.0:  # digital silence is no noise
            self._slow += (power - self._slow) * min(1.0, seconds / SLOW_S)
            self._loudest = max(self._loudest, self._slow)
            self._in_window_s += seconds
            if self._in_window_s > 0.0:
                self._quiet[-1] = min(self._quiet[-1], self._slow)
        if self._in_window_s >= QUIET_S:
            self._in_window_s = 0.0
            self._quiet.append(self._slow)
        noise = self._noise * 10.0 ** (self._settings.gate_db / 10.0)
        heard = self._fast > max(noise, 0.5 * 10.0 ** (LEAST_DB / 10.0))
        self._hang_s = HANG_S if heard else self._hang_s - seconds

    def _adapt(self, power: float, seconds: float) -> None:
        self._speech += (power - self._speech) * min(1.0, seconds / SPEECH_S) if self._speech else power
        wanted_db = self._settings.level_db_sl - float(db(np.sqrt(2.0 * max(self._speech, 1e-30))))
        error_db = wanted_db - self.gain_db
        slow_s = self._settings.attack_s if error_db < 0.0 else self._settings.release_s
        gain_db, most = self.gain_db + error_db * min(1.0, seconds / slow_s), self._settings.range_db
        self.gain_db = min(max(gain_db, self._middle_db - most), self._middle_db + most)
