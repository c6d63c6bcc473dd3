"""The connection of the console's page: requests are answered in turn, figures follow when they are ready."""

from __future__ import annotations

import asyncio
from concurrent.futures import Executor
from pathlib import Path
from typing import Annotated, Any

from fastapi import WebSocket
from pydantic import Field

from tactuator.api.controller import check
from tactuator.console import display_view, experiment_view, identify_view, prefilter_view, speech_view
from tactuator.console.fields import CHANNELS_MAX, Finite, Name
from tactuator.console.loop_chart import frame, ground, settled_figures, verdict_rows
from tactuator.console.loop_shape import LoopShape, drag_ranges, shape_of, with_point_at
from tactuator.console.requests import DEFECT, LOGGER, Answer, Functions, View, bound, digits, serve_requests
from tactuator.console.state import ConsoleState
from tactuator.errors import TactuatorError
from tactuator.io.controller import controller_text
from tactuator.plain import picked
from tactuator.report.nichols import MARKS_HZ
from tactuator.web.sockets import first_to_end, send

VIEWS = (
    View("start", "Start"),
    display_view.VIEW,
    identify_view.VIEW,
    View("loop", "Loop", of_display=True),
    prefilter_view.VIEW,
    speech_view.VIEW,
    experiment_view.VIEW,
    View("response", "Response", of_rig=True),
    View("scope", "Scope", of_rig=True),
)
"""The views in the page's order; functions of the loop are here, those of the rig in rig_connection.py."""


def start(state: ConsoleState) -> Answer:
    """Return the views, the display of the command line and the name of its file, whether there is a rig, examples."""
    file = "" if state.named is None else Path(state.command_name(state.named)).name
    views = {view.name: picked(view, "title", "of_display", "of_rig") for view in VIEWS}
    return {"views": views, "named": state.named, "file": file, "rig": state.has_rig, "examples": state.examples()}


def open_display(state: ConsoleState, display: Name) -> Answer:
    """Read a display anew, and return what the page shows of it."""
    opened = state.open(display)
    return {
        **picked(opened, "name", "rate_hz", "delay_samples"),
        "file": state.command_name(display),
        "channels": [
            picked(channel, "name", "finger")
            | {"loop": channel.feedback.structure != "none", "loads": [load.name for load in channel.loads]}
            | {"models": 1 + len(channel.family)}
            for channel in opened.channels
        ],
    }


def bring(state: ConsoleState, display: Name, channel: Name) -> Answer:
    """Return what a channel's chart is drawn on: frequencies, instants and the ground; the first shape, and the design
    if it is made.
    """
    plants = state.plants(display, channel)
    known = state.known_design(display, channel)
    first = state.first_shape(display, channel).document()
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


def design(state: ConsoleState, display: Name, channel: Name) -> Answer:
    """Design a channel's loop; return its shape, and the command that does the same."""
    shape = state.designed(display, channel)
    return {"shape": shape.document(), "command": f"tactuator design {state.command_name(display)}"}


Shapes = Annotated[dict[Name, dict[str, Any]], Field(max_length=CHANNELS_MAX)]


def check_loops(state: ConsoleState, display: Name, shapes: Shapes) -> Answer:
    """Return the whole verdict, the text of the controller file and the command that checks it."""
    controller = state.controller(display, {name: shape_of(document) for name, document in shapes.items()})
    return {
        "verdict": verdict_rows(check(controller)),
        "text": controller_text(controller),
        "command": "tactuator check controller.json",
    }


REQUESTS: Functions = {
    "start": start,
    "open": open_display,
    "bring": bring,
    "design": design,
    "check": check_loops,
    **{f"{view.name}.{name}": function for view in VIEWS for name, function in view.functions.items()},
}
"""Functions of ConsoleState."""


class ConsoleConnection:
    """A page that is connected; the frames of a drag are never kept waiting by the figures, which may be of a moment
    ago and then are made anew.

    apart: where figures are computed; a separate process leaves the interpreter to the frames. None: a thread.
    """

    def __init__(self, socket: WebSocket, state: ConsoleState, apart: Executor | None = None) -> None:
        self._socket, self.state, self._apart = socket, state, apart
        self._drawings = 0
        self._newest: tuple[int, str, str, LoopShape] | None = None
        self._changed = asyncio.Event()

    async def serve(self) -> None:
        """Serve the page until it goes, its requests in turn."""
        functions = bound(REQUESTS, self.state) | bound(DRAWINGS, self)
        await first_to_end(serve_requests(self._socket, functions, self.state.uploads), self._figures())

    def drawn(self, display: str, channel: str, shape: LoopShape) -> Answer:
        """Return a shape and its curves; its figures follow."""
        drawn = frame(self.state.plants(display, channel), self.state.system(display, channel, shape))
        self._drawings += 1
        self._newest = self._drawings, display, channel, shape
        self._changed.set()
        return {"drawing": self._drawings, "shape": shape.document(), "frame": drawn}

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
                figures = {"refused": "; ".join(error.lines)}
            except Exception:
                LOGGER.exception("figures of the console failed")
                figures = {"refused": DEFECT}
            await send(self._socket, {"of": number, "channel": channel, "figures": figures})

    async def _figures_of(self, display: str, channel: str, shape: LoopShape) -> Answer:
        state, place = self.state, (display, channel)
        known = state.known(*place, shape)
        plants, system, loop = state.plants(*place), state.system(*place, shape), asyncio.get_running_loop()
        controller, figures = await loop.run_in_executor(self._apart, settled_figures, plants, system, known)
        if known is None:
            state.keep(*place, shape, controller)
        return figures


async def draw(page: ConsoleConnection, display: Name, channel: Name, shape: dict[str, Any]) -> Answer:
    """Return the curves of a shape; its figures follow."""
    return page.drawn(display, channel, shape_of(shape))


async def move_point(
    page: ConsoleConnection,
    display: Name,
    channel: Name,
    shape: dict[str, Any],
    hz: Annotated[Finite, Field(gt=0.0)],
    turn_deg: Finite,
    gain_db: Annotated[Finite, Field(ge=-200.0, le=200.0)],
) -> Answer:
    """Bring the point of the curve at `hz`, turned by `turn_deg`, to `gain_db`, and return the curves of that."""
    plant = page.state.plants(display, channel).family[0].sampled
    return page.drawn(display, channel, with_point_at(shape_of(shape), plant, hz, turn_deg, gain_db))


DRAWINGS: Functions = {"draw": draw, "point": move_point}
"""Functions of ConsoleConnection."""
