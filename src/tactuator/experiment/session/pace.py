"""Estimate of the time that a session will still take, from its pace so far."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

_BETWEEN_TRIALS_S = 1.5
"""Time from the end of a trial to the next one where nothing is known of the subject yet."""
_PAUSE_S = 60.0
"""A longer time between two answers is a break, which is left out of the pace."""
_TRIALS_AVERAGED = 30


@dataclass
class Pace:
    """Seconds that trials take beside what they play: the mean of the last thirty."""

    _beside_s: deque[float] = field(init=False, default_factory=lambda: deque(maxlen=_TRIALS_AVERAGED))
    _last_s: float | None = field(init=False, default=None)

    def answered(self, now_s: float, played_s: float) -> None:
        """Take the time of an answer into account; played_s: duration of its trial's presentation."""
        if self._last_s is not None and now_s - self._last_s < _PAUSE_S + played_s:
            self._beside_s.append(max(0.0, now_s - self._last_s - played_s))
        self._last_s = now_s

    @property
    def beside_s(self) -> float:
        """Return the seconds between trials, as measured or, before any answer, as assumed."""
        return sum(self._beside_s) / len(self._beside_s) if self._beside_s else _BETWEEN_TRIALS_S
