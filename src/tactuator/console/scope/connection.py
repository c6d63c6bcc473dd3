"""One connection of a page to the rig: orders in turn, frames as fast as the page draws them, and the standing."""

from __future__ import annotations

import asyncio
import logging
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import asdict

from fastapi import WebSocket, WebSocketDisconnect

from tactuator.console.asked import Answer, number_of
from tactuator.console.held_rig import orders
from tactuator.console.scope import messages
from tactuator.console.scope.controls import Controls
from tactuator.console.scope.desk import Desk
from tactuator.console.scope.frames import View
from tactuator.console.scope.host import RigHost
from tactuator.errors import BadInput, TactuatorError
from tactuator.web.sockets import first_to_end, receive_text, send

FRAMES_HZ = 50.0
AHEAD = 2
"""Frames that a page may have had and not drawn; what would come then is left out, and counted."""
LEVELS_HZ = 8.0
_LOGGER = logging.getLogger("tactuator.web.lab")
_DEFECT = "a defect of the console; the server's log has it. What is in the page is still there"
_FOR_ANYBODY = ("take", "give", "stop", "rest")
_OF_EXPERIMENT = ("stop", "rest", "reopen")
"""Requests that any page may make while an experiment has the rig."""


class RigConnection:
    """A page that is connected to the rig. apart: where a controller is designed."""

    def __init__(
        self, socket: WebSocket, host: RigHost, desk: Desk, controls: Controls, apart: Executor | None
    ) -> None:
        self._socket, self._host, self._desk, self._controls, self._apart = socket, host, desk, controls, apart
        self._view = View(host.samples, host.display.rate_hz, desk.channels)
        self._frame = self._drawn = self._dropped = self._shown_end = 0
        self._news = asyncio.Event()
        self._refusals: list[str] = []
        self._points: orders.Points | None = None

    async def serve(self) -> None:
        """Serve the page until it goes; if it had the controls, the generator goes silent."""
        self._controls.enter(self)
        try:
            await first_to_end(self._read(), self._tell(), self._frames(), self._levels())
        finally:
            if self._controls.leave(self):
                self._host.order(orders.GenerateOrder(None))

    def tell_standing(self) -> None:
        """Let the page be told where things stand."""
        self._news.set()

    def tell_refusal(self, text: str) -> None:
        """Let the page be told what the rig refused."""
        self._refusals.append(text)
        self._news.set()

    async def _read(self) -> None:
        while True:
            number = None
            try:
                text = await receive_text(self._socket)
                number = number_of(text)
                request = messages.request_of(text)
                if isinstance(request, messages.Acknowledge):
                    self._drawn = min(max(self._drawn, request.frame), self._frame)
                    continue
                answer = await self._answer(request)
            except TactuatorError as error:
                answer = {"error": str(error)}
            except (WebSocketDisconnect, asyncio.CancelledError):
                raise
            except Exception:
                _LOGGER.exception("a request to the rig failed")
                answer = {"error": _DEFECT}
            await send(self._socket, {"id": number, **answer})

    async def _answer(self, request: messages.Request) -> Answer:
        """Serve one request. Raises BadInput where it is refused."""
        controls, desk = self._controls, self._desk
        if isinstance(request, messages.Look):
            self._view.set(request)
            return {}
        if isinstance(request, messages.Save):
            return await asyncio.to_thread(desk.record, request)
        if isinstance(request, messages.Expected):
            return await asyncio.to_thread(desk.expected, request.level_db_sl)
        if isinstance(request, messages.Simple) and controls.reserved is not None and request.do in _OF_EXPERIMENT:
            if request.do != "reopen":
                controls.reserved()
                return {}
            if self._host.standing.mode != "gone":
                raise BadInput("the rig is there, and an experiment has it", "opening one that has gone")
        elif not isinstance(request, messages.Simple) or request.do not in _FOR_ANYBODY:
            controls.require(self)
        if isinstance(request, messages.Simple) and request.do in ("take", "give"):
            (controls.take if request.do == "take" else controls.give)(self)
            return {}
        if isinstance(request, messages.UseController):
            return await desk.use_controller(request, self._apart)
        return await asyncio.to_thread(desk.ordered, request)

    async def _tell(self) -> None:
        """Send the standing whenever it has changed, and points and refusals as they come."""
        while True:
            host = self._host
            refused, self._refusals = self._refusals, []
            for text in refused:
                await send(self._socket, {"refused": text})
            if host.points is not None and host.points is not self._points:
                self._points = host.points
                await send(self._socket, {"points": asdict(host.points)})
            await send(self._socket, {"standing": self._standing()})
            await self._news.wait()
            self._news.clear()

    def _standing(self) -> Answer:
        controls = self._controls
        holder = "you" if controls.holder is self else "nobody" if controls.holder is None else "another"
        holder = holder if controls.reserved is None else "experiment"
        return {**self._desk.about(), **asdict(self._host.standing), "controls": holder}

    async def _frames(self) -> None:
        """Send frames as long as the page draws them; one that was late does not make the next one late."""
        clock = asyncio.get_running_loop().time
        due = clock()
        while True:
            due = max(due + 1.0 / FRAMES_HZ, clock() - 1.0)
            await asyncio.sleep(due - clock())
            end, view = self._host.samples.end, self._view
            if view.done or (end == self._shown_end and (view.look is None or view.look.mode != "hold")):
                continue
            if self._frame - self._drawn >= AHEAD:
                self._dropped += 1
                continue
            content = view.frame(self._frame + 1, self._dropped)
            self._shown_end = end
            if content is None:
                continue
            self._frame += 1
            with suppress(RuntimeError):  # the page has gone; whoever reads from it will end this
                await self._socket.send_bytes(content)

    async def _levels(self) -> None:
        """Send the levels of the last second as long as samples come."""
        shown = 0
        while True:
            await asyncio.sleep(1.0 / LEVELS_HZ)
            if self._host.samples.end != shown:
                shown = self._host.samples.end
                await send(self._socket, {"levels": self._desk.levels()})
