"""Messages that a page may send, checked and bounded before they are used."""

from __future__ import annotations

from typing import Annotated, Literal, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StringConstraints,
    TypeAdapter,
    ValidationError,
)

from tactuator.errors import BadInput
from tactuator.experiment.protocol.study import Celsius, Code, Group, ParticipantId
from tactuator.experiment.trial import typed_number, without_controls

Milliseconds = Annotated[float, Field(ge=0.0, le=1e12, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0, lt=2**31, strict=True)]
Short = Annotated[str, StringConstraints(max_length=200)]
Reason = Annotated[
    str, StringConstraints(strip_whitespace=True, min_length=1, max_length=200), AfterValidator(without_controls)
]
_INTERVALS_MAX = 9
_Kind = TypeVar("_Kind")


class _Message(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Consent(_Message):
    """Message of a subject who agrees, with the name where the protocol asks for it."""

    type: Literal["consent"]
    name: Short = ""


class Decline(_Message):
    """Message of a subject who does not agree."""

    type: Literal["decline"]


class Ready(_Message):
    """Message of a subject who goes on from `stage`: from a break, a pause, an introduction, or to a trial."""

    type: Literal["ready"]
    stage: Literal["break", "introduction", "trial", "paused", "stopped"]


class Pause(_Message):
    """Message of a subject who wants nothing to play: for now (`pause`), or any more today (`stop`)."""

    type: Literal["pause", "stop"]


class Withdraw(_Message):
    """Message of a subject who leaves the study; keep: the answers so far may be used."""

    type: Literal["withdraw"]
    keep: bool


class AnswerMessage(_Message):
    """Answer to trial `number` of run `run`; times by the page's own clock, lit_ms of each interval's visual cue."""

    type: Literal["answer"]
    run: Count
    number: Count
    response: Short
    shown_ms: Milliseconds | None = None
    pressed_ms: Milliseconds | None = None
    lit_ms: tuple[Milliseconds | None, ...] = Field(default=(), max_length=_INTERVALS_MAX)


SubjectMessage = Consent | Decline | Ready | Pause | Withdraw | AnswerMessage


class Command(_Message):
    """Command of an operator, some of them to a session."""

    type: Literal["start", "stop", "pause", "resume", "give-up-run", "clear-fault", "take-control", "results"]
    session: Count | None = None


class Enrol(_Message):
    """Request of an operator to enrol a new subject."""

    type: Literal["enrol"]
    code: Code
    group: Group = "unknown"
    participant_id: ParticipantId | None = None
    demographics: dict[Short, Short] = Field(default={}, max_length=50)


class NewVisit(_Message):
    """Request of an operator for a further visit of a subject."""

    type: Literal["new-visit"]
    subject: Code


class Correct(_Message):
    """Correction of a subject's data by an operator; a value of None leaves what is there, "" takes a fact away."""

    type: Literal["correct"]
    subject: Code
    reason: Reason
    group: Group | None = None
    participant_id: ParticipantId | None = None
    demographics: dict[Short, Short] = Field(default={}, max_length=50)


_Typed = BeforeValidator(lambda value: typed_number(value) if isinstance(value, str) else value)


class Day(_Message):
    """Data of the day of a session, from an operator: numbers, also as they are typed."""

    type: Literal["day"]
    session: Count
    skin_temperature_c: Annotated[Celsius, _Typed] | None = None
    preload_n: Annotated[float, Field(ge=0.0, le=1000.0, allow_inf_nan=False), _Typed] | None = None


class SetVoid(_Message):
    """Request of an operator to leave a part of a session out of all results (void), or to take it in again."""

    type: Literal["void"]
    session: Count
    run: Count | None = None
    trial: Annotated[Count, BeforeValidator(lambda value: int(value) if str(value).isdecimal() else value)] | None = (
        None
    )
    void: bool
    reason: Reason


OperatorMessage = Command | Enrol | NewVisit | Correct | Day | SetVoid

FROM_SUBJECT: TypeAdapter[SubjectMessage] = TypeAdapter(Annotated[SubjectMessage, Field(discriminator="type")])
FROM_OPERATOR: TypeAdapter[OperatorMessage] = TypeAdapter(Annotated[OperatorMessage, Field(discriminator="type")])


def message_of(messages: TypeAdapter[_Kind], text: str, what: str) -> _Kind:
    """Return the message that a page's text holds. what: how a refusal names it. Raises BadInput if it is none."""
    try:
        return messages.validate_json(text)
    except ValidationError as error:
        raise refusal(error, what) from None


def refusal(error: ValidationError, what: str, allowed: str = "") -> BadInput:
    """Return a message's refusal at its place, in words that repeat nothing of it; or the one that its check raised."""
    first = error.errors(include_input=False, include_url=False)[0]
    cause = first.get("ctx", {}).get("error")
    place = ".".join(str(part)[:40] for part in first["loc"])
    plain = BadInput(first["msg"], allowed, where=(what, *([place] if place else [])))
    if isinstance(cause, BadInput):
        cause.where = cause.where or plain.where
        return cause
    return plain
