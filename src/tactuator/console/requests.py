"""Requests of the console's pages: a request is a function, called by its name with checked arguments.

A message is `{"id": number, "do": name, ...}`; the rest are the arguments of the function of that name, checked by its
annotations. The answer bears the number, and an `error` with its place where the request is refused.
"""

from __future__ import annotations

import asyncio
import inspect
import logging
import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any

import numpy as np
from fastapi import WebSocket, WebSocketDisconnect
from pydantic import ConfigDict, ValidationError, validate_call
from pydantic_core import from_json

from tactuator.arrays import FloatArray
from tactuator.console.fields import COUNT_MAX
from tactuator.console.uploads import UploadedFiles
from tactuator.errors import BadInput, TactuatorError
from tactuator.web.messages import refusal
from tactuator.web.sockets import receive_text, send

Answer = dict[str, Any]
Functions = Mapping[str, Callable[..., Any]]


@dataclass(frozen=True)
class View:
    """A view of the page, drawn by the module of its name in static/. functions: of ConsoleState, which the page calls
    as `name.function`. of_display, of_rig: whether it needs a display, or a rig.
    """

    name: str
    title: str
    functions: Functions = field(default_factory=dict)
    of_display: bool = False
    of_rig: bool = False


DEFECT = "a defect of the console; the server's log has it. What is in the page is still there"
LOGGER = logging.getLogger("tactuator.web.lab")
_OF_PAGE = "a request of the console's page"


def bound(functions: Functions, context: object) -> dict[str, Callable[..., Any]]:
    """Return the functions with `context` as their first argument; the others are checked at every call."""
    return {name: partial(_checked(function), context) for name, function in functions.items()}


@cache
def _checked(function: Callable[..., Any]) -> Callable[..., Any]:
    checked: Callable[..., Any] = validate_call(config=ConfigDict(arbitrary_types_allowed=True))(function)
    return checked


def requested(functions: Functions, message: Mapping[str, Any]) -> Callable[[], Any]:
    """Return the call that a message asks for. Raises BadInput with the key where it asks for none."""
    arguments = dict(message)
    number, name = arguments.pop("id", None), arguments.pop("do", None)
    if _number(number) is None:
        raise BadInput("no number", "0 to 2^53", where=("message",), key="id")
    if not isinstance(name, str) or name not in functions:
        raise BadInput("not known", _OF_PAGE, where=("message",), key="do")
    return partial(functions[name], **arguments)


async def serve_requests(socket: WebSocket, functions: Functions, uploads: UploadedFiles) -> None:
    """Answer a page's requests, one after another, until it goes.

    A coroutine function is awaited, any other may take seconds and is called on a thread. What it returns is sent; None
    is no answer.
    """
    while True:
        number: int | None = None
        answered: Answer | None
        try:
            message = _message(await receive_text(socket))
            number = _number(message.get("id"))
            with uploads.named_plainly():
                answered = await _answer(requested(functions, message))
        except TactuatorError as error:
            answered = {"error": "; ".join(error.lines), "at": error.document()}
        except (WebSocketDisconnect, asyncio.CancelledError):
            raise
        except Exception:
            LOGGER.exception("a request of the console failed")
            answered = {"error": DEFECT}
        if answered is not None:
            await send(socket, {"id": number, **answered})


async def _answer(call: Callable[[], Any]) -> Answer | None:
    try:
        answer: Answer | None
        answer = await (call() if inspect.iscoroutinefunction(call) else asyncio.to_thread(call))
    except ValidationError as error:
        raise refusal(error, "message", _OF_PAGE) from None
    return answer


def digits(values: FloatArray) -> list[float]:
    """Return numbers to the six digits that a drawing needs."""
    return [float(f"{value:.6g}") for value in values.tolist()]


def tenths(values: Any, decimals: int = 1) -> Any:
    """Return levels to a tenth, as JSON has them: None for a level of nothing."""
    array = np.asarray(values, dtype=float)
    if array.ndim > 1:
        return [tenths(row, decimals) for row in array]
    return [round(level, decimals) if np.isfinite(level) else None for level in array.tolist()]


def command_line(name: str, *given: str, **options: Any) -> str:
    """Return the command line of a subcommand with its arguments and options; of a list each value has its own, True
    is a flag, and None and False are left out.
    """
    words = ["tactuator", *name.split(), *given]
    for option, value in options.items():
        for each in value if isinstance(value, list | tuple) else [value]:
            if each is not None and each is not False:
                words.append(f"--{option.replace('_', '-')}")
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
