"""One connection of the console's page: requests are answered in turn, figures follow when they are ready."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass

from fastapi import WebSocket, WebSocketDisconnect

from tactuator.console import messages
from tactuator.console.asked import Answer, ViewRequest, number_of
from tactuator.console.chart.frame import MARKS_HZ, frame
from tactuator.console.chart.regions import ground
from tactuator.console.figures import settled_figures, verdict_rows
from tactuator.console.shaping.factors import LoopShape, shape_of
from tactuator.console.shaping.moved_point import with_point_at
from tactuator.console.workshop import Workshop
from tactuator.errors import TactuatorError
from tactuator.io.controller import controller_text
from tactuator.synthesis.verdict import whole_verdict
from tactuator.web.sockets import first_to_end, receive_text, send

_DEFECT = "a defect of the console, which the server's log tells; what is in the page is still there"
_LOGGER = logging.getLogger("tactuator.web.lab")


@dataclass(frozen=True)
class _Wanted:
    """The shape whose figures are wanted, and the request that it came with."""

    request: int
    display: str
    channel: str
    shape: LoopShape


class ConsoleConnection:
    """A page that is connected; the frames of a drag are never kept waiting by the figures, which may be of a moment
    ago and then are made anew.

    apart: where figures are computed; a process of its own leaves the interpreter to the frames. None: a thread.
    """

    def __init__(self, socket: WebSocket, workshop: Workshop, apart: Executor | None = None) -> None:
        self._socket, self._workshop, self._apart = socket, workshop, apart
        self._wanted: _Wanted | None = None
        self._changed = asyncio.Event()

    async def serve(self) -> None:
        """Serve the page until it goes, its requests in turn."""
        await first_to_end(self._read(), self._figures())

    async def _read(self) -> None:
        while True:
            number = None
            try:
                text = await receive_text(self._socket)
                number = number_of(text)
                answer = await self._answer(messages.request_of(text))
            except TactuatorError as error:
                answer = {"error": str(error)}
            except WebSocketDisconnect:
                raise
            except Exception:
                _LOGGER.exception("a request of the console failed")
                answer = {
                    "error": "a defect of the console; the server's log has it. What is in the page is still there"
                }
            await send(self._socket, {"id": number, **answer})

    async def _figures(self) -> None:
        """Send the figures of the newest shape, one after another."""
        while True:
            await self._changed.wait()
            self._changed.clear()
            wanted = self._wanted
            if wanted is None:
                continue
            try:
                found = await self._figures_of(wanted)
            except TactuatorError as error:
                found = {"refused": str(error)}
            except Exception:
                _LOGGER.exception("figures of the console failed")
                found = {"refused": _DEFECT}
            await send(self._socket, {"of": wanted.request, "channel": wanted.channel, "figures": found})

    async def _figures_of(self, wanted: _Wanted) -> Answer:
        workshop, place = self._workshop, (wanted.display, wanted.channel)
        system, known = workshop.system(*place, wanted.shape), workshop.known(*place, wanted.shape)
        loop = asyncio.get_running_loop()
        own, found = await loop.run_in_executor(self._apart, settled_figures, workshop.bench(*place), system, known)
        if known is None:
            workshop.keep(*place, wanted.shape, own)
        return found

    async def _answer(self, request: messages.Request) -> Answer:
        workshop = self._workshop
        match request:
            case messages.Start():
                return {"named": workshop.named, "examples": workshop.examples()}
            case messages.Open():
                return _opened(workshop, request.display)
            case messages.Bring():
                return await asyncio.to_thread(_brought, workshop, request.display, request.channel)
            case messages.Draw():
                return self._drawn(request, shape_of(request.shape))
            case messages.MovePoint():
                on = workshop.bench(request.display, request.channel)
                shape = with_point_at(
                    shape_of(request.shape), on.family[0].sampled, request.hz, request.turn_deg, request.gain_db
                )
                return self._drawn(request, shape)
            case messages.Design():
                shape = await asyncio.to_thread(workshop.designed, request.display, request.channel)
                return {
                    "shape": shape.document(),
                    "command": f"tactuator design {workshop.command_name(request.display)}",
                }
            case ViewRequest():
                with workshop.drawer.named_plainly():
                    return await asyncio.to_thread(request.answer, workshop)
            case messages.Check():
                shapes = {name: shape_of(one) for name, one in request.shapes.items()}
                return await asyncio.to_thread(_checked, workshop, request.display, shapes)

    def _drawn(self, request: messages.Draw | messages.MovePoint, shape: LoopShape) -> Answer:
        workshop = self._workshop
        on = workshop.bench(request.display, request.channel)
        drawn = frame(on, workshop.system(request.display, request.channel, shape))
        self._wanted = _Wanted(request.id, request.display, request.channel, shape)
        self._changed.set()
        return {"shape": shape.document(), "frame": drawn}


def _opened(workshop: Workshop, key: str) -> Answer:
    display = workshop.open(key)
    return {
        "name": display.name,
        "rate_hz": display.rate_hz,
        "delay_samples": display.delay_samples,
        "file": workshop.command_name(key),
        "channels": [
            {
                "name": one.name,
                "finger": one.finger,
                "loop": one.feedback.structure != "none",
                "loads": [load.name for load in one.loads],
                "models": 1 + len(one.family),
            }
            for one in display.channels
        ],
    }


def _brought(workshop: Workshop, key: str, channel: str) -> Answer:
    on = workshop.bench(key, channel)
    return {
        "frequency_hz": [float(f"{one:.6g}") for one in on.frequency_hz.tolist()],
        "time_s": on.time_s.tolist(),
        "marks_hz": MARKS_HZ,
        "loads": [on.family[place].load for place in on.shown],
        "plants": len(on.family),
        "ground": ground(on),
        "shape": workshop.begun(key, channel).document(),
    }


def _checked(workshop: Workshop, key: str, shapes: Mapping[str, LoopShape]) -> Answer:
    controller = workshop.controller(key, shapes)
    return {
        "verdict": verdict_rows(whole_verdict(controller)),
        "text": controller_text(controller),
        "command": "tactuator check controller.json",
    }
