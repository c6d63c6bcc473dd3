"""The connection of the console's page: requests are answered in turn, figures follow when they are ready."""

from __future__ import annotations

import asyncio
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from fastapi import WebSocket
from pydantic import Field

from tactuator.api.controller import check
from tactuator.console import display_view, identify_view, prefilter_view, speech_view, study
from tactuator.console.loop_chart import MARKS_HZ, frame, ground, settled_figures, verdict_rows
from tactuator.console.loop_shape import LoopShape, drag_ranges, shape_of, with_point_at
from tactuator.console.requests import (
    CHANNELS_MAX,
    DEFECT,
    LOGGER,
    Answer,
    Finite,
    Name,
    PageRequest,
    Requests,
    ViewRequest,
    digits,
    serve_requests,
)
from tactuator.console.state import ConsoleState
from tactuator.errors import TactuatorError
from tactuator.io.controller import controller_text
from tactuator.table import picked
from tactuator.web.sockets import first_to_end, send


@dataclass(frozen=True)
class Start(ViewRequest):
    """Request for what the start page shows."""

    def answer(self, state: ConsoleState) -> Answer:
        """Return the display of the command line and the name of its file, whether there is a rig, the examples."""
        file = "" if state.named is None else Path(state.command_name(state.named)).name
        return {"named": state.named, "file": file, "rig": state.has_rig, "examples": state.examples()}


@dataclass(frozen=True)
class Open(ViewRequest):
    """Request for a display, read anew."""

    display: Name

    def answer(self, state: ConsoleState) -> Answer:
        """Return what the page shows of the display."""
        display = state.open(self.display)
        return {
            **picked(display, "name", "rate_hz", "delay_samples"),
            "file": state.command_name(self.display),
            "channels": [
                picked(channel, "name", "finger")
                | {"loop": channel.feedback.structure != "none", "loads": [load.name for load in channel.loads]}
                | {"models": 1 + len(channel.family)}
                for channel in display.channels
            ],
        }


@dataclass(frozen=True)
class _OfChannel(ViewRequest):
    display: Name
    channel: Name


class Bring(_OfChannel):
    """Request for what a channel's chart is drawn on, with the shape to begin with."""

    def answer(self, state: ConsoleState) -> Answer:
        """Return frequencies, instants and the chart's ground; the first shape, and the design if it is made."""
        plants = state.plants(self.display, self.channel)
        known = state.known_design(self.display, self.channel)
        first = state.first_shape(self.display, self.channel).document()
        design = None if known is None else known.document()
        return {
            "frequency_hz": digits(plants.frequency_hz),
            "time_s": plants.time_s.tolist(),
            "marks_hz": MARKS_HZ,
            "loads": [plants.family[place].load for place in plants.shown],
            "plants": len(plants.family),
            "ground": ground(plants),
            "ranges": drag_ranges(plants.display.rate_hz),
            "first": first,
            "design": design,
            "shape": design or first,
        }


class Design(_OfChannel):
    """Request to run the synthesis for a channel."""

    def answer(self, state: ConsoleState) -> Answer:
        """Return the shape that the synthesis found, and the command that does the same."""
        shape = state.designed(self.display, self.channel)
        return {"shape": shape.document(), "command": f"tactuator design {state.command_name(self.display)}"}


@dataclass(frozen=True)
class Draw(PageRequest):
    """Request for the curves of a shape; its figures follow."""

    display: Name
    channel: Name
    shape: dict[str, Any]

    def wanted(self, state: ConsoleState) -> LoopShape:
        """Return the shape to be drawn."""
        return shape_of(self.shape)


@dataclass(frozen=True)
class MovePoint(Draw):
    """Request to bring the point of the curve at `hz`, turned by `turn_deg`, to `gain_db`, and to draw that."""

    hz: Annotated[Finite, Field(gt=0.0)]
    turn_deg: Finite
    gain_db: Annotated[Finite, Field(ge=-200.0, le=200.0)]

    def wanted(self, state: ConsoleState) -> LoopShape:
        """Return the shape with the point where it is wanted."""
        plant = state.plants(self.display, self.channel).family[0].sampled
        return with_point_at(shape_of(self.shape), plant, self.hz, self.turn_deg, self.gain_db)


@dataclass(frozen=True)
class Check(ViewRequest):
    """Request for the whole verdict, and the text of the controller file."""

    display: Name
    shapes: Annotated[dict[Name, dict[str, Any]], Field(max_length=CHANNELS_MAX)]

    def answer(self, state: ConsoleState) -> Answer:
        """Return the verdict, the text and the command that checks it."""
        shapes = {name: shape_of(document) for name, document in self.shapes.items()}
        controller = state.controller(self.display, shapes)
        return {
            "verdict": verdict_rows(check(controller)),
            "text": controller_text(controller),
            "command": "tactuator check controller.json",
        }


REQUESTS: Requests[ViewRequest | Draw] = {
    "start": Start,
    "open": Open,
    "bring": Bring,
    "draw": Draw,
    "point": MovePoint,
    "design": Design,
    "check": Check,
    **display_view.REQUESTS,
    **identify_view.REQUESTS,
    **prefilter_view.REQUESTS,
    **speech_view.REQUESTS,
    **study.REQUESTS,
}


class ConsoleConnection:
    """A page that is connected; the frames of a drag are never kept waiting by the figures, which may be of a moment
    ago and then are made anew.

    apart: where figures are computed; a process of its own leaves the interpreter to the frames. None: a thread.
    """

    def __init__(self, socket: WebSocket, state: ConsoleState, apart: Executor | None = None) -> None:
        self._socket, self._state, self._apart = socket, state, apart
        self._newest: tuple[int, str, str, LoopShape] | None = None
        self._changed = asyncio.Event()

    async def serve(self) -> None:
        """Serve the page until it goes, its requests in turn."""
        await first_to_end(serve_requests(self._socket, REQUESTS, self._answer), self._figures())

    async def _answer(self, number: int, request: ViewRequest | Draw) -> Answer:
        if isinstance(request, ViewRequest):
            with self._state.uploads.named_plainly():
                return await asyncio.to_thread(request.answer, self._state)
        place = request.display, request.channel
        plants, shape = self._state.plants(*place), request.wanted(self._state)
        drawn = frame(plants, self._state.system(*place, shape))
        self._newest = number, *place, shape
        self._changed.set()
        return {"shape": shape.document(), "frame": drawn}

    async def _figures(self) -> None:
        """Send the figures of the newest shape, one after another."""
        while True:
            await self._changed.wait()
            self._changed.clear()
            if self._newest is None:
                continue
            number, display, channel, shape = self._newest
            try:
                figures = await self._figures_of(display, channel, shape)
            except TactuatorError as error:
                figures = {"refused": str(error)}
            except Exception:
                LOGGER.exception("figures of the console failed")
                figures = {"refused": DEFECT}
            await send(self._socket, {"of": number, "channel": channel, "figures": figures})

    async def _figures_of(self, display: str, channel: str, shape: LoopShape) -> Answer:
        state, place = self._state, (display, channel)
        known = state.known(*place, shape)
        plants, system, loop = state.plants(*place), state.system(*place, shape), asyncio.get_running_loop()
        controller, figures = await loop.run_in_executor(self._apart, settled_figures, plants, system, known)
        if known is None:
            state.keep(*place, shape, controller)
        return figures
