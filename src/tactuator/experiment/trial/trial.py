"""A trial of any paradigm: what is played in its intervals, which responses are allowed, which one is right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Placement
from tactuator.experiment.trial.stimulus import ToneInterval


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
