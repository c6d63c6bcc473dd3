"""The runs that a subject does, their order, and the seed of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactuator.experiment.language.words import Words, shipped_words
from tactuator.experiment.protocol.protocol import Protocol
from tactuator.experiment.protocol.study import StudyProtocol

FORCED_CHOICE = "forced-choice"
"""Paradigm of detection runs, as the store has it."""
ALL_FINGERS = "all"
"""Finger of a run whose stimuli go to every channel."""


@dataclass(frozen=True)
class PlannedRun:
    """A run as its row in the store has it, and as people are told of it.

    position: counted from 0 in the session. frequency_hz: None where the procedure chooses, or there is none. practice:
    True for a run that is not analysed. feedback: True where the right response is told after each answer. trials:
    their number, where that is known before. title: name for the operator. introduction: text that the subject reads
    before the run begins; an empty one lets it begin at once.
    """

    position: int
    finger: str
    frequency_hz: float | None
    practice: bool
    paradigm: str
    procedure: str
    feedback: bool
    title: str
    introduction: str = ""
    trials: int | None = None


def plan_runs(protocol: Protocol, subject: int, visit: int = 1, words: Words | None = None) -> tuple[PlannedRun, ...]:
    """Return the runs of a visit (from 1) of the subject of that number (from 0).

    Practice comes first, then every condition in the subject's order; a further visit has an order of its own. words:
    the language of titles, English by default.
    """
    told = words or shipped_words("en")
    conditions = protocol.conditions
    frequencies: tuple[float | None, ...] = conditions.frequencies_hz or (None,)
    cells = [(finger, frequency) for finger in conditions.fingers for frequency in frequencies]
    runs: list[PlannedRun] = []
    if protocol.session.practice_trials:
        runs.append(_planned(protocol, told, 0, conditions.fingers[0], frequencies[0] or 100.0, practice=True))
    for repeat in range(conditions.repeats):
        for index in _order(protocol, len(cells), subject, repeat, visit):
            runs.append(_planned(protocol, told, len(runs), *cells[index]))
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


def further(visit: int) -> tuple[int, ...]:
    """Return what a visit adds to a seed; the first visit adds nothing, so that its seeds stay as they were."""
    return () if visit == 1 else (visit,)


def latin_square(count: int) -> list[list[int]]:
    """Return the rows of a Williams design: each condition once in each place, and as often after each other one.

    There are count rows for an even count, twice as many for an odd one (Williams 1949).
    """
    first = [index // 2 if index % 2 == 0 else count - 1 - index // 2 for index in range(count)]
    rows = [[(value + shift) % count for value in first] for shift in range(count)]
    return rows + [row[::-1] for row in rows] if count % 2 else rows


def run_seed(protocol: StudyProtocol, subject: int, position: int, attempt: int, visit: int = 1) -> tuple[int, ...]:
    """Return the seed of a run; a restarted run gets another."""
    return (protocol.study.seed, 5, subject, position, attempt, *further(visit))
