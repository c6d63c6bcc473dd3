"""Intervals announced by touch, for subjects who neither see nor hear: as many taps as the interval's number."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.perception.curve import COMFORT_DB_SL
from tactuator.signals.decibels import from_db
from tactuator.signals.excitation import tone

_LONGEST_S = 5.0


@dataclass(frozen=True)
class Marks:
    """Taps before each interval (one before the first, two before the second ...) and a long one when all are over.

    channel: the one that taps are played on. frequency_hz, level_db_sl, tap_s: frequency, level and length of a tap.
    pause_s: silence between taps. after_s: silence between the last tap and the interval, long enough that a tap does
    not mask what follows. Raises BadInput for values that cannot be.
    """

    channel: str
    frequency_hz: float = 60.0
    level_db_sl: float = 25.0
    tap_s: float = 0.08
    pause_s: float = 0.12
    after_s: float = 0.5

    def __post_init__(self) -> None:
        if not self.level_db_sl <= COMFORT_DB_SL:
            raise BadInput(f"marks: level_db_sl is {self.level_db_sl:g}", f"{COMFORT_DB_SL:g} at most")
        for key in ("frequency_hz", "tap_s"):
            if not getattr(self, key) > 0.0:
                raise BadInput(f"marks: {key} is {getattr(self, key):g}", "a positive number")
        for key in ("tap_s", "pause_s", "after_s"):
            if not 0.0 <= getattr(self, key) <= _LONGEST_S:
                raise BadInput(f"marks: {key} is {getattr(self, key):g}", f"0 to {_LONGEST_S:g} s")

    def before(self, interval: int, silence_s: float, rate_hz: float, channels: Sequence[str]) -> FloatArray:
        """Return what precedes an interval (from 0), (n, channels) in threshold units.

        It ends in silence of after_s, or of silence_s where that is longer.
        """
        pause = np.zeros(round(self.pause_s * rate_hz))
        taps = [part for _ in range(interval + 1) for part in (self._tap(self.tap_s, rate_hz), pause)]
        rest = np.zeros(round(max(self.after_s, silence_s) * rate_hz))
        lead = np.zeros(round(silence_s * rate_hz))
        return self._placed(np.concatenate([lead, *taps, rest]), channels)

    def end(self, rate_hz: float, channels: Sequence[str]) -> FloatArray:
        """Return the signal that asks for an answer, (n, channels): silence and a tap four times as long."""
        return self._placed(
            np.concatenate([np.zeros(round(self.after_s * rate_hz)), self._tap(4.0 * self.tap_s, rate_hz)]), channels
        )

    def duration_s(self, intervals: int) -> float:
        """Return the longest time that marks add to a trial of that many intervals, in seconds."""
        taps = intervals * (intervals + 1) // 2
        return taps * (self.tap_s + self.pause_s) + (intervals + 1) * self.after_s + 4.0 * self.tap_s

    def _tap(self, duration_s: float, rate_hz: float) -> FloatArray:
        level = float(from_db(self.level_db_sl))
        return tone(self.frequency_hz, level, duration_s, rate_hz, ramp_s=0.25 * duration_s)

    def _placed(self, wave: FloatArray, channels: Sequence[str]) -> FloatArray:
        if self.channel not in channels:
            raise BadInput(f"marks: channel {self.channel!r} is not on the rig", f"{', '.join(channels)}")
        placed = np.zeros((wave.size, len(channels)))
        placed[:, list(channels).index(self.channel)] = wave
        return placed
