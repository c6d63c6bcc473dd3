"""Messages that a page may send to the rig's connection, checked and bounded before they are used."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from tactuator.console.asked import Count, Finite, Name, checked_request
from tactuator.console.messages import CHANNELS_MAX
from tactuator.measure.options import MeasurementOptions

_Channels = Annotated[list[Name], Field(max_length=CHANNELS_MAX, min_length=1)]
_Frequency = Annotated[Finite, Field(gt=0.0, le=1e5)]


class _Request(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)
    id: Count


class Simple(_Request):
    """Request without more to say: the controls, live, stop of the generator, rest, a rig to be opened again."""

    do: Literal["take", "give", "live", "stop", "rest", "reopen"]


class UseController(_Request):
    """Request to load a controller: of a file that was dropped (its key), of the loops in the page, or designed now."""

    do: Literal["controller"]
    source: Literal["file", "loops", "design"]
    file: Name = ""
    shapes: Annotated[dict[Name, dict[str, Any]], Field(max_length=CHANNELS_MAX)] = {}


class Play(_Request):
    """Request to play on the generator. file: key of a reference that was dropped."""

    do: Literal["wave"]
    kind: Literal["tone", "noise", "sweep", "file"]
    level_db_sl: Finite
    channels: _Channels
    frequency_hz: _Frequency = 100.0
    to_hz: _Frequency = 300.0
    sweep_s: Annotated[Finite, Field(gt=0.0)] = 5.0
    file: Name = ""


class TouchFinger(_Request):
    """Request to put a load on a simulated finger port, or, with None, to take it off."""

    do: Literal["touch"]
    channel: Name
    load: Name | None


class PressFinger(_Request):
    """Request to press on a simulated finger port with that force, volts of command."""

    do: Literal["press"]
    channel: Name
    force_v: Annotated[Finite, Field(ge=-100.0, le=100.0)]


class MeasureResponse(_Request):
    """Request to measure the response; without frequencies those of the command."""

    do: Literal["measure"]
    channels: _Channels
    level_db_sl: Finite
    load: Name = MeasurementOptions.load
    frequency_hz: Annotated[list[_Frequency], Field(max_length=200)] = []
    confidence_db: Annotated[Finite, Field(gt=0.0, le=20.0)] = MeasurementOptions.confidence_db
    longest_s: Annotated[Finite, Field(gt=0.0, le=600.0)] = MeasurementOptions.longest_s
    mains_hz: Annotated[Finite, Field(ge=0.0, le=1000.0)] = MeasurementOptions.mains_hz


class Expected(_Request):
    """Request for the levels that the loaded controller's model expects."""

    do: Literal["expected"]
    level_db_sl: Finite


class Look(_Request):
    """Setting of the page's picture: what its width can show of which stretch, and where that stands.

    mode: "roll" follows the newest row, "auto" a trigger where there is one, "normal" a trigger alone, "single" the
    next one; "hold" stands at row `end`. share: of the picture, ahead of the trigger.
    """

    do: Literal["look"]
    span_s: Annotated[Finite, Field(ge=0.001, le=60.0)]
    columns: Annotated[int, Field(ge=10, le=4000, strict=True)]
    mode: Literal["off", "roll", "auto", "normal", "single", "hold"] = "roll"
    channel: Name = ""
    signal: Literal["reference", "command", "position"] = "position"
    level: Finite = 0.0
    edge: Literal["rising", "falling"] = "rising"
    share: Annotated[Finite, Field(ge=0.0, le=1.0)] = 0.2
    end: Count = 0


class Acknowledge(_Request):
    """Message that the page has drawn a frame."""

    do: Literal["drawn"]
    frame: Count


class Save(_Request):
    """Request for the samples of one channel, up to row `end`, as a record (CSV)."""

    do: Literal["save"]
    channel: Name
    span_s: Annotated[Finite, Field(gt=0.0, le=60.0)]
    end: Count


Request = (
    Simple | UseController | Play | TouchFinger | PressFinger | MeasureResponse | Expected | Look | Acknowledge
    | Save
)  # fmt: skip
_REQUEST: TypeAdapter[Request] = TypeAdapter(Annotated[Request, Field(discriminator="do")])


def request_of(text: str) -> Request:
    """Return a request. Raises BadInput, naming the key, for anything else."""
    return checked_request(_REQUEST, text)
