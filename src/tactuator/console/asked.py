"""The base of a page's requests: each has a number, and computes its answer from the workshop."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

if TYPE_CHECKING:
    from tactuator.console.workshop import Workshop

Count = Annotated[int, Field(ge=0, lt=2**53, strict=True)]
Name = Annotated[str, StringConstraints(max_length=200)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Answer = dict[str, Any]


class PageRequest(BaseModel):
    """A request with the number that its answer bears."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    id: Count


class ViewRequest(PageRequest):
    """A request that is answered beside the loop's: it may take seconds, and runs on a thread of its own."""

    def answer(self, workshop: Workshop) -> Answer:
        """Return what the page is to show, plain JSON. Raises TactuatorError in words for what cannot be done."""
        raise NotImplementedError
