"""A trial of any paradigm: what is played in its intervals and when, which responses are allowed, which is right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import signal as scipy_signal

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Placement
from tactuator.perception.curve import COMFORT_DB_SL
from tactuator.signals.decibels import from_db
from tactuator.signals.excitation import ramps, tone


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


@dataclass(frozen=True)
class Trial:
    """One trial of a run.

    number: counted from 0 in its run. stimuli: one label for each interval, as in the store's stimulus table.
    responses: the allowed ones, in the order in which they are offered. correct: the right one. placement: where an
    adaptive procedure put the trial, None elsewhere. Raises BadInput where the right response is not an allowed one.
    """

    number: int
    stimuli: tuple[str, ...]
    responses: tuple[str, ...]
    correct: str
    placement: Placement | None = None

    def __post_init__(self) -> None:
        if self.correct not in self.responses:
            raise BadInput(f"trial: correct response {self.correct!r}", f"{', '.join(self.responses)}")

    def judge(self, response: str) -> bool:
        """Return whether the response is right. Raises BadInput if it is not among the allowed ones."""
        if response not in self.responses:
            raise BadInput(f"response {response!r}", f"{', '.join(self.responses)}")
        return response == self.correct


@dataclass(frozen=True)
class IntervalRecord:
    """An interval of a trial as it was played.

    commanded_db_sl: None where nothing was played, or no one level. measured_db_sl: at the sensor, at the stimulus's
    frequency; None where there is no one frequency. onset_s, duration_s: by the rig's own clock, from the trial's first
    sample. lamp_late_s: how far the rig was past the onset when the lamp was lit. The times are None in stores that
    were made before they were recorded.
    """

    stimulus: str
    commanded_db_sl: float | None
    measured_db_sl: float | None
    saturated: bool
    onset_s: float | None = None
    duration_s: float | None = None
    lamp_late_s: float | None = None


BLANK, SIGNAL, LOUD = "blank", "tone", "loud"
"""Labels of the stimuli of a detection trial; LOUD is that of a catch trial that anyone attentive gets right."""


@dataclass(frozen=True)
class ForcedChoice:
    """Detection in one of m intervals; the responses are "1" to str(m). Raises BadInput for fewer than 2 or more than
    9.
    """

    intervals: int = 3

    def __post_init__(self) -> None:
        if not 2 <= self.intervals <= 9:
            raise BadInput(f"forced choice among {self.intervals} intervals", "2 to 9")

    @property
    def guess(self) -> float:
        """Return the probability of a correct guess."""
        return 1.0 / self.intervals

    @property
    def responses(self) -> tuple[str, ...]:
        """Return one key for each interval."""
        return tuple(str(1 + interval) for interval in range(self.intervals))

    def trial(self, number: int, placement: Placement, seed: Sequence[int], label: str = SIGNAL) -> Trial:
        """Return the trial of that number; the interval with the tone depends on the seed and the number alone.

        label: of the interval that is asked for; with BLANK nothing is played in any interval.
        """
        target = int(trial_rng(seed, number).integers(self.intervals))
        stimuli = tuple(label if interval == target else BLANK for interval in range(self.intervals))
        return Trial(number, stimuli, self.responses, self.responses[target], placement)

    def tones(self, trial: Trial, frequency_hz: float) -> tuple[ToneInterval, ...]:
        """Return the tone, or silence, of each interval."""
        assert trial.placement is not None
        level = trial.placement.level_db_sl
        return tuple(ToneInterval(frequency_hz, None if label == BLANK else level) for label in trial.stimuli)


def trial_rng(seed: Sequence[int], number: int) -> np.random.Generator:
    """Return the random generator of one trial, which is the same after any interruption."""
    return np.random.default_rng([*seed, number])
