"""Stimuli of one interval: a reference for a channel, in threshold units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import signal as scipy_signal

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.trial.timing import Timing
from tactuator.perception.curve import COMFORT_DB_SL
from tactuator.signals.decibels import from_db
from tactuator.signals.excitation import ramps, tone


@dataclass(frozen=True)
class Masker:
    """Masker that is played in every interval of a trial under the stimulus: a tone, or noise of one third-octave.

    level_db_sl: of the tone; noise has the rms of a sinusoid of this level. channel: None for the stimulus's own.
    Raises BadInput for values that cannot be.
    """

    kind: Literal["tone", "noise"]
    frequency_hz: float
    level_db_sl: float
    channel: str | None = None

    def __post_init__(self) -> None:
        if self.kind not in ("tone", "noise"):
            raise BadInput(f"masker: kind {self.kind!r}", "tone, noise")
        if not self.frequency_hz > 0.0:
            raise BadInput(f"masker: frequency_hz is {self.frequency_hz:g}", "a positive number")
        if not self.level_db_sl <= COMFORT_DB_SL:
            raise BadInput(f"masker: level_db_sl is {self.level_db_sl:g}", f"{COMFORT_DB_SL:g} at most")

    def wave(self, count: int, rate_hz: float, ramp_s: float, rng: np.random.Generator) -> FloatArray:
        """Return the masker's signal, shape (count,), in threshold units."""
        amplitude = float(from_db(self.level_db_sl))
        if self.kind == "tone":
            return tone(self.frequency_hz, amplitude, count / rate_hz, rate_hz, ramp_s=ramp_s)
        edge = 10.0 ** (1.0 / 20.0)
        band = [self.frequency_hz / edge, self.frequency_hz * edge]
        noise = scipy_signal.sosfilt(
            scipy_signal.butter(2, band, "bandpass", fs=rate_hz, output="sos"), rng.standard_normal(2 * count)
        )[count:]
        return np.asarray(amplitude / np.sqrt(2.0) * noise / np.std(noise) * ramps(count, rate_hz, ramp_s))


@dataclass(frozen=True)
class ToneInterval:
    """One interval of a detection trial: a tone of frequency_hz at level_db_sl, or nothing (level None).

    Raises BadInput for a level above comfort.
    """

    frequency_hz: float
    level_db_sl: float | None

    def __post_init__(self) -> None:
        if self.level_db_sl is not None and self.level_db_sl > COMFORT_DB_SL + 1e-9:
            raise BadInput(f"stimulus of {self.level_db_sl:g} dB SL", f"{COMFORT_DB_SL:g} at most")

    def wave(self, rate_hz: float, timing: Timing) -> FloatArray:
        """Return the interval's signal, shape (n,), in threshold units."""
        duration = timing.duration_s(self.frequency_hz)
        if self.level_db_sl is None:
            return np.zeros(round(duration * rate_hz))
        amplitude = float(from_db(self.level_db_sl))
        return tone(self.frequency_hz, amplitude, duration, rate_hz, ramp_s=timing.ramp_at_s(self.frequency_hz))
