"""Plan of the paper's study: the display that is simulated, frequencies and levels, people, and the seed."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace

from tactuator.model.description import Display

RESPONSE_HZ = (
    *(0.4, 0.6, 1.0, 1.5, 2.0, 3.0, 4.5, 6.5, 10.0, 14.0, 20.0, 28.0, 38.0, 50.0),
    *(70.0, 90.0, 110.0, 140.0, 170.0, 200.0, 230.0, 265.0, 296.0),
)
"""Frequencies of measured responses: 23 frequencies, each 2 Hz or more from every multiple of mains."""

LEVELS_DB_SL: tuple[float, ...] = (0.0, 10.0, 30.0, 50.0)
"""The paper's figures 9 and 10."""

THRESHOLD_HZ = (0.4, 1.0, 3.0, 8.0, 20.0, 50.0, 100.0, 170.0, 250.0, 296.0)
"""Frequencies of measured thresholds."""

PROPORTIONAL_GAINS = (2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
"""Gains of the proportional controller that probes for noise, volts of command per volt of position."""

PEOPLE = {"S1": (0.4, -3.2, 0.01), "S2": (-1.2, -2.4, 0.02), "S3": (1.1, -4.0, 0.01)}
"""Simulated subjects: threshold against the library's curve, offset in dB at 20 Hz and tilt in dB per decade, and
lapse rate. All are less sensitive than the curve at low frequencies and more at high ones, as in the paper's figure 11:
what the study finds of this was put in.
"""

DEFAULT_POLES = 8
"""Poles of each prefilter in the display files that `init` writes."""

Progress = Callable[[str, float], None]
"""Called with the step at hand and how much of it is done, 0 to 1."""


@dataclass(frozen=True)
class Plan:
    """Parameters of a study. display: what is simulated; seed: of all randomness."""

    display: Display
    seed: int = 1

    def seed_of(self, step: str) -> int:
        """Return a seed for this step, so that one step's randomness does not depend on another's."""
        digest = hashlib.sha256(f"{self.seed}/{step}".encode()).digest()
        return int.from_bytes(digest[:4], "little")


def default_display(display: Display) -> Display:
    """Return the display with what `init` writes for it: a prefilter of eight poles, and a finger fed forward."""
    channels = (
        replace(channel, prefilter=replace(channel.prefilter, poles=DEFAULT_POLES)) for channel in display.channels
    )
    return replace(display, channels=tuple(channels), touch=replace(display.touch, adaptive=True))
