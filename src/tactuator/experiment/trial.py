"""A trial of any paradigm: what is played in its intervals and when, which responses are allowed, which is right."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import scipy
from pydantic import Field

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Placement
from tactuator.io.cells import check_commas, decimal_point
from tactuator.parameters import Number, Positive, Seconds, Whole, table
from tactuator.perception.curve import COMFORT_DB_SL, Level
from tactuator.signals.decibels import from_db
from tactuator.signals.excitation import ramps, tone


@table("[timing]")
class Timing:
    """Keys of [timing]: durations of the parts of a trial."""

    stimulus_s: Annotated[Seconds, Field(gt=0.0, description="each interval, or `periods` of a slow tone")] = 0.5
    ramp_s: Annotated[Seconds, Field(description="ramp at both ends of an interval, inside it")] = 0.1
    gap_s: Annotated[Seconds, Field(description="silence between intervals")] = 0.3
    lead_s: Annotated[Seconds, Field(description="silence before the first interval")] = 0.3
    periods: Annotated[Positive, Field(description="fewest periods of a tone")] = 2.0
    feedback_s: Annotated[Seconds, Field(description="time for which feedback is shown")] = 0.4

    def __post_init__(self) -> None:
        if 2.0 * self.ramp_s > self.stimulus_s:
            raise BadInput(f"ramps of {self.ramp_s:g} s in {self.stimulus_s:g} s", "half of it at most")

    def duration_s(self, frequency_hz: float) -> float:
        """Return the duration of one interval at that frequency."""
        return max(self.stimulus_s, self.periods / frequency_hz)

    def ramp_at_s(self, frequency_hz: float) -> float:
        """Return the duration of each ramp, in proportion to the interval: slow tones begin as gently as fast ones."""
        return self.ramp_s * self.duration_s(frequency_hz) / self.stimulus_s

    def played_s(self, frequency_hz: float, intervals: int, marks: Marks | None) -> float:
        """Return how long a trial of so many intervals at that frequency plays."""
        marked_s = 0.0 if marks is None else marks.duration_s(intervals)
        return self.lead_s + intervals * self.duration_s(frequency_hz) + (intervals - 1) * self.gap_s + marked_s

    def clearance_hz(self, frequency_hz: float) -> float:
        """Return the distance that a tone keeps from a mains line: the reciprocal of its duration, at least 2 Hz.

        That is where the spectrum of a tone without ramps has its first zero.
        """
        return max(2.0, 1.0 / self.duration_s(frequency_hz))


@table("[masker]")
class Masker:
    """Keys of [masker], which is played in every interval of a trial under the stimulus."""

    kind: Annotated[Literal["tone", "noise"], Field(description="a tone, or noise of one third-octave")]
    frequency_hz: Annotated[Positive, Field(description="of the tone, or the middle of the noise")]
    level_db_sl: Annotated[Level, Field(description="of the tone; noise has the rms of a sinusoid of this level")]
    channel: Annotated[str | None, Field(description="where it is played; none: the stimulus's own channel")] = None

    def wave(self, count: int, rate_hz: float, ramp_s: float, rng: np.random.Generator) -> FloatArray:
        """Return the masker's signal, shape (count,), in threshold units."""
        amplitude = float(from_db(self.level_db_sl))
        if self.kind == "tone":
            return tone(self.frequency_hz, amplitude, count / rate_hz, rate_hz, ramp_s=ramp_s)
        edge = 10.0 ** (1.0 / 20.0)
        band = [self.frequency_hz / edge, self.frequency_hz * edge]
        noise = scipy.signal.sosfilt(
            scipy.signal.butter(2, band, "bandpass", fs=rate_hz, output="sos"), rng.standard_normal(2 * count)
        )[count:]
        return np.asarray(amplitude / np.sqrt(2.0) * noise / np.std(noise) * ramps(count, rate_hz, ramp_s))


_Tap = Annotated[Seconds, Field(le=5.0)]


@table("[marks]")
class Marks:
    """Keys of [marks]: taps before each interval (one, then two ...), and a long one when all are over."""

    channel: Annotated[str, Field(description="where taps are played")]
    frequency_hz: Annotated[Positive, Field(description="of a tap")] = 60.0
    level_db_sl: Annotated[Level, Field(description="of a tap")] = 25.0
    tap_s: Annotated[_Tap, Field(gt=0.0, description="length of a tap")] = 0.08
    pause_s: Annotated[_Tap, Field(description="silence between taps")] = 0.12
    after_s: Annotated[_Tap, Field(description="silence before the interval: no tap masks what follows")] = 0.5

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
class Tone:
    """A tone of an interval. role: what it is for (standard, comparison ...), without a colon.

    level_db_sl: -inf for silence. onset_s: from the interval's beginning. duration_s: None as the protocol's [timing]
    has it. measured_db_sl: at the sensor, None where that is unknown. Raises BadInput for a level above comfort.
    """

    role: str
    finger: str
    frequency_hz: float
    level_db_sl: float
    onset_s: float = 0.0
    duration_s: float | None = None
    measured_db_sl: float | None = None

    def __post_init__(self) -> None:
        if self.level_db_sl > COMFORT_DB_SL + 1e-9:
            raise BadInput(f"tone of {self.level_db_sl:g} dB SL", f"{COMFORT_DB_SL:g} at most")

    @property
    def label(self) -> str:
        """Role, finger and frequency as the store has them of an interval with this one tone."""
        return f"{self.role}:{self.finger}:{self.frequency_hz:.10g}"

    def lasts_s(self, timing: Timing) -> float:
        """Return its duration."""
        return timing.duration_s(self.frequency_hz) if self.duration_s is None else self.duration_s

    def ramp_s(self, timing: Timing) -> float:
        """Return the duration of its ramps, in proportion to the tone where that is shorter than an interval."""
        usual_s = timing.duration_s(self.frequency_hz)
        return timing.ramp_at_s(self.frequency_hz) * min(1.0, self.lasts_s(timing) / usual_s)


@dataclass(frozen=True)
class Trial:
    """One trial of a run.

    number: counted from 0 in its run. stimuli: one label for each interval, as in the store's stimulus table.
    responses: the allowed ones, in the order in which they are offered; none: any positive number is allowed. correct:
    the right response; where none is right, the one that counts as yes, or "" of a number. placement: where an adaptive
    procedure put the trial, None elsewhere. tones: of each interval, where tones are played. Raises BadInput where the
    right response is not an allowed one.
    """

    number: int
    stimuli: tuple[str, ...]
    responses: tuple[str, ...]
    correct: str
    placement: Placement | None = None
    tones: tuple[tuple[Tone, ...], ...] = ()

    @classmethod
    def of(
        cls,
        number: int,
        tones: Sequence[Sequence[Tone]],
        responses: tuple[str, ...],
        correct: str,
        placement: Placement | None = None,
    ) -> Trial:
        """Return a trial with those tones in each interval, labelled as the store has them."""
        labels = tuple("+".join(tone.label for tone in interval) for interval in tones)
        return cls(number, labels, responses, correct, placement, tuple(tuple(interval) for interval in tones))

    def __post_init__(self) -> None:
        if self.correct not in (self.responses or ("",)):
            raise BadInput(f"trial: correct response {self.correct!r}", f"{', '.join(self.responses)}")

    def as_stored(self, response: str) -> str:
        """Return the response as exports have it: a number in digits and with a point, however it was typed."""
        return response if self.responses else f"{number_of(response):.15g}"

    def judge(self, response: str) -> bool:
        """Return whether the response is the one that `correct` names. Raises BadInput if it is not allowed."""
        if not self.responses:
            number_of(response)
            return False
        if response not in self.responses:
            raise BadInput(f"response {response!r}", f"{', '.join(self.responses)}")
        return response == self.correct


_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff]")
"""What no free text of a store has: a server refuses some of it, exports would have it and spreadsheets stop at it."""


def without_controls(text: str) -> str:
    """Return a free text. Raises BadInput for one with a control character."""
    if _CONTROL.search(text):
        raise BadInput(f"the text {text[:60]!r} has a control character", "a text without")
    return text


def typed_number(text: str) -> float:
    """Return the number that a person typed, with a point or a comma, in the digits of any script.

    Raises BadInput for anything else, and for a comma that may as well part thousands.
    """
    plain = "".join(str(unicodedata.decimal(sign, sign)) for sign in text.strip())
    plain = plain.replace("\u2212", "-").replace("\u066b", ",")
    check_commas([plain])
    try:
        number = math.nan if "_" in plain else float(decimal_point(plain))
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise BadInput(repr(text), "a number")
    return number


def number_of(response: str) -> float:
    """Return the number that was answered. Raises BadInput for what is not one above zero."""
    try:
        number = typed_number(response)
    except BadInput as error:
        raise BadInput(f"response {error.got}", "a number above 0") from None
    if number <= 0.0:
        raise BadInput(f"response {response!r}", "a number above 0")
    return number


@dataclass(frozen=True)
class IntervalRecord:
    """An interval of a trial as it was played.

    commanded_db_sl: None where nothing was played, or no one level. measured_db_sl: at the sensor, at the stimulus's
    frequency; None where there is no one frequency. onset_s, duration_s: by the rig's own clock, from the trial's first
    sample. cue_delay_s: how far the rig was past the onset when the visual cue was shown. The times are None in stores
    that were made before they were recorded.
    """

    stimulus: str
    commanded_db_sl: float | None
    measured_db_sl: float | None
    saturated: bool
    onset_s: float | None = None
    duration_s: float | None = None
    cue_delay_s: float | None = None


BLANK, SIGNAL, LOUD = "blank", "tone", "loud"
"""Labels of the stimuli of a detection trial; LOUD is that of a catch trial that anyone attentive gets right."""


FELT, NOT_FELT = "1", "0"
"""Responses to a single interval."""


@table("[paradigm]")
class ForcedChoice:
    """Keys of [paradigm], detection in one of m intervals; the responses are "1" to str(m).

    One interval is yes or no: "1" says that it was felt, "0" that it was not, and blank catch trials show who says yes
    to nothing.
    """

    intervals: Annotated[Whole, Field(ge=1, le=9, description="intervals of a trial; 1: felt or not")] = 3
    false_alarms: Annotated[
        Number, Field(ge=0.01, le=0.3, description="share of blank trials taken to be felt, of one interval")
    ] = 0.02

    @property
    def yes_no(self) -> bool:
        """Return whether a subject says that it was felt, or not."""
        return self.intervals == 1

    @property
    def guess(self) -> float:
        """Return the probability of a correct guess; of one interval, that nothing is taken to be felt."""
        return self.false_alarms if self.yes_no else 1.0 / self.intervals

    @property
    def responses(self) -> tuple[str, ...]:
        """Return one key for each interval, or those of yes and no."""
        if self.yes_no:
            return (FELT, NOT_FELT)
        return tuple(str(1 + interval) for interval in range(self.intervals))

    def trial(self, number: int, finger: str, at: Placement, seed: Sequence[int], label: str = SIGNAL) -> Trial:
        """Return the trial of that number; the interval with the tone depends on the seed and the number alone.

        at: with its frequency. label: of the interval that is asked for; with BLANK nothing is played in any interval.
        """
        assert at.frequency_hz is not None
        target = 0 if self.yes_no else int(trial_rng(seed, number).integers(self.intervals))
        stimuli = tuple(label if interval == target else BLANK for interval in range(self.intervals))
        correct = self.responses[target]
        if self.yes_no:
            correct = NOT_FELT if label == BLANK else FELT
        levels = [-math.inf if each == BLANK else at.level_db_sl for each in stimuli]
        tones = tuple(
            (Tone(each, finger, at.frequency_hz, level),) for each, level in zip(stimuli, levels, strict=True)
        )
        return Trial(number, stimuli, self.responses, correct, at, tones)


def trial_rng(seed: Sequence[int], number: int) -> np.random.Generator:
    """Return the random generator of one trial, which is the same after any interruption."""
    return np.random.default_rng([*seed, number])
