"""Protocol files of recognition experiments (absolute identification), and the trials of their blocks.

Every item is asked equally often, in an order that a seed alone decides.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import KW_ONLY
from itertools import combinations
from typing import Annotated, Literal

import numpy as np
import scipy
from pydantic import Field

from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import ATTENTIVE_LAPSE
from tactuator.experiment.protocol.study import ALL_FINGERS, PlannedRun, StudyProtocol, each_once
from tactuator.experiment.trial import Timing, Trial
from tactuator.experiment.words import Words
from tactuator.parameters import Flag, Number, Seconds, Whole, table

_LEAST_PASSED = 0.05
"""Share of people who know every item, and pass training at once, below which it does not end."""
Paradigm = Literal["recognition", "middle-of-three", "abx"]
_Pause = Annotated[Seconds, Field(le=60.0)]


@table("[[item]]")
class ItemPart:
    """Keys of [[item]], which subjects recognise."""

    label: Annotated[str, Field(min_length=1, max_length=64, description="its name")]
    file: Annotated[str, Field(description="a rendered reference, as a path from the protocol's folder")]
    key: Annotated[str, Field(min_length=1, max_length=8, description="the key that names it")]


@table("[[block]]")
class BlockPart:
    """Keys of [[block]], trials for training or as a test.

    Where training does not reach its criterion, the experimenter is called and the block begins again.
    """

    kind: Annotated[Literal["training", "test"], Field(description="what the block is for")]
    repetitions: Annotated[Whole, Field(ge=1, le=1000, description="of every item (abx: of every pair)")]
    feedback: Annotated[Flag, Field(description="the right answer is shown")] = False
    criterion: Annotated[
        Annotated[Number, Field(gt=0.0, le=1.0)] | None, Field(description="share right that training has to reach")
    ] = None


@table("[recognition]")
class AskingPart:
    """Keys of [recognition]: the question of a trial, and its timing."""

    paradigm: Annotated[
        Paradigm,
        Field(description="one item alone, the middle of three (Tan et al. 1999), or A, B and which of them X was"),
    ] = "recognition"
    lead_s: Annotated[_Pause, Field(description="silence before the first item")] = Timing.lead_s
    gap_s: Annotated[_Pause, Field(description="silence between the items of a trial")] = Timing.gap_s
    feedback_s: Annotated[_Pause, Field(description="time for which feedback is shown")] = 1.0


@table("[session]")
class BreakRules:
    """Keys of [session]: breaks between blocks, and within one."""

    break_between_blocks: Annotated[Flag, Field(description="a break after every block")] = True
    break_after_trials: Annotated[
        Annotated[Whole, Field(ge=1, le=100000)] | None, Field(description="trials between breaks within a block")
    ] = None
    break_s: Annotated[Seconds, Field(description="least duration of a break")] = 0.0


@table("protocol")
class RecognitionProtocol(StudyProtocol):
    """The protocol file of a recognition study."""

    _: KW_ONLY
    recognition: AskingPart = AskingPart()
    item: Annotated[tuple[ItemPart, ...], Field(min_length=2)]
    block: Annotated[tuple[BlockPart, ...], Field(min_length=1)]
    session: BreakRules = BreakRules()

    def __post_init__(self) -> None:
        super().__post_init__()
        each_once("item labels", self.labels)
        each_once("keys", [item.key for item in self.item])

    @property
    def labels(self) -> tuple[str, ...]:
        """Return the labels of the items, in the order of the file."""
        return tuple(item.label for item in self.item)

    @property
    def asks(self) -> str:
        return "recognition"

    @property
    def files(self) -> tuple[str, ...]:
        return (*(item.file for item in self.item), *super().files)

    def faults(self) -> Iterator[BadInput]:
        for number, block in enumerate(self.block, start=1):
            trials = self._trials(block)
            if block.kind == "training" and block.criterion is not None:
                most_wrong = math.floor(trials * (1.0 - block.criterion) + 1e-9)
                if scipy.stats.binom.cdf(most_wrong, trials, ATTENTIVE_LAPSE) < _LEAST_PASSED:
                    yield BadInput(
                        f"block {number} of {trials} trials ends at {100.0 * block.criterion:.4g} % right",
                        f"a share that people reach who lapse in {100.0 * ATTENTIVE_LAPSE:g} % of trials",
                    )

    def require_observers(self) -> None:
        raise BadInput("what is asked is recognition", "detection or a task; see `experiment recognise`")

    def parts(self, words: Words) -> tuple[PlannedRun, ...]:
        return tuple(self._run(number, block, words) for number, block in enumerate(self.block, start=1))

    def _run(self, number: int, block: BlockPart, words: Words) -> PlannedRun:
        paradigm, trials = self.recognition.paradigm, self._trials(block)
        title = words("run.block", number=number, count=len(self.block), kind=words(f"run.{block.kind}"))
        feedback = words("run.told" if block.feedback else "run.not_told")
        return PlannedRun(
            ALL_FINGERS,
            None,
            paradigm=paradigm,
            procedure="fixed",
            feedback=block.feedback,
            title=title,
            typical_trials=trials,
            trials=trials,
            practice=block.kind == "training",
            introduction=f"{words('run.trials', title=title, trials=trials)}\n{feedback}",
        )

    def _trials(self, block: BlockPart) -> int:
        count = len(self.item)
        return block.repetitions * (2 * count * (count - 1) if self.recognition.paradigm == "abx" else count)

    def run_seed(self, subject: int, position: int, attempt: int = 0, visit: int = 1) -> tuple[int, ...]:
        """Return the seed of a block.

        A first attempt at a first visit has the three numbers that it had before there were attempts and visits.
        """
        again = () if (attempt, visit) == (0, 1) else (attempt, visit)
        return (self.study.seed, subject, position, *again)


ABX_RESPONSES = ("A", "B")


def block_trials(
    protocol: RecognitionProtocol, subject: int, position: int, attempt: int = 0, visit: int = 1
) -> tuple[Trial, ...]:
    """Return the trials of a subject's block, which are the same after any interruption."""
    return plan_trials(
        protocol.recognition.paradigm,
        protocol.labels,
        protocol.block[position].repetitions,
        np.random.default_rng(protocol.run_seed(subject, position, attempt, visit)),
    )


def plan_trials(
    paradigm: Paradigm, labels: Sequence[str], repetitions: int, rng: np.random.Generator
) -> tuple[Trial, ...]:
    """Return the trials of a block in random order.

    recognition: one item, `repetitions` of each, answered with its label. middle-of-three: the same between two
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
