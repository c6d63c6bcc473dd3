"""Durations of the parts of a trial."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactuator.errors import BadInput


@dataclass(frozen=True)
class Timing:
    """Durations of the parts of a trial, in seconds.

    stimulus_s: of each interval, or as long as `periods` of a slow tone take. ramp_s: at both its ends, inside it.
    lead_s: silence before the first interval. gap_s: silence between intervals. feedback_s: time for which feedback is
    shown. Raises BadInput for durations that cannot be.
    """

    stimulus_s: float = 0.5
    ramp_s: float = 0.1
    gap_s: float = 0.3
    lead_s: float = 0.3
    periods: float = 2.0
    feedback_s: float = 0.4

    def __post_init__(self) -> None:
        for key in ("stimulus_s", "periods"):
            value = getattr(self, key)
            if not (np.isfinite(value) and value > 0.0):
                raise BadInput(f"timing: {key} is {value:g}", "a positive number")
        for key in ("ramp_s", "gap_s", "lead_s", "feedback_s"):
            value = getattr(self, key)
            if not (np.isfinite(value) and value >= 0.0):
                raise BadInput(f"timing: {key} is {value:g}", "zero or more")
        if 2.0 * self.ramp_s > self.stimulus_s:
            raise BadInput(f"timing: ramps of {self.ramp_s:g} s in {self.stimulus_s:g} s", "half of it at most")

    def duration_s(self, frequency_hz: float) -> float:
        """Return the duration of one interval at that frequency."""
        return max(self.stimulus_s, self.periods / frequency_hz)

    def ramp_at_s(self, frequency_hz: float) -> float:
        """Return the duration of each ramp, in proportion to the interval: slow tones begin as gently as fast ones."""
        return self.ramp_s * self.duration_s(frequency_hz) / self.stimulus_s

    def clearance_hz(self, frequency_hz: float) -> float:
        """Return the distance that a tone keeps from a mains line: the reciprocal of its duration, at least 2 Hz.

        That is where the spectrum of a tone without ramps has its first zero.
        """
        return max(2.0, 1.0 / self.duration_s(frequency_hz))
