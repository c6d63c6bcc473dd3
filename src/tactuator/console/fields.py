"""Bounds of what a page may send, as types that pydantic checks."""

from typing import Annotated

from pydantic import ConfigDict, Field, StringConstraints

CHANNELS_MAX = 64
COUNT_MAX = 2**53
"""The numbers that a page can count to."""
Count = Annotated[int, Field(ge=0, lt=COUNT_MAX, strict=True)]
Name = Annotated[str, StringConstraints(max_length=200)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class PageSetting:
    """Base class of settings that a page sends as one argument: other keys than their fields are refused."""

    __pydantic_config__ = ConfigDict(extra="forbid")
