"""Connections: sending, receiving, and ending the parts of a connection together."""

from __future__ import annotations

import asyncio
import hmac
import json
from collections.abc import Coroutine, Mapping
from contextlib import suppress
from typing import Any
from urllib.parse import urlsplit

from fastapi import WebSocket, WebSocketDisconnect
from starlette.requests import HTTPConnection
from starlette.websockets import WebSocketState

from tactuator.errors import BadInput

CLOSE_FORBIDDEN = 4003
"""Close code of a connection that is not allowed."""
CLOSE_ABSENT = 4004
"""Close code of a connection to a session, study or rig that is not there."""
_TOKEN_TIMEOUT_S = 10.0


async def send(socket: WebSocket, message: dict[str, Any]) -> None:
    """Send a message. Raises WebSocketDisconnect where the page has gone."""
    if socket.application_state is WebSocketState.DISCONNECTED:
        raise WebSocketDisconnect
    text = json.dumps(message, separators=(",", ":"), ensure_ascii=False)
    try:
        await socket.send_text(text)
    except RuntimeError:  # it was closed meanwhile, which is read later
        raise WebSocketDisconnect from None


async def receive_text(socket: WebSocket) -> str:
    """Return the next message. Raises WebSocketDisconnect where the page has gone, BadInput for a frame that is no
    text.
    """
    frame = await socket.receive()
    if frame["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(frame.get("code", 1005))
    text = frame.get("text")
    if text is None:
        raise BadInput("message: a binary frame", "text")
    return str(text)


async def first_to_end(*parts: Coroutine[Any, Any, None]) -> None:
    """Run the parts of a connection until one ends, and end the others; a page that goes is no error."""
    tasks = [asyncio.create_task(part) for part in parts]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        ends = await asyncio.gather(*tasks, return_exceptions=True)
    for end in ends:
        if isinstance(end, Exception) and not isinstance(end, WebSocketDisconnect):
            raise end


def same_origin(socket: HTTPConnection) -> bool:
    """Return whether the page that connects came from this server; another site's page may not speak for its reader."""
    origin = socket.headers.get("origin")
    try:
        return origin is None or urlsplit(origin).netloc == socket.headers.get("host")
    except ValueError:  # an address in brackets that is none
        return False


async def refuse(socket: WebSocket, code: int) -> None:
    """Close a connection with that code, if its page is still there."""
    with suppress(WebSocketDisconnect, RuntimeError):
        await socket.close(code)


async def admitted(socket: WebSocket, token: str) -> bool:
    """Accept a connection, and return whether a page of this server made it and sent the token; others are closed."""
    return await who_is(socket, {token: ""}) is not None


async def who_is(socket: WebSocket, people: Mapping[str, str]) -> str | None:
    """Accept a connection, and return whose token a page of this server sent; others are closed. people: names by
    token.
    """
    await socket.accept()
    name = await _name_of(socket, people) if same_origin(socket) else None
    if name is None:
        await refuse(socket, CLOSE_FORBIDDEN)
    return name


async def _name_of(socket: WebSocket, people: Mapping[str, str]) -> str | None:
    try:
        async with asyncio.timeout(_TOKEN_TIMEOUT_S):
            received = await receive_text(socket)
    except (TimeoutError, WebSocketDisconnect, BadInput):
        return None
    name = None
    for token, whose in people.items():  # all of them, so that the duration gives no hint
        if hmac.compare_digest(received.encode(), token.encode()):
            name = whose
    return name
