"""Identification experiments as a file (TOML): which items, how they are asked, in which blocks, of whom."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tactuator.experiment.protocol.study import Part, StudyProtocol, each_once
from tactuator.experiment.protocol.study import Seconds as BreakSeconds

Paradigm = Literal["identification", "middle-of-three", "abx"]
Seconds = Annotated[float, Field(ge=0.0, le=60.0, allow_inf_nan=False)]


class ItemPart(Part):
    """label: what it is called; file: a rendered reference, path from the protocol's folder; key: pressed for it."""

    label: str = Field(min_length=1, max_length=64)
    file: str
    key: str = Field(min_length=1, max_length=8)


class BlockPart(Part):
    """training or test; repetitions of every item (abx: of every pair); feedback: the right answer is told.

    criterion: share right that a training block has to reach; where it does not, the experimenter is called and the
    block begins again.
    """

    kind: Literal["training", "test"]
    repetitions: int = Field(ge=1, le=1000)
    feedback: bool = False
    criterion: float | None = Field(default=None, gt=0.0, le=1.0)


class AskingPart(Part):
    """paradigm: one item alone; the middle of three items in a row (Tan et al. 1999); or A, B and which of them X was.

    lead_s: silence before, gap_s: between the items of a trial; feedback_s: how long feedback is shown.
    """

    paradigm: Paradigm = "identification"
    lead_s: Seconds = 0.3
    gap_s: Seconds = 0.3
    feedback_s: Seconds = 1.0


class BreakRules(Part):
    """Breaks: between blocks, and after so many trials within one; break_s: how long each lasts at least."""

    break_between_blocks: bool = True
    break_after_trials: int | None = Field(default=None, ge=1, le=100000)
    break_s: BreakSeconds = 0.0


class IdentificationProtocol(StudyProtocol):
    """The file of an identification study."""

    identification: AskingPart = AskingPart()
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
        """Of the items, in the order of the file."""
        return tuple(one.label for one in self.item)
