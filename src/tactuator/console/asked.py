"""The base of a page's requests: each has a number, and computes its answer from the workshop."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, TypeAdapter, ValidationError

from tactuator.errors import BadInput

if TYPE_CHECKING:
    from tactuator.console.workshop import Workshop

Count = Annotated[int, Field(ge=0, lt=2**53, strict=True)]
Name = Annotated[str, StringConstraints(max_length=200)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Answer = dict[str, Any]
Asked = TypeVar("Asked")


class PageRequest(BaseModel):
    """A request with the number that its answer bears."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    id: Count


class ViewRequest(PageRequest):
    """A request that is answered beside the loop's: it may take seconds, and runs on a thread of its own."""

    def answer(self, workshop: Workshop) -> Answer:
        """Return what the page is to show, plain JSON. Raises TactuatorError in words for what cannot be done."""
        raise NotImplementedError


def checked_request(requests: TypeAdapter[Asked], text: str) -> Asked:
    """Return the request that a page's text holds. Raises BadInput, naming the key, for anything else."""
    try:
        return requests.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "message"
        raise BadInput(f"{where}: {first['msg']}", "a request of the console's page") from None


def number_of(text: str) -> int | None:
    """Return the number that the page gave its request, or None where there is none."""
    try:
        number = json.loads(text).get("id")
    except (ValueError, AttributeError, RecursionError):
        return None
    return number if isinstance(number, int) else None
