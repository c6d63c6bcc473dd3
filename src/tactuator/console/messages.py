"""Messages that the console's page may send, checked and bounded before they are used."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter

from tactuator.console.asked import Finite, Name, PageRequest, checked_request
from tactuator.console.views.display_text import DisplayTextRequest
from tactuator.console.views.experiment import ExperimentRequest
from tactuator.console.views.identify import IdentifyRequest
from tactuator.console.views.prefilter import PrefilterRequest
from tactuator.console.views.speech import SpeechRequest

CHANNELS_MAX = 64


class Start(PageRequest):
    """Request for what the start page shows."""

    do: Literal["start"]


class Open(PageRequest):
    """Request for a display, read anew."""

    do: Literal["open"]
    display: Name


class _OfChannel(PageRequest):
    display: Name
    channel: Name


class Bring(_OfChannel):
    """Request for a channel's bench, with a shape to begin with."""

    do: Literal["bring"]


class Draw(_OfChannel):
    """Request for the curves of a shape; its figures follow."""

    do: Literal["draw"]
    shape: dict[str, Any]


class MovePoint(_OfChannel):
    """Request to bring the point of the curve at `hz`, turned by `turn_deg`, to `gain_db`."""

    do: Literal["point"]
    shape: dict[str, Any]
    hz: Annotated[Finite, Field(gt=0.0)]
    turn_deg: Finite
    gain_db: Annotated[Finite, Field(ge=-200.0, le=200.0)]


class Design(_OfChannel):
    """Request to run the synthesis for a channel."""

    do: Literal["design"]


class Check(PageRequest):
    """Request for the whole verdict, and the text of the controller file."""

    do: Literal["check"]
    display: Name
    shapes: Annotated[dict[Name, dict[str, Any]], Field(max_length=CHANNELS_MAX)]


Request = (
    Start
    | Open
    | Bring
    | Draw
    | MovePoint
    | Design
    | Check
    | DisplayTextRequest
    | ExperimentRequest
    | IdentifyRequest
    | PrefilterRequest
    | SpeechRequest
)
_REQUEST: TypeAdapter[Request] = TypeAdapter(Annotated[Request, Field(discriminator="do")])


def request_of(text: str) -> Request:
    """Return a request. Raises BadInput, naming the key, for anything else."""
    return checked_request(_REQUEST, text)
