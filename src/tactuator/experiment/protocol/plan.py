"""Which runs a subject does, in which order, and the seed of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactuator.experiment.protocol.protocol import Protocol, StudyProtocol

FORCED_CHOICE = "forced-choice"
"""Paradigm of detection runs, as the store has it."""
ALL_FINGERS = "all"
"""Finger of a run whose stimuli go to every channel."""


@dataclass(frozen=True)
class PlannedRun:
    """A run as its row in the store has it, and as people are told of it.

    position counts from 0 in the session; frequency_hz None: the procedure chooses, or there is none; practice: not
    analysed; feedback: the right response is told after each answer; trials: how many, where that is known before.
    title: for the operator; introduction: what the subject reads before it begins (empty: it begins at once).
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


def plan_runs(protocol: Protocol, subject: int) -> tuple[PlannedRun, ...]:
    """Runs of the subject of that number (from 0): practice first, then every condition in the subject's order."""
    conditions = protocol.conditions
    frequencies: tuple[float | None, ...] = conditions.frequencies_hz or (None,)
    cells = [(finger, frequency) for finger in conditions.fingers for frequency in frequencies]
    runs: list[PlannedRun] = []
    if protocol.session.practice_trials:
        runs.append(_planned(protocol, 0, conditions.fingers[0], frequencies[0] or 100.0, practice=True))
    for repeat in range(conditions.repeats):
        for index in _order(protocol, len(cells), subject, repeat):
            runs.append(_planned(protocol, len(runs), *cells[index]))
    return tuple(runs)


def _planned(
    protocol: Protocol, position: int, finger: str, frequency_hz: float | None, practice: bool = False
) -> PlannedRun:
    kind = "fixed" if practice else protocol.procedure.kind
    what = "whole curve" if frequency_hz is None else f"{frequency_hz:g} Hz"
    title = f"{'Practice: ' if practice else ''}{finger}, {what}"
    feedback = protocol.session.feedback
    return PlannedRun(position, finger, frequency_hz, practice, FORCED_CHOICE, kind, feedback, title)


def _order(protocol: Protocol, count: int, subject: int, repeat: int) -> list[int]:
    if protocol.conditions.order == "as-given":
        return list(range(count))
    if protocol.conditions.order == "random":
        rng = np.random.default_rng([protocol.study.seed, 3, subject, repeat])
        return [int(index) for index in rng.permutation(count)]
    return latin_square(count)[(subject + repeat) % len(latin_square(count))]


def latin_square(count: int) -> list[list[int]]:
    """Rows of a Williams design: each condition once in each place, and as often after each other one.

    count rows for an even count, twice as many for an odd one (Williams 1949).
    """
    first = [index // 2 if index % 2 == 0 else count - 1 - index // 2 for index in range(count)]
    rows = [[(value + shift) % count for value in first] for shift in range(count)]
    return rows + [row[::-1] for row in rows] if count % 2 else rows


def run_seed(protocol: StudyProtocol, subject: int, position: int, attempt: int) -> tuple[int, ...]:
    """Seed of a run; a restarted run gets another."""
    return (protocol.study.seed, 5, subject, position, attempt)
