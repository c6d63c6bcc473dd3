"""The form that every table of a protocol file has, and bounds that several of them share."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


class Part(BaseModel):
    """A table of the protocol file, which allows no key but the known ones."""

    model_config = ConfigDict(extra="forbid", frozen=True)
