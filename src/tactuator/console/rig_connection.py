"""One connection of a page to the rig: orders in turn, frames as fast as the page draws them, and the status."""

import asyncio
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import asdict, dataclass

from fastapi import WebSocket

from tactuator.console import rig_orders as orders
from tactuator.console.generator import GeneratorWave
from tactuator.console.requests import Answer, Count, PageRequest, Requests, serve_requests
from tactuator.console.rig_session import Expected, FilePeaks, Page, RigSession, Save, StopPlaying, UseController
from tactuator.console.scope import Look, View
from tactuator.errors import BadInput
from tactuator.web.sockets import first_to_end, send

FRAMES_HZ = 50.0
AHEAD = 2
"""Frames that a page may have had and not drawn; what would come then is left out, and counted."""
LEVELS_HZ = 8.0


class TakeControls(PageRequest):
    """Request for the controls, whichever page has them."""


class GiveControls(PageRequest):
    """Request to let the controls go."""


@dataclass(frozen=True)
class Acknowledge(PageRequest):
    """Message that the page has drawn a frame."""

    frame: Count


REQUESTS: Requests[PageRequest] = {
    "take": TakeControls,
    "give": GiveControls,
    "live": orders.LiveOrder,
    "stop": StopPlaying,
    "rest": orders.RestOrder,
    "reopen": orders.ReopenOrder,
    "controller": UseController,
    "wave": GeneratorWave,
    "peaks": FilePeaks,
    "touch": orders.TouchOrder,
    "press": orders.PressOrder,
    "measure": orders.MeasureSettings,
    "expected": Expected,
    "look": Look,
    "drawn": Acknowledge,
    "save": Save,
}


def _listen(session: RigSession) -> None:
    """Let the pages be told what the rig's process tells; it comes on another thread."""
    loop = asyncio.get_running_loop()

    def tell(news: orders.News) -> None:
        with suppress(RuntimeError):  # the server has ended, and with it the loop
            if isinstance(news, orders.Refused):
                loop.call_soon_threadsafe(session.controls.tell_refusal, news.text)
            else:
                loop.call_soon_threadsafe(session.controls.tell_all)

    session.rig.changed = tell


class RigConnection:
    """A page that is connected to the rig. apart: where a controller is designed."""

    def __init__(self, socket: WebSocket, session: RigSession, apart: Executor | None) -> None:
        self._socket, self._session, self._apart = socket, session, apart
        self._rig, self._controls = session.rig, session.controls
        self._view = View(self._rig.samples, self._rig.display.rate_hz, session.channels)
        self._frame = self._drawn = self._dropped = self._shown_end = 0
        self._page = Page()
        self._points: orders.Points | None = None

    async def serve(self) -> None:
        """Serve the page until it goes; if it had the controls, the generator goes silent."""
        _listen(self._session)
        self._controls.enter(self._page)
        try:
            requests = serve_requests(self._socket, REQUESTS, self._answer)
            await first_to_end(requests, self._tell(), self._frames(), self._levels())
        finally:
            if self._controls.leave(self._page):
                self._rig.order(orders.GenerateOrder(None))

    async def _answer(self, number: int, request: PageRequest) -> Answer | None:
        controls, session = self._controls, self._session
        match request:
            case Acknowledge():
                self._drawn = min(max(self._drawn, request.frame), self._frame)
                return None
            case Look():
                self._view.set(request)
                return {}
            case TakeControls():
                controls.take(self._page)
                return {}
            case GiveControls():
                controls.give(self._page)
                return {}
            case Save() | Expected() | FilePeaks():
                pass
            case StopPlaying() | orders.RestOrder():
                if controls.reserved is not None:
                    controls.reserved()
                    return {}
            case orders.ReopenOrder() if controls.reserved is not None:
                if self._rig.status.mode != "gone":
                    raise BadInput("the rig is there, and an experiment has it", "opening one that has gone")
            case _:
                controls.require(self._page)
        with session.uploads.named_plainly():
            if isinstance(request, UseController):
                return await session.use_controller(request, self._apart)
            return await asyncio.to_thread(session.answer, request)

    async def _tell(self) -> None:
        while True:
            refused, self._page.refusals = self._page.refusals, []
            for text in refused:
                await send(self._socket, {"refused": text})
            points = self._rig.points
            if points is not None and points is not self._points:
                self._points = points
                await send(self._socket, {"points": asdict(points) | self._session.measurement})
            await send(self._socket, {"standing": self._standing()})
            await self._page.news.wait()
            self._page.news.clear()

    def _standing(self) -> Answer:
        controls = self._controls
        holder = "you" if controls.holder is self._page else "nobody" if controls.holder is None else "another"
        holder = holder if controls.reserved is None else "experiment"
        return {**self._session.about(), **asdict(self._rig.status), "controls": holder}

    async def _frames(self) -> None:
        """Send frames as long as the page draws them; one that was late does not make the next one late."""
        clock = asyncio.get_running_loop().time
        due = clock()
        while True:
            due = max(due + 1.0 / FRAMES_HZ, clock() - 1.0)
            await asyncio.sleep(due - clock())
            end, view = self._rig.samples.end, self._view
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
        shown = 0
        while True:
            await asyncio.sleep(1.0 / LEVELS_HZ)
            if self._rig.samples.end != shown:
                shown = self._rig.samples.end
                await send(self._socket, {"levels": self._session.levels()})
