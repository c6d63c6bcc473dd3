"""Which trials an identification block has: every item equally often, in an order that a seed alone decides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from tactuator.experiment.identification_protocol import IdentificationProtocol, Paradigm
from tactuator.experiment.trial import Trial

ABX_RESPONSES = ("A", "B")


@dataclass(frozen=True)
class Block:
    """position in the session; trials in their order."""

    position: int
    training: bool
    feedback: bool
    trials: tuple[Trial, ...]


def plan_blocks(protocol: IdentificationProtocol, subject: int) -> tuple[Block, ...]:
    """Every block of a subject (counted from 0): the same after any interruption."""
    return tuple(
        Block(
            position,
            block.kind == "training",
            block.feedback,
            plan_trials(
                protocol.identification.paradigm,
                protocol.labels,
                block.repetitions,
                np.random.default_rng([protocol.study.seed, subject, position]),
            ),
        )
        for position, block in enumerate(protocol.block)
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
