"""Protocol files of detection studies, and the runs that a subject of one does, in their order."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Playable, Practice, Procedure, Runs, parse_procedure
from tactuator.experiment.protocol.study import FORCED_CHOICE, PlannedRun, RunRules, StudyProtocol, further, no_curve
from tactuator.experiment.trial import ForcedChoice, Marks, Masker, Timing
from tactuator.experiment.words import Words, shipped_words
from tactuator.parameters import Flag, Number, Positive, Whole, kept_by, table
from tactuator.perception.curve import Level


@table("[conditions]")
class Conditions:
    """Keys of [conditions]: each frequency on each finger, repeats times, in an order of the subject's own."""

    fingers: Annotated[tuple[str, ...], Field(min_length=1, description="fingers that are stimulated")]
    frequencies_hz: Annotated[tuple[Positive, ...], Field(description="none where the procedure chooses")] = ()
    order: Annotated[Literal["as-given", "random", "latin-square"], Field(description="of a subject")] = "random"
    repeats: Annotated[Whole, Field(ge=1, description="of every condition")] = 1

    def __post_init__(self) -> None:
        if len(set(self.frequencies_hz)) != len(self.frequencies_hz) or len(set(self.fingers)) != len(self.fingers):
            raise BadInput("a frequency or finger stands twice", "each once")


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
    feedback: Annotated[Flag, Field(description="the right response is told after each answer")] = True

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

    @property
    def warning(self) -> str:
        """Return that no curve follows from so few frequencies, "" where one does."""
        return no_curve(len(self.conditions.frequencies_hz))

    def practice(self) -> Practice:
        """Return a fresh practice run."""
        rules = self.session
        limit = rules.practice_trials if rules.practice_correct is None else rules.practice_limit
        return Practice(rules.practice_level_db_sl, limit, rules.practice_trials, rules.practice_correct)


def plan_runs(protocol: Protocol, subject: int, visit: int = 1, words: Words | None = None) -> tuple[PlannedRun, ...]:
    """Return the runs of a visit (from 1) of the subject of that number (from 0).

    Practice comes first, then every condition in the subject's order; a further visit has an order of its own. words:
    the language of titles, English by default.
    """
    language = words or shipped_words("en")
    conditions = protocol.conditions
    frequencies: tuple[float | None, ...] = conditions.frequencies_hz or (None,)
    cells = [(finger, frequency) for finger in conditions.fingers for frequency in frequencies]
    runs: list[PlannedRun] = []
    if protocol.session.practice_trials:
        runs.append(_planned(protocol, language, 0, conditions.fingers[0], frequencies[0] or 100.0, practice=True))
    for repeat in range(conditions.repeats):
        for index in _order(protocol, len(cells), subject, repeat, visit):
            runs.append(_planned(protocol, language, len(runs), *cells[index]))
    return tuple(runs)


def _planned(
    protocol: Protocol, words: Words, position: int, finger: str, frequency_hz: float | None, practice: bool = False
) -> PlannedRun:
    kind = "fixed" if practice else protocol.procedure.kind
    what = words("run.whole_curve") if frequency_hz is None else words("run.hertz", hertz=f"{frequency_hz:g}")
    title = words("run.title", finger=finger, what=what)
    if practice:
        title = words("run.practice", title=title)
    rules = protocol.session
    introduction = ""
    if practice and rules.practice_correct is not None:
        introduction = words("run.practice_text", correct=rules.practice_correct, window=rules.practice_trials)
    return PlannedRun(
        position, finger, frequency_hz, practice, FORCED_CHOICE, kind, rules.feedback, title, introduction
    )


def _order(protocol: Protocol, count: int, subject: int, repeat: int, visit: int) -> list[int]:
    if protocol.conditions.order == "as-given":
        return list(range(count))
    if protocol.conditions.order == "random":
        rng = np.random.default_rng([protocol.study.seed, 3, subject, repeat, *further(visit)])
        return [int(index) for index in rng.permutation(count)]
    return latin_square(count)[(subject + repeat + visit - 1) % len(latin_square(count))]


def latin_square(count: int) -> list[list[int]]:
    """Return the rows of a Williams design: each condition once in each place, and as often after each other one.

    There are count rows for an even count, twice as many for an odd one (Williams 1949).
    """
    first = [index // 2 if index % 2 == 0 else count - 1 - index // 2 for index in range(count)]
    rows = [[(value + shift) % count for value in first] for shift in range(count)]
    return rows + [row[::-1] for row in rows] if count % 2 else rows
