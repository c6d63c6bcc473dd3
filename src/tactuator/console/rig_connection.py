"""One connection of a page to the rig: requests in turn, frames as fast as the page draws them, and the status."""

from __future__ import annotations

import asyncio
import io
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import asdict, replace
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import WebSocket
from pydantic import Field

from tactuator.console.fields import CHANNELS_MAX, Count, Finite, Name
from tactuator.console.generator import GeneratorWave, peaks_of
from tactuator.console.loop_shape import shape_of
from tactuator.console.requests import Answer, Functions, bound, command_line, serve_requests, tenths
from tactuator.console.rig_calls import ListenSettings, MeasureSettings, Points
from tactuator.console.rig_process import RigProcess
from tactuator.console.rig_session import Page, RigSession
from tactuator.console.scope import KEPT_S, SIGNALS, Look, View
from tactuator.console.state import FILE
from tactuator.errors import BadInput, DeviceFault
from tactuator.io.controller import read_controller
from tactuator.io.reference import open_reference
from tactuator.measure.options import MeasurementOptions
from tactuator.plain import picked
from tactuator.rig.sound.cards import list_cards
from tactuator.signals.multisine import over_the_band
from tactuator.speech.coding import coding_names, coding_of, live_coding
from tactuator.speech.live.level import LevelSettings
from tactuator.speech.live.meter import LiveBlock
from tactuator.speech.reading import scan_speech
from tactuator.synthesis.design import design_controller
from tactuator.web.sockets import first_to_end, send

FRAMES_HZ = 50.0
AHEAD = 2
"""Frames that a page may have had and not drawn; what would come then is left out, and counted."""
LEVELS_HZ, HEARD_HZ = 8.0, 40.0
_OPTIONS = ("level_db_sl", "load", "confidence_db", "longest_s", "mains_hz")
"""Options of `measure response` that a page sets."""
_RECORD_COLUMNS = "time_s,reference,command_v,position_v"


class RigConnection(Page):
    """A page that is connected to the rig. apart: where a controller is designed."""

    def __init__(self, socket: WebSocket, session: RigSession, apart: Executor | None) -> None:
        super().__init__()
        self._socket, self.session, self.apart = socket, session, apart
        self.rig, self.controls = session.rig, session.controls
        self.view = View(self.rig.samples, self.rig.display.rate_hz, session.channels)
        self._frame = self._drawn = self._dropped = self._shown_end = 0
        self._points: Points | None = None

    async def serve(self) -> None:
        """Serve the page until it goes; if it had the controls, the generator goes silent."""
        self.controls.enter(self)
        try:
            requests = serve_requests(self._socket, bound(REQUESTS, self), self.session.uploads)
            await first_to_end(requests, self._tell(), self._frames(), self._levels(), self._heard())
        finally:
            if self.controls.leave(self):
                self.rig.call("generate", None)

    def driven_rig(self) -> RigProcess:
        """Return the rig, for this page to drive. Raises BadInput where the page watches."""
        self.controls.require(self)
        return self.rig

    def acknowledge(self, frame: int) -> None:
        """Count a frame as drawn."""
        self._drawn = min(max(self._drawn, frame), self._frame)

    async def _tell(self) -> None:
        while True:
            refused, self.refusals = self.refusals, []
            for text in refused:
                await send(self._socket, {"refused": text})
            points = self.rig.points
            if points is not None and points is not self._points:
                self._points = points
                await send(self._socket, {"points": asdict(points) | self.session.measurement})
            await send(self._socket, {"standing": self._standing()})
            await self.news.wait()
            self.news.clear()

    def _standing(self) -> Answer:
        controls = self.controls
        holder = "you" if controls.holder is self else "nobody" if controls.holder is None else "another"
        holder = holder if controls.reserved is None else "experiment"
        return {**self.session.about(), **asdict(self.rig.status), "controls": holder}

    async def _frames(self) -> None:
        """Send frames as long as the page draws them; one that was late does not make the next one late."""
        clock = asyncio.get_running_loop().time
        due = clock()
        while True:
            due = max(due + 1.0 / FRAMES_HZ, clock() - 1.0)
            await asyncio.sleep(due - clock())
            end, view = self.rig.samples.end, self.view
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
            with suppress(RuntimeError):  # the page has gone; its requests end this
                await self._socket.send_bytes(content)

    async def _levels(self) -> None:
        shown = 0
        while True:
            await asyncio.sleep(1.0 / LEVELS_HZ)
            if self.rig.samples.end != shown:
                shown = self.rig.samples.end
                await send(self._socket, {"levels": self.session.levels()})

    async def _heard(self) -> None:
        """Send what live sound asks and what is felt of it, block by block: twice as often looked at as they come."""
        shown = self.rig.heard
        while True:
            await asyncio.sleep(1.0 / HEARD_HZ)
            block = self.rig.heard
            if block is not None and block is not shown:
                shown = block
                await send(self._socket, {"heard": _shown(block)})


def _shown(block: LiveBlock) -> Answer:
    levels = {
        "felt_db_sl": [*block.felt_db_sl.values()],
        "asked_db_sl": [*block.asked_db_sl.values()],
        "felt_spectrum_db_sl": block.felt_spectrum_db_sl,
        "asked_spectrum_db_sl": block.asked_spectrum_db_sl,
    }
    return {
        **{name: tenths(values) for name, values in levels.items()},
        **picked(block, "time_s", "delay_s", "dropouts", "muted"),
        "frequency_hz": block.frequency_hz.tolist(),
    }


async def take(page: RigConnection) -> Answer:
    """Take the controls, whichever page has them."""
    page.controls.take(page)
    return {}


async def give(page: RigConnection) -> Answer:
    """Let the controls go."""
    page.controls.give(page)
    return {}


async def drawn(page: RigConnection, frame: Count) -> None:
    """Take a frame as drawn, without an answer."""
    page.acknowledge(frame)


async def look(page: RigConnection, look: Look) -> Answer:
    """Set the page's picture."""
    page.view.set(look)
    return {}


async def stop(page: RigConnection) -> Answer:
    """Let the generator go silent: the button Stop is POST /rest, which ends everything."""
    page.session.end("generate", None)
    return {}


async def rest(page: RigConnection) -> None:
    """Bring the rig to rest, whichever page asks, without an answer."""
    page.session.end("rest")


async def live(page: RigConnection) -> Answer:
    """Play the generator and send every sample, until something else is asked for."""
    page.driven_rig().call("live")
    return {}


def listen(page: RigConnection, settings: ListenSettings) -> Answer:
    """Let fingers feel a microphone, or a file at its own pace; return the command that does the same."""
    rig, session = page.driven_rig(), page.session
    LevelSettings(settings.level_db_sl)
    live_coding(coding_of(settings.coding if settings.coding in coding_names() else "?"))
    path = session.uploads.path(settings.file) if settings.file else None
    if path is not None:
        scan_speech(path)  # a file that is no sound is refused here, a microphone by the rig's process
    place = "" if path is None else str(path)
    rig.call("listen", replace(settings, file=place))
    command = command_line(
        "listen",
        controller="controller.json",
        rig=rig.spec,
        input=settings.microphone or None if path is None else path.name,
        coding=settings.coding,
        level=settings.level_db_sl,
    )
    return {"command": command}


async def mute(page: RigConnection, muted: bool) -> Answer:
    """Let live sound go on unfelt, or be felt again."""
    page.driven_rig().call("mute", muted)
    return {}


def microphones(page: RigConnection) -> Answer:
    """Return the names of the microphones of the machine where the console runs."""
    with suppress(BadInput, DeviceFault):
        return {"microphones": [card.full_name for card in list_cards() if card.inputs]}
    return {"microphones": []}  # without PortAudio: the refusal comes when one is asked for


def reopen(page: RigConnection) -> Answer:
    """Open the rig anew after it has gone."""
    if page.controls.reserved is None:
        page.driven_rig().reopen()
    elif page.rig.status.mode == "gone":
        page.rig.reopen()
    else:
        raise BadInput("the rig is there, and an experiment has it", "opening one that has gone")
    return {}


async def wave(page: RigConnection, wave: GeneratorWave) -> Answer:
    """Set the generator. wave: its file is a key."""
    path = str(page.session.uploads.path(wave.file)) if wave.kind == "file" else ""
    page.driven_rig().call("generate", replace(wave, file=path))
    return {}


async def touch(page: RigConnection, channel: Name, load: Name | None) -> Answer:
    """Put a load of the display file on a channel's simulated finger port; None takes it off."""
    rig, described = page.driven_rig(), page.session.display.channel(channel)
    if load is not None:
        described.load(load)
    rig.call("touch", channel, load)
    return {}


async def press(page: RigConnection, channel: Name, force_v: Annotated[Finite, Field(ge=-100.0, le=100.0)]) -> Answer:
    """Press on a channel's simulated finger port with a force, volts of command, from now on."""
    rig = page.driven_rig()
    page.session.display.channel(channel)
    rig.call("press", channel, force_v)
    return {}


async def controller(
    page: RigConnection,
    source: Literal["file", "loops", "design"],
    file: Name = "",
    shapes: Annotated[dict[Name, dict[str, Any]] | None, Field(max_length=CHANNELS_MAX)] = None,
) -> Answer:
    """Load a controller: of an uploaded file (its key), of the loops in the page, or a new design."""
    page.driven_rig()
    session, name = page.session, "a design"
    if source == "file":
        path = session.uploads.path(file)
        made, name = await asyncio.to_thread(read_controller, path), path.name
    elif source == "loops":
        given = {name: shape_of(document) for name, document in (shapes or {}).items()}
        made, name = await asyncio.to_thread(session.state.controller, FILE, given), "loops of the page"
    else:
        made = await asyncio.get_running_loop().run_in_executor(page.apart, design_controller, session.display)
    session.load(made, name)
    return {"hash": made.content_hash}


def peaks(page: RigConnection, file: Name) -> Answer:
    """Return the greatest sample of each channel of a reference file."""
    return {"peaks": peaks_of(open_reference(page.session.uploads.path(file)))}


def expected(page: RigConnection, level_db_sl: Finite) -> Answer:
    """Return the levels that the loaded controller's model expects."""
    return page.session.expected(level_db_sl)


def save(page: RigConnection, channel: Name, span_s: Annotated[Finite, Field(gt=0.0, le=KEPT_S)], end: Count) -> Answer:
    """Return the samples of one channel, up to row `end`, as a record (CSV)."""
    channels, display = page.session.channels, page.session.display
    column, rate_hz = channels.index(display.channel(channel).name), display.rate_hz
    rows = page.rig.samples.rows(max(0, end - round(span_s * rate_hz)), end)
    if not len(rows):
        raise BadInput("those samples are not kept any more", f"the last {KEPT_S:g} s")
    held = rows[:, [len(channels) * k + column for k in range(len(SIGNALS))]].astype(np.float64)
    time_s = np.arange(len(rows)) / rate_hz
    written = io.StringIO()
    np.savetxt(written, np.column_stack((time_s, held)), "%.9g", ",", header=_RECORD_COLUMNS, comments="")
    return {"text": written.getvalue(), "samples": len(rows), "name": f"{channel}.csv"}


def measure(page: RigConnection, settings: MeasureSettings) -> Answer:
    """Measure the response; return the command that does the same."""
    rig, session = page.driven_rig(), page.session
    controller, channels = session.loaded_controller(), tuple(settings.channels or session.channels)
    bands = [session.display.channel(name).threshold.band_hz for name in channels]
    band_hz = (max(low for low, _ in bands), min(high for _, high in bands))
    played = settings.frequency_hz or tuple(over_the_band(band_hz, settings.mains_hz))
    rig.points = None
    session.measurement = {"number": session.measurement["number"] + 1, "controller": session.named["name"]}
    full: dict[str, Any] = {"channels": channels, "frequency_hz": played, "band_hz": band_hz}
    rig.call("measure", controller, replace(settings, **full, controller_hash=controller.content_hash))
    usual = {name: getattr(MeasurementOptions, name) for name in _OPTIONS} | {"rig": "simulated", "seed": 0}
    usual["mains_hz"] = controller.display.mains_hz(None, MeasurementOptions.mains_hz)
    options = {**{name: getattr(settings, name) for name in _OPTIONS}, "rig": rig.spec, "seed": rig.seed}
    command = command_line(
        "measure response",
        controller="controller.json",
        channel=[] if set(channels) == set(session.channels) else channels,
        frequency_hz=",".join(f"{hertz:g}" for hertz in settings.frequency_hz) or None,
        **{name: value for name, value in options.items() if value != usual[name]},
        out="response.csv",
    )
    return {"command": command}


_FUNCTIONS = (
    take, give, live, listen, mute, microphones, stop, rest, reopen, controller, wave, peaks, touch, press, measure,
    expected, look, drawn, save,
)  # fmt: skip
REQUESTS: Functions = {function.__name__: function for function in _FUNCTIONS}
"""Functions of RigConnection."""
