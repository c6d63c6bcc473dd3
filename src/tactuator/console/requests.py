"""Requests of the console's pages, checked before they are used, and answered in turn.

A message is `{"id": number, "do": name, ...}`; the rest are the fields of the dataclass that stands for that name in
the table of its connection. The answer bears the number, and an `error` with its place where the request is refused.
"""

from __future__ import annotations

import asyncio
import logging
import shlex
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from pydantic import ConfigDict, Field, StringConstraints, TypeAdapter, ValidationError
from pydantic_core import from_json

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, TactuatorError

if TYPE_CHECKING:  # and what only a server needs is imported where it serves: the rig's process reads this as well
    from fastapi import WebSocket

    from tactuator.console.state import ConsoleState

CHANNELS_MAX = 64
COUNT_MAX = 2**53
"""The numbers that a page can count to."""
Count = Annotated[int, Field(ge=0, lt=COUNT_MAX, strict=True)]
Name = Annotated[str, StringConstraints(max_length=200)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Answer = dict[str, Any]
Asked = TypeVar("Asked")
Requests = Mapping[str, type[Asked]]

DEFECT = "a defect of the console; the server's log has it. What is in the page is still there"
LOGGER = logging.getLogger("tactuator.web.lab")
_OF_PAGE = "a request of the console's page"


@dataclass(frozen=True)
class PageRequest:
    """A request; other keys than its fields are refused."""

    __pydantic_config__ = ConfigDict(extra="forbid")


class ViewRequest(PageRequest):
    """A request that is answered beside the loop's: it may take seconds, and runs on a thread of its own."""

    def answer(self, state: ConsoleState) -> Answer:
        """Return what the page is to show, plain JSON. Raises TactuatorError in words for what cannot be done."""
        raise NotImplementedError


def checked(requests: Requests[Asked], message: Mapping[str, Any]) -> Asked:
    """Return the request that a message holds. Raises BadInput with the key for anything else."""
    fields = dict(message)
    number, name = fields.pop("id", None), fields.pop("do", None)
    if _number(number) is None:
        raise BadInput("no number", "0 to 2^53", where=("message",), key="id")
    if not isinstance(name, str) or name not in requests:
        raise BadInput("not known", _OF_PAGE, where=("message",), key="do")
    try:
        kind: Any = requests[name]
        request: Asked = _adapter(kind).validate_python(fields)
    except ValidationError as error:
        from tactuator.web.messages import refusal

        raise refusal(error, "message", _OF_PAGE) from None
    return request


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


async def serve_requests(
    socket: WebSocket, requests: Requests[Asked], answer: Callable[[int, Asked], Awaitable[Answer | None]]
) -> None:
    """Answer a page's requests, one after another, until it goes. answer: called with the number and the request; what
    it returns is sent, and None where nothing is.
    """
    from fastapi import WebSocketDisconnect

    from tactuator.web.sockets import receive_text, send

    while True:
        number: int | None = None
        answered: Answer | None
        try:
            message = _message(await receive_text(socket))
            number = _number(message.get("id"))
            request = checked(requests, message)
            answered = await answer(number or 0, request)
        except TactuatorError as error:
            answered = {"error": str(error), "at": error.document()}
        except (WebSocketDisconnect, asyncio.CancelledError):
            raise
        except Exception:
            LOGGER.exception("a request of the console failed")
            answered = {"error": DEFECT}
        if answered is not None:
            await send(socket, {"id": number, **answered})


def digits(values: FloatArray) -> list[float]:
    """Return numbers to the six digits that a drawing needs."""
    return [float(f"{value:.6g}") for value in values.tolist()]


def command_line(verb: str, *given: str, **options: Any) -> str:
    """Return the command line of a verb with what it is given and its options; of a list each value has its own, True
    is a flag, and None and False are left out.
    """
    words = ["tactuator", *verb.split(), *given]
    for name, value in options.items():
        for each in value if isinstance(value, list | tuple) else [value]:
            if each is not None and each is not False:
                words.append(f"--{name.replace('_', '-')}")
                words += [] if each is True else [f"{each:g}" if isinstance(each, float) else str(each)]
    return shlex.join(words)


def _message(text: str) -> dict[str, Any]:
    try:
        message = from_json(text, allow_inf_nan=False)
    except ValueError:
        message = None
    if not isinstance(message, dict):
        raise BadInput("no JSON object", _OF_PAGE, where=("message",))
    return message


def _number(given: object) -> int | None:
    return given if isinstance(given, int) and not isinstance(given, bool) and 0 <= given < COUNT_MAX else None
