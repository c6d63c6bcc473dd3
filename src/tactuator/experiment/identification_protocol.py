"""Identification experiments as a file (TOML): which items, how they are asked, in which blocks, of whom."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError, model_validator

from tactuator.errors import BadInput
from tactuator.experiment.protocol import Circumstances, Part, Study, SubjectPart

Paradigm = Literal["identification", "middle-of-three", "abx"]
Seconds = Annotated[float, Field(ge=0.0, le=60.0, allow_inf_nan=False)]


class ItemPart(Part):
    """label: what it is called; file: a rendered reference, path from the protocol's folder; key: pressed for it."""

    label: str = Field(min_length=1, max_length=64)
    file: str
    key: str = Field(min_length=1, max_length=8)


class BlockPart(Part):
    """training or test; repetitions of every item (abx: of every pair); feedback: the right answer is told."""

    kind: Literal["training", "test"]
    repetitions: int = Field(ge=1, le=1000)
    feedback: bool = False


class AskingPart(Part):
    """paradigm: one item alone; the middle of three items in a row (Tan et al. 1999); or A, B and which of them X was.

    lead_s: silence before, gap_s: between the items of a trial.
    """

    paradigm: Paradigm = "identification"
    lead_s: Seconds = 0.3
    gap_s: Seconds = 0.3


class IdentificationProtocol(Part):
    """The whole file."""

    study: Study
    identification: AskingPart = AskingPart()
    item: tuple[ItemPart, ...] = Field(min_length=2)
    block: tuple[BlockPart, ...] = Field(min_length=1)
    subject: tuple[SubjectPart, ...] = Field(min_length=1)
    circumstances: Circumstances = Circumstances()

    @model_validator(mode="after")
    def _check(self) -> IdentificationProtocol:
        for what, values in (
            ("item labels", [one.label for one in self.item]),
            ("keys", [one.key for one in self.item]),
            ("subject codes", [one.code for one in self.subject]),
        ):
            if len(set(values)) != len(values):
                raise ValueError(f"{what} {', '.join(values)}; allowed: each once")
        return self

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the items, in the order of the file."""
        return tuple(one.label for one in self.item)


def read_identification(path: str | Path) -> tuple[IdentificationProtocol, str]:
    """The protocol and the file's own text; BadInput, one line that names the key, where it is not one."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text"
        raise BadInput(f"protocol {path}: {reason}; allowed: a TOML file that can be read") from None
    return parse_identification(text, str(path)), text


def parse_identification(text: str, where: str = "protocol") -> IdentificationProtocol:
    """The protocol that the text says; BadInput as in `read_identification`."""
    try:
        return IdentificationProtocol.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise BadInput(f"protocol {where}: {error}; allowed: TOML") from None
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "file"
        got = "" if isinstance(first["input"], dict) else f" (got {first['input']!r})"
        raise BadInput(f"protocol {where}: {key}: {first['msg']}{got}") from None
