"""Which trials an identification block has: every item equally often, in an order that a seed alone decides."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from tactuator.experiment.protocol.identification import BlockPart, IdentificationProtocol, Paradigm
from tactuator.experiment.protocol.plan import ALL_FINGERS, PlannedRun
from tactuator.experiment.trial.trial import Trial

ABX_RESPONSES = ("A", "B")


def plan_blocks(protocol: IdentificationProtocol) -> tuple[PlannedRun, ...]:
    """Every block as a run: the same for all subjects, but for the order of its trials."""
    return tuple(_planned(protocol, position, block) for position, block in enumerate(protocol.block))


def _planned(protocol: IdentificationProtocol, position: int, block: BlockPart) -> PlannedRun:
    paradigm, count = protocol.identification.paradigm, len(protocol.item)
    trials = block.repetitions * (2 * count * (count - 1) if paradigm == "abx" else count)
    title = f"Block {position + 1} of {len(protocol.block)}: {block.kind}"
    told = "After each answer you are told which was right." if block.feedback else "You are not told which was right."
    return PlannedRun(
        position,
        ALL_FINGERS,
        None,
        practice=block.kind == "training",
        paradigm=paradigm,
        procedure="fixed",
        feedback=block.feedback,
        title=title,
        introduction=f"{title}, {trials} trials.\n{told}",
        trials=trials,
    )


def block_seed(protocol: IdentificationProtocol, subject: int, position: int) -> tuple[int, ...]:
    """Seed of a subject's block; subjects count from 0."""
    return (protocol.study.seed, subject, position)


def block_trials(protocol: IdentificationProtocol, subject: int, position: int) -> tuple[Trial, ...]:
    """The trials of a subject's block: the same after any interruption."""
    return plan_trials(
        protocol.identification.paradigm,
        protocol.labels,
        protocol.block[position].repetitions,
        np.random.default_rng(block_seed(protocol, subject, position)),
    )


def plan_trials(
    paradigm: Paradigm, labels: Sequence[str], repetitions: int, rng: np.random.Generator
) -> tuple[Trial, ...]:
    """Trials in random order.

    identification: one item, `repetitions` of each, answered with its label. middle-of-three: the same between two
    items drawn at random. abx: every pair `repetitions` times in both orders, X being either, answered A or B.
    """
    if paradigm == "abx":
        return _abx(labels, repetitions, rng)
    asked = [labels[index] for index in rng.permutation(np.repeat(np.arange(len(labels)), repetitions))]
    trials = []
    for number, label in enumerate(asked):
        stimuli: tuple[str, ...] = (label,)
        if paradigm == "middle-of-three":
            before, after = (labels[int(index)] for index in rng.integers(len(labels), size=2))
            stimuli = (before, label, after)
        trials.append(Trial(number, stimuli, tuple(labels), label))
    return tuple(trials)


def _abx(labels: Sequence[str], repetitions: int, rng: np.random.Generator) -> tuple[Trial, ...]:
    orders = [(a, b) for pair in combinations(labels, 2) for a, b in (pair, pair[::-1])]
    asked = [(a, b, x) for a, b in orders for x in ABX_RESPONSES for _ in range(repetitions)]
    trials = []
    for number, index in enumerate(rng.permutation(len(asked))):
        first, second, which = asked[int(index)]
        stimuli = (first, second, first if which == "A" else second)
        trials.append(Trial(number, stimuli, ABX_RESPONSES, which))
    return tuple(trials)


def asked_label(paradigm: str, trial: Trial) -> str:
    """The item that a trial asks for."""
    return trial.stimuli[1] if paradigm == "middle-of-three" else trial.stimuli[-1]
