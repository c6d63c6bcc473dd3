"""Protocol files (TOML) of recognition experiments: the items, how they are asked, in which blocks, of whom."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tactuator.experiment.keys import Part
from tactuator.experiment.protocol.study import Seconds as BreakSeconds
from tactuator.experiment.protocol.study import StudyProtocol, each_once

Paradigm = Literal["recognition", "middle-of-three", "abx"]
Seconds = Annotated[float, Field(ge=0.0, le=60.0, allow_inf_nan=False)]


class ItemPart(Part):
    """An item that subjects recognise.

    label: its name. file: a rendered reference, as a path from the protocol's folder. key: the key that names it.
    """

    label: str = Field(min_length=1, max_length=64)
    file: str
    key: str = Field(min_length=1, max_length=8)


class BlockPart(Part):
    """A block of trials, for training or as a test.

    repetitions: of every item (abx: of every pair). feedback: True where the right answer is told. criterion: share
    right that a training block has to reach; where it does not, the experimenter is called and the block begins again.
    """

    kind: Literal["training", "test"]
    repetitions: int = Field(ge=1, le=1000)
    feedback: bool = False
    criterion: float | None = Field(default=None, gt=0.0, le=1.0)


class AskingPart(Part):
    """The question of a trial, and its timing.

    paradigm: `recognition` of one item alone, `middle-of-three` items in a row (Tan et al. 1999), or `abx`: A, B and
    which of them X was. lead_s: silence before the first item. gap_s: silence between the items of a trial. feedback_s:
    time for which feedback is shown.
    """

    paradigm: Paradigm = "recognition"
    lead_s: Seconds = 0.3
    gap_s: Seconds = 0.3
    feedback_s: Seconds = 1.0


class BreakRules(Part):
    """Breaks between blocks, and after so many trials within one; break_s: the least duration of each."""

    break_between_blocks: bool = True
    break_after_trials: int | None = Field(default=None, ge=1, le=100000)
    break_s: BreakSeconds = 0.0


class RecognitionProtocol(StudyProtocol):
    """The protocol file of a recognition study."""

    recognition: AskingPart = AskingPart()
    item: tuple[ItemPart, ...] = Field(min_length=2)
    block: tuple[BlockPart, ...] = Field(min_length=1)
    session: BreakRules = BreakRules()

    @model_validator(mode="after")
    def _items_once(self) -> Self:
        each_once("item labels", [one.label for one in self.item])
        each_once("keys", [one.key for one in self.item])
        return self

    @property
    def labels(self) -> tuple[str, ...]:
        """Return the labels of the items, in the order of the file."""
        return tuple(one.label for one in self.item)
