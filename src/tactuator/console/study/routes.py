"""The address of the study on the console's server: requests of the view Experiment, and where the study stands."""

from __future__ import annotations

import asyncio
import logging

from fastapi import FastAPI, WebSocket, WebSocketDisconnect

from tactuator.console.asked import Answer, number_of
from tactuator.console.scope.routes import CLOSE_NO_RIG
from tactuator.console.study import messages
from tactuator.console.study.room import StudyRoom
from tactuator.console.workshop import Workshop
from tactuator.errors import TactuatorError
from tactuator.web.sockets import CLOSE_FORBIDDEN, has_token, receive_text, same_origin, send

_DEFECT = "a defect of the console; the server's log has it. The store keeps what was answered"
_LOGGER = logging.getLogger("tactuator.web.lab")


def add_study(app: FastAPI, token: str, room: StudyRoom | None, workshop: Workshop) -> None:
    """Add the study's address to the application. room: None where the console has no rig."""
    listening: set[WebSocket] = set()

    async def tell_all(told: StudyRoom) -> None:
        for socket in tuple(listening):
            try:
                await send(socket, {"study": told.standing()})
            except (WebSocketDisconnect, RuntimeError):
                listening.discard(socket)

    @app.websocket("/ws/study")
    async def study(socket: WebSocket) -> None:
        await socket.accept()
        if not same_origin(socket) or not await has_token(socket, token):
            await socket.close(CLOSE_FORBIDDEN)
        elif room is None:
            await socket.close(CLOSE_NO_RIG)
        else:
            listening.add(socket)
            try:
                await send(socket, {"study": room.standing()})
                while True:
                    answer = await _answered(room, workshop, socket)
                    await tell_all(room)
                    await send(socket, answer)
            except WebSocketDisconnect:
                return
            finally:
                listening.discard(socket)


async def _answered(room: StudyRoom, workshop: Workshop, socket: WebSocket) -> Answer:
    """Return the answer to the page's next request. Raises WebSocketDisconnect where the page has gone."""
    number = None
    try:
        text = await receive_text(socket)
        number = number_of(text)
        with workshop.drawer.named_plainly():
            return {"id": number, **await _answer(room, messages.request_of(text))}
    except TactuatorError as error:
        return {"id": number, "error": str(error)}
    except (WebSocketDisconnect, asyncio.CancelledError):
        raise
    except Exception:
        _LOGGER.exception("a request of the view Experiment failed")
        return {"id": number, "error": _DEFECT}


async def _answer(room: StudyRoom, request: messages.StudyRequest) -> Answer:
    match request:
        case messages.BeginStudy():
            await room.begin(request)
        case messages.EndStudy():
            await room.end()
        case messages.ExportStudy():
            return await room.exported(request)
    return {}
