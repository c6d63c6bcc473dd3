"""Plan of the paper's study: display, frequencies and levels, observers, and the source of randomness."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactuator.experiment.simulated.subjects import Observer
from tactuator.model.description import Display
from tactuator.perception.curve import ThresholdCurve
from tactuator.perception.psychometric import Psychometric, Weibull

MAINS_HZ = 60.0

RESPONSE_HZ = (
    *(0.4, 0.6, 1.0, 1.5, 2.0, 3.0, 4.5, 6.5, 10.0, 14.0, 20.0, 28.0, 38.0, 50.0),
    *(70.0, 90.0, 110.0, 140.0, 170.0, 200.0, 230.0, 265.0, 296.0),
)
"""Frequencies of measured responses: 23 frequencies, each 2 Hz or more from every multiple of mains."""

MOTOR_HZ = (*RESPONSE_HZ, 330.0, 365.0, 400.0)
"""Frequencies of the motor's own response (the paper's figure 4: to 400 Hz)."""

LEVELS_DB_SL: tuple[float, ...] = (0.0, 10.0, 30.0, 50.0)
"""The paper's figures 9 and 10."""

THRESHOLD_HZ = (0.4, 1.0, 3.0, 8.0, 20.0, 50.0, 100.0, 170.0, 250.0, 296.0)
"""Frequencies of measured thresholds."""

PROPORTIONAL_GAINS = (2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
"""Gains of the proportional controller that probes for noise, volts of command per volt of position."""

Progress = Callable[[str, float], None]
"""Called with the step at hand and how much of it is done, 0 to 1."""


@dataclass(frozen=True)
class Plan:
    """Parameters of a study. display: what is simulated; seed: of all randomness; speech: a file (None: the sample)."""

    display: Display
    seed: int = 1
    speech: Path | None = None

    def seed_of(self, step: str) -> int:
        """Return a seed of its own for every step, so that one step's randomness does not hang on another's."""
        digest = hashlib.sha256(f"{self.seed}/{step}".encode()).digest()
        return int.from_bytes(digest[:4], "little")


def observers(library: ThresholdCurve) -> tuple[Observer, ...]:
    """Return three simulated subjects: less sensitive than the library curve at low frequencies, more at high (the
    paper's figure 11), each in its own way: (offset dB, tilt dB per decade, slope, lapse).
    """
    people = {"S1": (0.4, -3.2, 2.5, 0.01), "S2": (-1.2, -2.4, 3.0, 0.02), "S3": (1.1, -4.0, 2.0, 0.01)}
    return tuple(
        Observer(name, tilted(library, name, offset, tilt), Psychometric(Weibull(slope), lapse=lapse))
        for name, (offset, tilt, slope, lapse) in people.items()
    )


def tilted(library: ThresholdCurve, name: str, offset_db: float, tilt_db_per_decade: float) -> ThresholdCurve:
    """Return the library curve moved by offset + tilt log10(f / 20 Hz)."""
    moved = offset_db + tilt_db_per_decade * np.log10(library.frequency_hz / 20.0)
    source = f"{library.name} {offset_db:+g} dB {tilt_db_per_decade:+g} dB/decade about 20 Hz"
    return ThresholdCurve(name, library.frequency_hz, library.level_db_re_1um + moved, "synthetic", source)
