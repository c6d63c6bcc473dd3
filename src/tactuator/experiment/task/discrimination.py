"""Discrimination: the least difference of amplitude, frequency or time that is noticed, by any procedure.

The difference has its own scale, of which the procedure places 20 log10: dB of level, percent of frequency,
milliseconds of a gap or between two onsets. The procedure's levels, steps and limits are dB on that scale, and what it
finds is the just-noticeable difference, at the share of right answers that it aims at.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Placement, Procedure, parse_procedure
from tactuator.experiment.procedure.refit import RefitPrior, refit
from tactuator.experiment.procedure.up_down import UpDown
from tactuator.experiment.task.estimate import Measured
from tactuator.experiment.task.task import AnsweredRun, Place, Planned, ProcedureState, Task, TaskPrompt
from tactuator.experiment.trial import Tone, Trial, trial_rng
from tactuator.experiment.words import Words
from tactuator.parameters import NotNegative, Positive, Whole, kept_by, table
from tactuator.perception.curve import COMFORT_DB_SL, Level
from tactuator.result import ResultTable
from tactuator.signals.decibels import from_db

Quantity = Literal["amplitude", "frequency", "gap", "order"]
UNITS: Mapping[Quantity, str] = {"amplitude": "dB", "frequency": "%", "gap": "ms", "order": "ms"}
"""Unit of each difference."""
_START_DB = {"amplitude": 20.0, "frequency": 36.0, "gap": 40.0, "order": 44.0}
"""Difference of the first trial where none is said: 10 dB, 63 %, 100 ms, 158 ms."""
_TARGET, _BASE = "target", "base"
_JND_PRIOR = {"slope_median": 1.5}
"""Slopes in the refit: where d' is in proportion to the difference, the Weibull's is near 1.4."""
_LEAST = 1.0
"""Greatest difference where none can be played."""
_LONGEST_SHARE = 0.8
"""Longest gap, as a share of the tone around it."""


@table("[task]")
class Discrimination(Task):
    """Keys of `discrimination`: which of several tones was stronger, higher or had a gap; which finger was first."""

    of: Annotated[Quantity, Field(description="what differs; order: of the onsets at two fingers")]
    fingers: Annotated[tuple[str, ...], Field(min_length=1, description="fingers; of order: two")]
    frequencies_hz: Annotated[tuple[Positive, ...], Field(min_length=1, description="of the tones")]
    levels_db_sl: Annotated[tuple[Level, ...], Field(min_length=1, description="of the tones")] = (20.0,)
    intervals: Annotated[Whole, Field(ge=2, le=9, description="intervals of a trial; of order there is one")] = 3
    rove_db: Annotated[
        NotNegative, Field(le=10.0, description="of frequency: levels are drawn so far about the level")
    ] = 0.0
    procedure: Annotated[
        Procedure | None, *kept_by(lambda keys: None if keys is None else parse_procedure(keys), "as [procedure]")
    ] = None

    def __post_init__(self) -> None:
        if self.of == "order" and len(self.fingers) != 2:
            raise BadInput(f"{len(self.fingers)}", "two, whose order is asked for", key="fingers")
        if self.of == "order" and len(self.levels_db_sl) != 1:
            raise BadInput(f"{len(self.levels_db_sl)} of order", "one", key="levels_db_sl")
        if self.rove_db and self.of != "frequency":
            raise BadInput(f"{self.rove_db:g}", 'with `of = "frequency"`', key="rove_db")

    @property
    def guess(self) -> float:
        """Return the probability of a right guess."""
        return 0.5 if self.of == "order" else 1.0 / self.intervals

    @property
    def rule(self) -> Procedure:
        """Return the procedure: by default the paper's rule from a difference that anyone notices."""
        return UpDown(start_db_sl=_START_DB[self.of]) if self.procedure is None else self.procedure

    def greatest(self, hertz: float, level_db_sl: float, place: Place, most_db_sl: float = COMFORT_DB_SL) -> float:
        """Return the greatest difference from such a tone that can be played. most_db_sl: the highest level."""
        if self.of == "amplitude":
            return most_db_sl - level_db_sl
        if self.of == "frequency":
            return 100.0 * (place.playable.band_hz[1] / hertz - 1.0)
        return 1e3 * _LONGEST_SHARE * place.timing.duration_s(hertz) if self.of == "gap" else math.inf

    def warnings(self) -> Iterator[str]:
        yield from self.rule.warnings()

    def faults(self, place: Place) -> Iterator[BadInput]:
        rule, unit = self.rule, UNITS[self.of]
        if rule.chooses_frequency:
            yield BadInput(f"{rule.kind}, which chooses frequencies", "a procedure of levels", key="task.procedure")
        yield from rule.faults(self.guess)
        least = float(from_db(rule.expected_threshold()))
        for finger, hertz, level in self._cells():
            most = self.greatest(hertz, level, place, place.highest_db_sl(finger, hertz))
            if most <= least:
                got = f"{most:.3g} {unit} at most between tones of {hertz:g} Hz at {level:g} dB SL on finger {finger!r}"
                yield BadInput(got, f"more than {least:.3g} {unit}, where the threshold is expected")

    def placed(self, place: Place) -> Iterator[Tone]:
        for finger, hertz, level in self._cells():
            for each in self.fingers if self.of == "order" else (finger,):
                yield Tone(_BASE, each, hertz, level + self.rove_db)

    def asked(self, words: Words) -> TaskPrompt:
        prompt = words(f"prompt.{_PROMPTS[self.of]}")
        if self.of == "order":
            return TaskPrompt(prompt, tuple((finger, (str(1 + place),)) for place, finger in enumerate(self.fingers)))
        names = tuple(str(1 + interval) for interval in range(self.intervals))
        return TaskPrompt(prompt, tuple((name, (name,)) for name in names), names)

    def fingers_used(self) -> tuple[str, ...]:
        return self.fingers

    def _cells(self) -> list[tuple[str, float, float]]:
        fingers = self.fingers[:1] if self.of == "order" else self.fingers
        return [
            (finger, hertz, level) for finger in fingers for hertz in self.frequencies_hz for level in self.levels_db_sl
        ]

    def plans(self, words: Words) -> tuple[Planned, ...]:
        return tuple(
            Planned(
                finger,
                hertz,
                words("run.hertz_at", hertz=f"{hertz:g}", level=f"{level:g}"),
                self.rule.typical_trials,
            )
            for finger, hertz, level in self._cells()
        )

    def begin(self, index: int, place: Place, seed: tuple[int, ...]) -> DiscriminationRun:
        finger, hertz, level = self._cells()[index]
        most = max(self.greatest(hertz, level, place), _LEAST)
        procedure = self.rule.below(20.0 * math.log10(most)).begin(self.guess, place.playable)
        return DiscriminationRun(seed, procedure, self, finger, hertz, level, place)

    def response_to(self, trial: Trial, felt_db_sl: Sequence[float]) -> str:
        if self.of != "amplitude":
            return super().response_to(trial, felt_db_sl)
        return trial.responses[int(np.argmax(felt_db_sl))]

    def results(self, runs: Sequence[AnsweredRun], words: Words) -> tuple[ResultTable, ...]:
        heads = (
            *(words(f"results.{key}") for key in ("subject", "finger", "hertz")),
            "dB SL",
            words("results.jnd"),
            words("results.trials"),
        )
        unit = UNITS[self.of]
        rows = tuple(
            (
                run.subject,
                run.finger,
                f"{run.frequency_hz or 0.0:.4g}",
                f"{each.level_db_sl:g}",
                f"{each.jnd:.2f} {unit}",
                str(len(run.trials)),
            )
            for run, each in ((run, self.difference(run)) for run in runs)
        )
        return (ResultTable(words("results.jnd"), heads, rows),)

    def difference(self, run: AnsweredRun) -> Difference:
        """Return the just-noticeable difference of a run. Raises BadInput for one of fewer than five trials."""
        placed = [(trial.level_db_sl, trial.correct) for trial in run.trials if trial.level_db_sl is not None]
        levels, correct = np.array([level for level, _ in placed]), np.array([right for _, right in placed])
        bases = [t.level_db_sl for trial in run.trials for t in trial.tones if t is not None and t.role == _BASE]
        middle = float(np.median(bases)) if bases else self.levels_db_sl[0]
        base = min(self.levels_db_sl, key=lambda level: abs(level - middle))
        fitted = refit(levels, correct, RefitPrior(guess=self.guess, target=self.rule.point, **_JND_PRIOR))
        values = (fitted.threshold_db[0], fitted.low_db[0], fitted.high_db[0])
        return Difference(base, Measured(*(float(from_db(value)) for value in values)))


_PROMPTS = {"amplitude": "stronger_of", "frequency": "higher", "gap": "gap", "order": "first"}


@dataclass(frozen=True)
class Difference:
    """A just-noticeable difference of tones of that level, in its unit, with its 95 % interval."""

    level_db_sl: float
    jnd: Measured


@dataclass
class DiscriminationRun(ProcedureState):
    """One run: the procedure places the difference."""

    task: Discrimination
    finger: str
    frequency_hz: float
    level_db_sl: float
    place: Place

    def draw(self, number: int) -> Trial | None:
        placement = self.procedure.placement()
        if placement is None:
            return None
        rng, task = trial_rng((*self.seed, 7), number), self.task
        difference = float(from_db(placement.level_db_sl))
        at = Placement(placement.level_db_sl, self.frequency_hz)
        if task.of == "order":
            first = int(rng.integers(2))
            tones = [self._tone(_TARGET, finger=finger) for finger in task.fingers]
            late = replace(tones[1 - first], onset_s=1e-3 * difference)
            return Trial.of(number, [(tones[first], late)], task.fingers, task.fingers[first], at)
        names = tuple(str(1 + interval) for interval in range(task.intervals))
        target = int(rng.integers(task.intervals))
        roved = rng.uniform(-task.rove_db, task.rove_db, task.intervals)
        level = np.minimum(self.level_db_sl + roved, COMFORT_DB_SL)
        intervals = [
            self._changed(difference, float(level[i])) if i == target else (self._tone(_BASE, level=float(level[i])),)
            for i in range(task.intervals)
        ]
        return Trial.of(number, intervals, names, names[target], at)

    def _tone(self, role: str, finger: str | None = None, level: float | None = None) -> Tone:
        lasts_s = self.place.timing.duration_s(self.frequency_hz)
        level_db_sl = self.level_db_sl if level is None else level
        return Tone(role, finger or self.finger, self.frequency_hz, level_db_sl, duration_s=lasts_s)

    def _changed(self, difference: float, level_db_sl: float) -> tuple[Tone, ...]:
        tone = self._tone(_TARGET, level=level_db_sl)
        if self.task.of == "amplitude":
            return (replace(tone, level_db_sl=min(level_db_sl + difference, COMFORT_DB_SL)),)
        if self.task.of == "frequency":
            higher = self.frequency_hz * (1.0 + 0.01 * difference)
            return (replace(tone, frequency_hz=min(higher, self.place.playable.band_hz[1])),)
        assert tone.duration_s is not None
        silent_s = min(1e-3 * difference, _LONGEST_SHARE * tone.duration_s)
        half_s = 0.5 * (tone.duration_s - silent_s)
        return replace(tone, duration_s=half_s), replace(tone, duration_s=half_s, onset_s=half_s + silent_s)
