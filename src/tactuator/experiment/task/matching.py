"""Matching of intensity: a standard and a comparison at another frequency or finger, and which was stronger.

`contour`: one run in which every match is placed where it is most informative about all contours, as `curve` does for
thresholds. `pairs`: for every frequency, finger and level, tracks that begin above and below equality and end at 70.7
and 29.3 % "comparison stronger", interleaved at random (Levitt 1971; Jesteadt 1980, Perception & Psychophysics 28:85).
Either tone of a pair serves as standard equally often, and so does either order: both biases are then found beside the
match.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Placement
from tactuator.experiment.procedure.up_down import Tracks, UpDown
from tactuator.experiment.task.estimate import Equality, StrengthEstimate, equality, estimate
from tactuator.experiment.task.intensity import FREE
from tactuator.experiment.task.matches import Candidates, ContourSetting, Fit, Matches, Placed, fit, most_telling
from tactuator.experiment.task.task import Answered, AnsweredRun, Place, Planned, Task, TaskPrompt, TaskState
from tactuator.experiment.trial import Tone, Trial, trial_rng
from tactuator.experiment.words import Words
from tactuator.parameters import Band, Positive, Whole, table
from tactuator.perception.contours import REFERENCE_HZ
from tactuator.perception.curve import COMFORT_DB_SL, Level, ThresholdCurve
from tactuator.result import ResultTable
from tactuator.signals.spectra import off_mains

STANDARD, COMPARISON = "standard", "comparison"
INTERVALS = ("1", "2")
_SAME_HZ = 1e-6
_OFFSET_SD = 1.0
"""Scatter of matches about equal strength, in standard deviations of a comparison: noise and biases show there."""
_STEPS = 2
_TRIALS_A_TRACK = 4.0
"""Trials for a reversal of a track, about."""
_TRACK_TRIALS_MAX = 60
_CURVE_POINTS = 3
"""Frequencies from which the display's curve is taken between them."""


@table("[task]")
class Matching(Task):
    """Keys of `matching`: a standard and a comparison in two intervals, and which was stronger."""

    finger: Annotated[str, Field(description="finger of the standard")]
    frequency_hz: Annotated[Positive, Field(description="of the standard, the contours' reference")] = REFERENCE_HZ
    levels_db_sl: Annotated[tuple[Level, ...], Field(min_length=1, description="levels of the standard")] = (
        10.0, 20.0, 30.0, 40.0, 50.0,
    )  # fmt: skip
    comparison_fingers: Annotated[tuple[str, ...], Field(description="fingers of comparisons; none: the same")] = ()
    method: Annotated[
        Literal["contour", "pairs"],
        Field(description="each match where it is most informative about all contours, or pairs of up-down tracks"),
    ] = "contour"
    comparisons_hz: Annotated[tuple[Positive, ...], Field(description="of `pairs`: frequencies of comparisons")] = ()
    band_hz: Annotated[Band, Field(description="of `contour`: the band of comparisons")] = (10.0, 300.0)
    points: Annotated[Whole, Field(ge=3, le=60, description="of `contour`: frequencies over the band")] = 20
    trials: Annotated[Whole, Field(ge=20, le=2000, description="of `contour`: trials of a run")] = 200
    reversals: Annotated[Whole, Field(ge=2, description="of `pairs`: reversals that end a track")] = 6
    start_db: Annotated[Positive, Field(description="of `pairs`: first comparison above and below the standard")] = 8.0
    steps_db: Annotated[tuple[Positive, ...], Field(min_length=1, description="of `pairs`: as of `up-down`")] = (
        4.0, 4.0, 2.0,
    )  # fmt: skip

    def __post_init__(self) -> None:
        if (self.method == "pairs") != bool(self.comparisons_hz):
            wanted = "one or more" if self.method == "pairs" else "none: the method chooses"
            raise BadInput(f"{len(self.comparisons_hz)} for {self.method}", wanted, key="comparisons_hz")
        itself = [hertz for hertz in self.comparisons_hz if abs(hertz - self.frequency_hz) < _SAME_HZ]
        if itself and self.finger in self.fingers_compared:
            raise BadInput(f"{itself[0]:g}", "other frequencies than the standard's, or another finger")
        if not self.band_hz[0] <= self.frequency_hz <= self.band_hz[1]:
            raise BadInput(f"{self.frequency_hz:g}", "within band_hz", key="frequency_hz")

    @property
    def fingers_compared(self) -> tuple[str, ...]:
        """Return the fingers of comparisons."""
        return self.comparison_fingers or (self.finger,)

    @property
    def setting(self) -> ContourSetting:
        """Return reference and band of the contours."""
        return ContourSetting(self.frequency_hz, self.band_hz)

    @property
    def typical_trials(self) -> float:
        """Return about how many trials a run has."""
        if self.method == "contour":
            return float(self.trials)
        return _TRIALS_A_TRACK * self.reversals * len(list(self._tracks()))

    def _tracks(self) -> Iterator[tuple[float, bool, bool]]:
        """Yield level of the standard, whether the comparison serves as that, and whether it begins above."""
        for level in self.levels_db_sl:
            for swapped in (False, True):
                for above in (False, True):
                    yield level, swapped, above

    def asked(self, words: Words) -> TaskPrompt:
        return TaskPrompt(words("prompt.stronger"), tuple((name, (name,)) for name in INTERVALS), INTERVALS)

    def fingers_used(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys((self.finger, *self.fingers_compared)))

    def _cells(self) -> list[tuple[str, float | None]]:
        frequencies: tuple[float | None, ...] = self.comparisons_hz or (None,)
        return [(finger, hertz) for finger in self.fingers_compared for hertz in frequencies]

    def plans(self, words: Words) -> tuple[Planned, ...]:
        return tuple(
            Planned(
                finger,
                hertz,
                words("run.contours" if hertz is None else "run.hertz", hertz=f"{hertz or 0.0:g}"),
                self.typical_trials,
            )
            for finger, hertz in self._cells()
        )

    def begin(self, index: int, place: Place, seed: tuple[int, ...]) -> ContourRun | PairsRun:
        finger, hertz = self._cells()[index]
        if hertz is None:
            return ContourRun(seed, self, finger, self._candidates(place))
        return PairsRun(seed, self, finger, hertz)

    def _candidates(self, place: Place) -> Candidates:
        playable = place.playable
        band = (max(self.band_hz[0], playable.band_hz[0]), min(self.band_hz[1], playable.band_hz[1]))
        if not band[0] < self.frequency_hz < band[1]:
            raise BadInput(f"band {band[0]:g} to {band[1]:g} Hz", f"with {self.frequency_hz:g} Hz inside")
        hertz = np.geomspace(*band, self.points)
        clear = off_mains(hertz, playable.mains_hz, playable.clearance_hz, band)
        return Candidates(clear[np.abs(clear - self.frequency_hz) > _SAME_HZ], np.array(self.levels_db_sl))

    def placed(self, place: Place) -> Iterator[Tone]:
        """Yield the standards, and each comparison at their levels, where it may be as strong."""
        of_contour = self._candidates(place).frequency_hz.tolist() if self.method == "contour" else ()
        frequencies = self.comparisons_hz or of_contour
        cells = [(finger, hertz) for finger in self.fingers_compared for hertz in frequencies]
        for level in self.levels_db_sl:
            yield Tone(STANDARD, self.finger, self.frequency_hz, level)
            yield from (Tone(COMPARISON, finger, hertz, level) for finger, hertz in cells)

    def match(self, number: int, finger: str, placed: Placed, swapped: bool, second: bool) -> Trial:
        """Return the trial of a match. swapped: the comparison serves as standard. second: it is in interval 2.

        Placed is the tone that does not serve as standard, so that the display's curve is kept at the reference too.
        """
        roles = (STANDARD, COMPARISON) if swapped else (COMPARISON, STANDARD)
        comparison = Tone(roles[0], finger, placed.frequency_hz, placed.comparison_db_sl)
        reference = Tone(roles[1], self.finger, self.frequency_hz, placed.reference_db_sl)
        tones = (reference, comparison) if second else (comparison, reference)
        free = reference if swapped and finger == self.finger else comparison
        at = Placement(free.level_db_sl, free.frequency_hz)
        return Trial.of(number, [(tone,) for tone in tones], INTERVALS, INTERVALS[second], at)

    def is_reference(self, tone: Tone) -> bool:
        """Return whether a tone is at the reference frequency and finger."""
        return tone.finger == self.finger and abs(tone.frequency_hz - self.frequency_hz) < _SAME_HZ

    def row(self, tones: Sequence[Tone | None], stronger: bool) -> Row:
        """Return a match for `Matches.of`, by levels at the sensor where both are known. Raises BadInput for others."""
        both = [tone for tone in tones if tone is not None]
        at = [self.is_reference(tone) for tone in both]
        if len(both) != len(INTERVALS) or sum(at) != 1:
            raise BadInput(f"a trial of {len(both)} tones", "a match of the task")
        reference, comparison = both[at.index(True)], both[at.index(False)]
        swapped = comparison.role == STANDARD
        level, other = comparison.measured_db_sl, reference.measured_db_sl
        if level is None or other is None:
            level, other = comparison.level_db_sl, reference.level_db_sl
        return (comparison.frequency_hz, level, other, at[0], swapped, stronger)

    def matches(self, trials: Sequence[Answered]) -> Matches:
        """Return the matches of stored trials."""
        return Matches.of([self.row(trial.tones, trial.correct) for trial in trials])

    def setting_of(self, trials: Sequence[Answered]) -> ContourSetting:
        """Return the setting of matches on the standard's finger, with the display's curve if they name it."""
        known = sorted(dict(trial.curve_point for trial in trials if trial.curve_point is not None).items())
        if len(known) < _CURVE_POINTS or not known[0][0] < self.frequency_hz < known[-1][0]:
            return self.setting
        hertz, level = np.array(known).T
        curve = ThresholdCurve("display's", hertz, level, "measured", "as matches were played")
        return replace(self.setting, curve=curve)

    def response_to(self, trial: Trial, felt_db_sl: Sequence[float]) -> str:
        return trial.responses[int(np.argmax(felt_db_sl))]

    def results(self, runs: Sequence[AnsweredRun], words: Words) -> tuple[ResultTable, ...]:
        """Return the points of subjective equality of pairs, and of contours the function with biases and JND."""
        mine = [run for run in runs if run.finger == self.finger]
        trials = [trial for run in mine for trial in run.trials]
        contours = self.method == "contour" and mine
        result = [estimate(self.matches(trials), self.setting_of(trials))] if contours else []
        pairs = [] if self.method == "contour" else [(run, self.equality(run)) for run in runs]
        return tuple([evidence_table(each, words) for each in result] + ([pairs_table(pairs, words)] if pairs else []))

    def equality(self, run: AnsweredRun) -> Equality:
        """Return the point of subjective equality of a run of one pair, over its levels."""
        return equality(self.matches(run.trials), self.setting)


Row = tuple[float, float, float, bool, bool, bool]


def evidence_table(result: StrengthEstimate, words: Words) -> ResultTable:
    """Return the results of the matches of contours: function, biases and JND."""
    rows = [(name, f"{100.0 * share:.0f} %") for name, share in result.evidence.items()]
    rows.append((words("results.jnd"), f"{result.jnd_db:.1f} dB"))
    rows.append((words("results.order_bias"), f"{result.order_db:+.1f} dB"))
    rows.append((words("results.standard_bias"), f"{result.standard_db:+.1f} dB"))
    note = words("results.intensity_function", name=result.intensity_function)
    return ResultTable(
        words("results.strength"), (words("results.intensity_functions"), words("results.share")), tuple(rows), (note,)
    )


def pairs_table(pairs: Sequence[tuple[AnsweredRun, Equality]], words: Words) -> ResultTable:
    """Return a row for each pair: how far the comparison lies above the standard that is as strong, biases, JND."""
    heads = [
        words(f"results.{key}")
        for key in ("subject", "finger", "hertz", "trials", "equal_at", "order_bias", "standard_bias", "jnd")
    ]
    rows = tuple(
        (
            run.subject,
            run.finger,
            f"{run.frequency_hz or 0.0:.4g}",
            str(match.matches),
            f"{match.above_db:+.1f}",
            f"{match.order_db:+.1f}",
            f"{match.standard_db:+.1f}",
            f"{match.jnd_db.value:.1f}",
        )
        for run, match in pairs
    )
    return ResultTable(words("results.strength"), tuple(heads), rows)


@dataclass
class ContourRun(TaskState):
    """One run of `contour`."""

    task: Matching
    finger: str
    candidates: Candidates
    rows: list[Row] = field(init=False, default_factory=list)
    known: Fit = field(init=False)

    def __post_init__(self) -> None:
        self.known = fit(FREE, self.task.setting, Matches.of([]))

    @property
    def share_done(self) -> float:
        return self.trials / self.task.trials

    def draw(self, number: int) -> Trial | None:
        if number >= self.task.trials:
            return None
        turn = self._in_turn(7, 4, number)
        level_db_sl = self.task.levels_db_sl[self._in_turn(9, len(self.task.levels_db_sl), number)]
        offset = float(trial_rng((*self.seed, 8), number).normal(0.0, _OFFSET_SD))
        second, swapped = bool(turn & 1), bool(turn & 2)
        placed = most_telling(self.known, self.candidates, level_db_sl, offset, second, swapped)
        return self.task.match(number, self.finger, placed, swapped, second)

    def _in_turn(self, draw: int, count: int, number: int) -> int:
        """Return which of so many it is at that trial: each once, in an order that is drawn, then each once again."""
        block, place = divmod(number, count)
        return int(trial_rng((*self.seed, draw), block).permutation(count)[place])

    def learn(self, trial: Trial, response: str, correct: bool) -> None:
        self.rows.append(self.task.row([interval[0] for interval in trial.tones], correct))
        self.known = fit(FREE, self.task.setting, Matches.of(self.rows), start=self.known.place, steps=_STEPS)


@dataclass
class PairsRun(TaskState):
    """One run of `pairs`: the tracks of all levels at one frequency and finger, interleaved."""

    task: Matching
    finger: str
    frequency_hz: float
    tracks: list[tuple[float, bool, Tracks]] = field(init=False)

    def __post_init__(self) -> None:
        self.tracks = [(level, swapped, self._track(level, above)) for level, swapped, above in self.task._tracks()]

    def _track(self, level_db_sl: float, above: bool) -> Tracks:
        """Return a track of the tone that varies: from above it ends at 70.7 % stronger, from below at 29.3 %."""
        down, up = (2, 1) if above else (1, 2)
        start = level_db_sl + (self.task.start_db if above else -self.task.start_db)
        procedure = UpDown(
            start_db_sl=min(max(start, 0.0), COMFORT_DB_SL), down=down, up=up, steps_db=self.task.steps_db,
            reversals=self.task.reversals, averaged=max(1, self.task.reversals - 2), floor_db_sl=-5.0,
            trial_limit=_TRACK_TRIALS_MAX,
        )  # fmt: skip
        return procedure.begin()

    @property
    def share_done(self) -> float:
        return float(np.mean([track.progress() for _, _, track in self.tracks]))

    def draw(self, number: int) -> Trial | None:
        which = self._drawn(number)
        if which is None:
            return None
        level, swapped, track = self.tracks[which]
        placement = track.placement()
        assert placement is not None
        varied = placement.level_db_sl
        comparison, reference = (level, varied) if swapped else (varied, level)
        block, place = divmod(int(track.trials[0]), 2)
        second = bool(trial_rng((*self.seed, 7, which), block).permutation(2)[place])
        return self.task.match(number, self.finger, Placed(self.frequency_hz, comparison, reference), swapped, second)

    def _drawn(self, number: int) -> int | None:
        going = [index for index, (_, _, track) in enumerate(self.tracks) if not track.over[0]]
        return going[int(trial_rng((*self.seed, 8), number).integers(len(going)))] if going else None

    def learn(self, trial: Trial, response: str, correct: bool) -> None:
        which = self._drawn(trial.number)
        assert which is not None
        _, swapped, track = self.tracks[which]
        track.record(correct != swapped)
