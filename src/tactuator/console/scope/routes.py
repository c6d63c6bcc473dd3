"""The address of the rig on the console's server: who may open it, and what every page is told."""

from __future__ import annotations

import asyncio
from concurrent.futures import Executor
from contextlib import suppress

from fastapi import FastAPI, WebSocket

from tactuator.console.held_rig import orders
from tactuator.console.scope.connection import RigConnection
from tactuator.console.scope.controls import Controls
from tactuator.console.scope.desk import Desk
from tactuator.console.scope.host import RigHost
from tactuator.web.sockets import CLOSE_FORBIDDEN, has_token, same_origin

CLOSE_NO_RIG = 4004
"""Close code of a connection to a console that was begun without a rig."""


def add_rig(
    app: FastAPI, token: str, host: RigHost | None, desk: Desk | None, controls: Controls, apart: Executor | None
) -> None:
    """Add the rig's address to the application. host, desk: None where the console has no rig."""

    @app.websocket("/ws/rig")
    async def rig(socket: WebSocket) -> None:
        await socket.accept()
        if not same_origin(socket) or not await has_token(socket, token):
            await socket.close(CLOSE_FORBIDDEN)
        elif host is None or desk is None:
            await socket.close(CLOSE_NO_RIG)
        else:
            _listen(host, controls)
            await RigConnection(socket, host, desk, controls, apart).serve()


def _listen(host: RigHost, controls: Controls) -> None:
    """Let the pages be told what the rig's process tells; it comes on another thread."""
    loop = asyncio.get_running_loop()

    def tell(told: orders.Told) -> None:
        with suppress(RuntimeError):  # the server has ended, and with it the loop
            if isinstance(told, orders.Refused):
                loop.call_soon_threadsafe(controls.tell_refusal, told.text)
            else:
                loop.call_soon_threadsafe(controls.tell_all)

    host.changed = tell
