"""Magnitude estimation with a free modulus: any number for how strong a tone is, and the exponents that follow.

Estimates of a person are divided by their geometric mean, so that everybody's own scale falls out; geometric means over
repeats and people then represents each tone, and the exponent at a frequency is the slope of their logarithm against
that of the amplitude (Stevens 1968).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import Field

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Placement
from tactuator.experiment.task.estimate import Measured
from tactuator.experiment.task.task import AnsweredRun, Place, Planned, Task, TaskPrompt, TaskState
from tactuator.experiment.trial import Tone, Trial, trial_rng
from tactuator.experiment.words import Words
from tactuator.parameters import Positive, Whole, table
from tactuator.perception.curve import Level
from tactuator.result import Chart, ChartLine, ResultTable

_ROLE = "tone"
_EXPONENT = 0.6
"""Exponent of amplitude of simulated people, as Stevens (1968) found it at 250 Hz."""


@table("[task]")
class MagnitudeEstimation(Task):
    """Keys of `magnitude-estimation`: a tone, and a number for how strong it was."""

    finger: Annotated[str, Field(description="finger that is stimulated")]
    frequencies_hz: Annotated[tuple[Positive, ...], Field(min_length=1, description="of the tones")]
    levels_db_sl: Annotated[tuple[Level, ...], Field(min_length=2, description="of the tones")] = (
        10.0, 20.0, 30.0, 40.0, 50.0,
    )  # fmt: skip
    repeats: Annotated[Whole, Field(ge=1, le=100, description="of every tone")] = 3

    def asked(self, words: Words) -> TaskPrompt:
        return TaskPrompt(words("prompt.magnitude"))

    def fingers_used(self) -> tuple[str, ...]:
        return (self.finger,)

    @property
    def tones(self) -> tuple[Tone, ...]:
        """Return every tone once."""
        cells = ((hertz, level) for hertz in self.frequencies_hz for level in self.levels_db_sl)
        return tuple(Tone(_ROLE, self.finger, hertz, level) for hertz, level in cells)

    def placed(self, place: Place) -> Iterator[Tone]:
        yield from self.tones

    def plans(self, words: Words) -> tuple[Planned, ...]:
        return (Planned(self.finger, None, words("run.magnitudes"), float(len(self.tones) * self.repeats)),)

    def begin(self, index: int, place: Place, seed: tuple[int, ...]) -> EstimationRun:
        return EstimationRun(seed, self)

    def response_to(self, trial: Trial, felt_db_sl: Sequence[float]) -> str:
        """Return the number that a power function gives."""
        return f"{10.0 ** (_EXPONENT * felt_db_sl[0] / 20.0):.3g}"

    def results(self, runs: Sequence[AnsweredRun], words: Words) -> tuple[ResultTable, ...]:
        heads = tuple(words(f"results.{key}") for key in ("hertz", "exponent", "trials"))
        magnitude = magnitudes(runs)
        rows = tuple((f"{each.frequency_hz:.4g}", f"{each.exponent:.2f}", str(each.estimates)) for each in magnitude)
        means = tuple(
            (f"{each.frequency_hz:.4g}", f"{level:g}", f"{mean:.3g}")
            for each in magnitude
            for level, mean in zip(each.level_db_sl, each.mean, strict=True)
        )
        columns = (words("results.hertz"), "dB SL", words("results.geometric_mean"))
        return ResultTable(words("results.magnitudes"), heads, rows), ResultTable(
            words("results.geometric_mean"), columns, means
        )

    def chart(self, runs: Sequence[AnsweredRun], words: Words) -> Chart:
        """Return magnitude against level on a logarithmic axis, with the line of each frequency's exponent."""
        curves = []
        for number, each in enumerate(magnitudes(runs)):
            label = f"{each.frequency_hz:.4g} Hz: {words('results.exponent')} {each.exponent.value:.2f}"
            bars = None if each.factor is None else np.array([each.mean - each.mean / each.factor,
                                                              each.mean * each.factor - each.mean])  # fmt: skip
            curves.append(ChartLine(label, each.level_db_sl, each.mean, "o", bars, colour=number))
            curves.append(ChartLine("", each.level_db_sl, each.line, colour=number))
        return Chart("dB SL", words("results.geometric_mean"), curves, log_y=True)


@dataclass
class EstimationRun(TaskState):
    """One run: every tone `repeats` times; no tone comes again before all have come."""

    task: MagnitudeEstimation

    @property
    def share_done(self) -> float:
        return self.trials / (len(self.task.tones) * self.task.repeats)

    def draw(self, number: int) -> Trial | None:
        tones = self.task.tones
        block, place = divmod(number, len(tones))
        if block >= self.task.repeats:
            return None
        tone = tones[int(trial_rng((*self.seed, 7), block).permutation(len(tones))[place])]
        return Trial.of(number, [(tone,)], (), "", Placement(tone.level_db_sl, tone.frequency_hz))


@dataclass(frozen=True, eq=False)
class Magnitudes:
    """Estimates at one frequency over all people: level_db_sl, mean (geometric, of estimates over each person's own
    geometric mean), line (of the exponent), (levels,) each; the exponent of amplitude with its 95 % interval; the
    number of estimates. factor: by which a mean's 95 % interval goes either way, None where nothing was repeated.
    """

    frequency_hz: float
    level_db_sl: FloatArray
    mean: FloatArray
    line: FloatArray
    factor: FloatArray | None
    exponent: Measured
    estimates: int


def magnitudes(runs: Sequence[AnsweredRun]) -> tuple[Magnitudes, ...]:
    """Return the magnitudes at every frequency. Raises BadInput without two levels at one of them."""
    rows = _normalised(runs)
    magnitude = [_at(hertz, rows[rows[:, 0] == hertz]) for hertz in np.unique(rows[:, 0])]
    if not magnitude:
        raise BadInput("no magnitude was estimated", "one or more")
    return tuple(magnitude)


def _normalised(runs: Sequence[AnsweredRun]) -> FloatArray:
    """Return frequency, level and log of the estimate over the person's own mean, (estimates, 3)."""
    rows = []
    for subject in dict.fromkeys(run.subject for run in runs):
        mine = [trial for run in runs if run.subject == subject for trial in run.trials if trial.tones[0] is not None]
        logs = np.log([trial.number for trial in mine])
        for trial, log in zip(mine, logs - logs.mean(), strict=True):
            tone = trial.tones[0]
            assert tone is not None
            rows.append((tone.frequency_hz, tone.level_db_sl, float(log)))
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _at(hertz: float, rows: FloatArray) -> Magnitudes:
    amplitude, log = rows[:, 1] * np.log(10.0) / 20.0, rows[:, 2]
    levels = np.unique(rows[:, 1])
    if levels.size < 2:
        raise BadInput(f"{levels.size} level at {hertz:g} Hz", "two or more")
    line = scipy.stats.linregress(amplitude, log)
    half = float(scipy.stats.t.ppf(0.975, max(log.size - 2, 1)) * line.stderr) if log.size > 2 else np.inf
    slope = float(line.slope)
    each = [log[rows[:, 1] == level] for level in levels]
    means, counts = np.array([of.mean() for of in each]), np.array([of.size for of in each])
    drawn = np.exp(line.intercept + slope * levels * np.log(10.0) / 20.0)
    exponent = Measured(slope, slope - half, slope + half)
    return Magnitudes(float(hertz), levels, np.exp(means), drawn, _factor(each, counts), exponent, int(log.size))


def _factor(each: Sequence[FloatArray], counts: NDArray[np.intp]) -> FloatArray | None:
    """Return the factor of the means' intervals, from the scatter about the means of all levels together."""
    free = int(counts.sum()) - counts.size
    if free < 1:
        return None
    scatter = np.sqrt(sum(float(np.sum((of - of.mean()) ** 2)) for of in each) / free)
    return np.asarray(np.exp(scipy.stats.t.ppf(0.975, free) * scatter / np.sqrt(counts)))
