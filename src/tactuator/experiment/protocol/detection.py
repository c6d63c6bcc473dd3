"""Protocol files of detection studies, and the order of their conditions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import (
    ATTENTIVE_LAPSE,
    Playable,
    Practice,
    Procedure,
    Runs,
    parse_procedure,
    psi_at,
)
from tactuator.experiment.protocol.study import FORCED_CHOICE, PlannedRun, RunRules, StudyProtocol, further
from tactuator.experiment.trial import ForcedChoice, Marks, Masker, Timing
from tactuator.experiment.words import Words
from tactuator.parameters import Flag, Number, Positive, Whole, kept_by, table
from tactuator.perception.curve import Level

_USUAL_SLOPE = 2.15
"""Weibull slope of most people, the middle of the refit's prior."""
_LEAST_PASSED, _PRACTISING = 0.5, 1000
"""Share of people who pass practice below which it does not end, and how many are simulated for it."""
_PRACTICE_HZ = 100.0
"""Frequency of practice before a run that chooses its own."""


@table("[conditions]")
class Conditions:
    """Keys of [conditions]: each frequency on each finger, repeats times, in an order of the subject's own."""

    fingers: Annotated[tuple[str, ...], Field(min_length=1, description="fingers that are stimulated")]
    frequencies_hz: Annotated[tuple[Positive, ...], Field(description="none where the procedure chooses")] = ()
    order: Annotated[Literal["as-given", "random", "latin-square"], Field(description="of a subject")] = "random"
    repeats: Annotated[Whole, Field(ge=1, description="of every condition")] = 1

    def __post_init__(self) -> None:
        if len(set(self.frequencies_hz)) != len(self.frequencies_hz) or len(set(self.fingers)) != len(self.fingers):
            raise BadInput("a frequency or finger occurs twice", "each once")


@table("[session]")
class SessionRules(RunRules):
    """Keys of [session]: practice before the first run, breaks, feedback, and the longest interruption of a run.

    Where practice_limit trials do not reach the criterion, the experimenter is called and practice begins again.
    """

    practice_trials: Annotated[Whole, Field(ge=0, le=100, description="trials of practice")] = 3
    practice_correct: Annotated[
        Annotated[Whole, Field(ge=1, le=100)] | None,
        Field(description="right answers among the last practice_trials that end practice; none: it ends after them"),
    ] = None
    practice_limit: Annotated[Whole, Field(ge=1, le=1000, description="most trials of practice")] = 40
    practice_level_db_sl: Annotated[Level, Field(description="of practice")] = 30.0
    feedback: Annotated[Flag, Field(description="the right response is shown after each answer")] = True

    def __post_init__(self) -> None:
        correct, window, limit = self.practice_correct, self.practice_trials, self.practice_limit
        if correct is not None and not correct <= window <= limit:
            raise BadInput(
                f"practice: {correct} right of the last {window}, {limit} trials at most",
                "practice_correct up to practice_trials, and that up to practice_limit",
            )


LoudShare = Annotated[Number, Field(ge=0.0, le=0.5)]


@table("[catch]")
class CatchTrials:
    """Keys of [catch]: loud trials that test attention, blank ones that test for cues, besides the procedure's."""

    loud_share: Annotated[LoudShare, Field(description="share of loud trials among all")] = 0.0
    blank_share: Annotated[Number, Field(ge=0.0, le=0.3, description="share of blank trials among all")] = 0.0
    above_db: Annotated[Number, Field(ge=10.0, le=40.0, description="of a loud trial above the next level")] = 20.0


@table("protocol")
class Protocol(StudyProtocol):
    """The protocol file of a detection study."""

    procedure: Annotated[Procedure, *kept_by(parse_procedure, "a kind of procedure, with its keys")]
    conditions: Conditions
    paradigm: ForcedChoice = ForcedChoice()
    catch: CatchTrials = CatchTrials()
    session: SessionRules = SessionRules()
    timing: Timing = Timing()
    masker: Masker | None = None
    marks: Marks | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        count, chooses = len(self.conditions.frequencies_hz), self.procedure.chooses_frequency
        if chooses == bool(count):
            wanted = "none: the procedure chooses" if chooses else "one or more"
            raise BadInput(f"conditions.frequencies_hz has {count} for {self.procedure.kind}", wanted)
        self.begin(Playable())

    def begin(self, playable: Playable, count: int = 1) -> Runs:
        """Return fresh runs of the procedure, over what can be played."""
        return self.procedure.begin(self.paradigm.guess, playable, count)

    def begin_practice(self) -> Practice:
        """Return a fresh practice run."""
        rules = self.session
        limit = rules.practice_trials if rules.practice_correct is None else rules.practice_limit
        return Practice(rules.practice_level_db_sl, limit, rules.practice_trials, rules.practice_correct)

    @property
    def asks(self) -> str:
        return "detection"

    def warnings(self) -> Iterator[str]:
        yield from super().warnings()
        yield from self.procedure.warnings()

    def faults(self) -> Iterator[BadInput]:
        yield from self.procedure.faults(self.paradigm.guess)
        rules = self.session
        if rules.practice_correct is not None and self._practice_passed() < _LEAST_PASSED:
            yield BadInput(
                f"{rules.practice_correct} right of {rules.practice_trials} at {rules.practice_level_db_sl:g} dB SL, "
                f"which {100.0 * self._practice_passed():.0f} % of people reach in {rules.practice_limit} trials",
                f"a criterion that {100.0 * _LEAST_PASSED:g} % reach: a higher level, fewer right, or more trials",
                key="session.practice_correct",
            )

    def _practice_passed(self) -> float:
        """Return the share of attentive people who meet the criterion of practice, by simulation: those whose threshold
        is where the procedure expects it.
        """
        rules, expected = self.session, self.procedure.expected_threshold()
        above = np.array(rules.practice_level_db_sl - expected)
        slope, lapse = np.array(_USUAL_SLOPE), np.array(ATTENTIVE_LAPSE)
        share = float(psi_at(above, slope, lapse, self.paradigm.guess, self.procedure.point))
        rng = np.random.default_rng(self.study.seed)
        right = rng.random((_PRACTISING, rules.practice_limit)) < share
        total = np.cumsum(np.pad(right, ((0, 0), (rules.practice_trials, 0))), axis=1)
        last: NDArray[np.int_] = total[:, rules.practice_trials :] - total[:, : -rules.practice_trials]
        return float(np.mean(np.any(last >= (rules.practice_correct or 0), axis=1)))

    @property
    def frequencies_hz(self) -> tuple[float, ...]:
        return self.conditions.frequencies_hz

    def require_observers(self) -> None:
        if self.paradigm.yes_no:
            got = "1: simulated observers need several intervals"
            raise BadInput(got, "two intervals or more", key="paradigm.intervals")

    def parts(self, words: Words) -> tuple[PlannedRun, ...]:
        frequencies: tuple[float | None, ...] = self.frequencies_hz or (None,)
        cells = [(finger, hertz) for finger in self.conditions.fingers for hertz in frequencies]
        return tuple(self._run(*cell, words) for cell in cells) * self.conditions.repeats

    def practice(self, parts: Sequence[PlannedRun], order: Sequence[int], words: Words) -> Sequence[PlannedRun]:
        rules, practice = self.session, ""
        if not rules.practice_trials:
            return ()
        if rules.practice_correct is not None:
            practice = words("run.practice_text", correct=rules.practice_correct, window=rules.practice_trials)
        first = self._run(parts[0].finger, parts[0].frequency_hz or _PRACTICE_HZ, words)
        return (first.practised(rules.practice_trials, practice, words),)

    def order(self, count: int, subject: int, visit: int) -> Sequence[int]:
        """Return the order of [conditions], in which no condition comes again before all have come."""
        repeats = self.conditions.repeats
        each = count // repeats
        orders = (self._order(each, subject, repeat, visit) for repeat in range(repeats))
        return [repeat * each + index for repeat, order in enumerate(orders) for index in order]

    def _order(self, count: int, subject: int, repeat: int, visit: int) -> Sequence[int]:
        if self.conditions.order == "as-given":
            return range(count)
        if self.conditions.order == "random":
            rng = np.random.default_rng([self.study.seed, 3, subject, repeat, *further(visit)])
            return [int(index) for index in rng.permutation(count)]
        rows = latin_square(count)
        return rows[(subject + repeat + visit - 1) % len(rows)]

    def _run(self, finger: str, frequency_hz: float | None, words: Words) -> PlannedRun:
        what = words("run.whole_curve") if frequency_hz is None else words("run.hertz", hertz=f"{frequency_hz:g}")
        return PlannedRun(
            finger,
            frequency_hz,
            paradigm=FORCED_CHOICE,
            procedure=self.procedure.kind,
            feedback=self.session.feedback,
            title=words("run.title", finger=finger, what=what),
            typical_trials=self.procedure.typical_trials,
        )


def latin_square(count: int) -> list[list[int]]:
    """Return the rows of a Williams design: each condition once in each place, and as often after each other one.

    There are count rows for an even count, twice as many for an odd one (Williams 1949).
    """
    first = [index // 2 if index % 2 == 0 else count - 1 - index // 2 for index in range(count)]
    rows = [[(value + shift) % count for value in first] for shift in range(count)]
    return rows + [row[::-1] for row in rows] if count % 2 else rows
