"""What a subject's page may say, checked before it is believed."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from tactuator.errors import BadInput

Milliseconds = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class _Message(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Consent(_Message):
    """The subject agrees."""

    type: Literal["consent"]


class Ready(_Message):
    """The subject goes on from `stage`: ends a break, has read an introduction, is ready for the next trial."""

    type: Literal["ready"]
    stage: Literal["break", "introduction", "trial"]


class AnswerMessage(_Message):
    """An answer to trial `number` of run `run`; times by the page's own clock."""

    type: Literal["answer"]
    run: int
    number: int
    response: str = Field(max_length=200)
    shown_ms: Milliseconds | None = None
    pressed_ms: Milliseconds | None = None


SubjectMessage = Annotated[Consent | Ready | AnswerMessage, Field(discriminator="type")]


class Command(_Message):
    """What an operator asks for."""

    type: Literal["start", "stop", "pause", "resume", "give-up-run", "clear-fault", "take-control", "results"]
    session: int | None = None


_SUBJECT: TypeAdapter[Consent | Ready | AnswerMessage] = TypeAdapter(SubjectMessage)
_OPERATOR: TypeAdapter[Command] = TypeAdapter(Command)


def subject_message(text: str) -> Consent | Ready | AnswerMessage:
    """Parse a message of a subject's page; BadInput if it is none."""
    try:
        return _SUBJECT.validate_json(text)
    except ValidationError as error:
        raise BadInput(f"message: {error.errors()[0]['msg']}") from None


def operator_command(text: str) -> Command:
    """Parse a command of an operator's page; BadInput if it is none."""
    try:
        return _OPERATOR.validate_json(text)
    except ValidationError as error:
        raise BadInput(f"command: {error.errors()[0]['msg']}") from None
