"""The rig as the pages use it: who has the controls, the controller that is loaded, and orders made of requests."""

from __future__ import annotations

import asyncio
import io
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from tactuator.arrays import FloatArray
from tactuator.console import rig_orders as orders
from tactuator.console.generator import MOST_DB_SL, GeneratorWave, peaks_of
from tactuator.console.loop_shape import shape_of
from tactuator.console.requests import CHANNELS_MAX, Answer, Count, Finite, Name, PageRequest, command_line
from tactuator.console.rig_process import Levels, RigProcess
from tactuator.console.scope import KEPT_S, SIGNALS
from tactuator.console.state import FILE, ConsoleState
from tactuator.errors import BadInput
from tactuator.io.controller import read_controller
from tactuator.io.reference import open_reference
from tactuator.measure.error import ChannelPrediction
from tactuator.measure.options import MeasurementOptions
from tactuator.model.controller import Controller
from tactuator.model.description import Channel
from tactuator.perception.curve import AMPLITUDE_JND_DB, check_level
from tactuator.signals.decibels import db
from tactuator.signals.multisine import over_the_band
from tactuator.synthesis.design import design_controller
from tactuator.synthesis.felt import felt_db_sl, felt_hum_v
from tactuator.table import picked

_CURVE_POINTS = 120
_OPTIONS = ("level_db_sl", "load", "confidence_db", "longest_s", "mains_hz")
"""Options of `measure` that a page sets."""
_RECORD_COLUMNS = "time_s,reference,command_v,position_v"


class StopPlaying(PageRequest):
    """Request for silence: the generator stops."""


@dataclass(frozen=True)
class UseController(PageRequest):
    """Request to load a controller: of an uploaded file (its key), of the loops in the page, or a new design."""

    source: Literal["file", "loops", "design"]
    file: Name = ""
    shapes: Annotated[dict[Name, dict[str, Any]] | None, Field(max_length=CHANNELS_MAX)] = None


@dataclass(frozen=True)
class Expected(PageRequest):
    """Request for the levels that the loaded controller's model expects."""

    level_db_sl: Finite


@dataclass(frozen=True)
class FilePeaks(PageRequest):
    """Request for the greatest sample of each channel of a reference file."""

    file: Name


@dataclass(frozen=True)
class Save(PageRequest):
    """Request for the samples of one channel, up to row `end`, as a record (CSV)."""

    channel: Name
    span_s: Annotated[Finite, Field(gt=0.0, le=KEPT_S)]
    end: Count


class Page:
    """A page that may have the controls. news: set where its rig's status has changed; refusals: by the rig."""

    def __init__(self) -> None:
        self.news, self.refusals = asyncio.Event(), list[str]()


class Controls:
    """The pages of one rig, of which at most one has the controls. The first one gets them."""

    def __init__(self) -> None:
        self._pages: list[Page] = []
        self.holder: Page | None = None
        self.reserved: Callable[[], None] | None = None

    def reserve(self, stop: Callable[[], None]) -> None:
        """Give the rig to an experiment until `free`; stop: ends what it plays, whoever asks. Raises BadInput where a
        page has the controls, or another experiment.
        """
        if self.reserved is not None:
            raise BadInput("an experiment has the rig", "end that one first")
        if self.holder is not None:
            raise BadInput("another page has the controls of the rig", "take them over, and begin then")
        self.reserved = stop
        self.tell_all()

    def free(self) -> None:
        """End the experiment's hold on the rig; the controls are then for whoever takes them."""
        self.reserved = None
        self.tell_all()

    def enter(self, page: Page) -> None:
        """Add a page; it gets the controls where it is alone and no experiment has the rig."""
        self._pages.append(page)
        if len(self._pages) == 1 and self.reserved is None:
            self.holder = page
        self.tell_all()

    def leave(self, page: Page) -> bool:
        """Remove a page, and return whether it had the controls, which are free then."""
        self._pages.remove(page)
        had = self.holder is page
        self.give(page)
        return had

    def take(self, page: Page) -> None:
        """Give a page the controls, whichever page had them. Raises BadInput where an experiment has the rig."""
        self._require_no_experiment()
        self.holder = page
        self.tell_all()

    def give(self, page: Page) -> None:
        """Let the controls go, where the page has them."""
        if self.holder is page:
            self.holder = None
        self.tell_all()

    def require(self, page: Page) -> None:
        """Raise BadInput where the page watches, or an experiment has the rig."""
        self._require_no_experiment()
        if self.holder is not page:
            raise BadInput("this page watches", "take over the controls first")

    def _require_no_experiment(self) -> None:
        if self.reserved is not None:
            raise BadInput("an experiment has the rig", "watching, stopping it, or ending it in its view")

    def tell_all(self) -> None:
        """Tell every page the rig's status."""
        for page in self._pages:
            page.news.set()

    def tell_refusal(self, text: str) -> None:
        """Tell whoever has the controls what the rig refused."""
        if self.holder is not None:
            self.holder.refusals.append(text)
            self.holder.news.set()


class RigSession:
    """Use of one rig by the pages of a console, whichever page it is. state: where the loops of the page are made."""

    def __init__(self, rig: RigProcess, state: ConsoleState) -> None:
        self.rig, self._display, self._state = rig, rig.display, state
        self.controls, self.uploads = Controls(), state.uploads
        self.channels = tuple(channel.name for channel in rig.display.channels)
        self._controller: Controller | None = None
        self._named = {"name": "", "curve": ""}
        self.measurement: dict[str, Any] = {"number": 0}

    def about(self) -> dict[str, Any]:
        """Return what a page has to know of the rig and its display."""
        display = self._display
        return {
            "rig": self.rig.spec,
            **picked(display, "rate_hz", display="name"),
            "channels": [
                picked(channel, "name", band_hz="threshold.band_hz", range_v="converter.range_v")
                | {"loads": [load.name for load in channel.loads], "loop": channel.feedback.structure != "none"}
                for channel in display.channels
            ],
            "controller": self._named,
            "signals": SIGNALS,
            "most_db_sl": MOST_DB_SL,
            "mains_hz": display.mains_hz(None, MeasurementOptions.mains_hz),
            "frequency_hz": self.rig.levels.frequency_hz.tolist(),
        }

    def levels(self) -> dict[str, Any] | None:
        """Return the levels of the last second, channel by channel, rounded to what is shown."""
        felt = self.rig.felt()
        if felt is None:
            return None
        return {
            "peak_hz": [round(level.peak_hz, 2) for level in felt],
            "peak_db_sl": [round(level.peak_db_sl, 1) for level in felt],
            "spectrum_db_sl": [np.round(level.spectrum_db_sl, 1).tolist() for level in felt],
            "level_db_sl": [round(level.level_db_sl, 2) for level in felt],
            "tone_db_sl": [None if level.tone_db_sl is None else round(level.tone_db_sl, 2) for level in felt],
            "command_mean_v": [round(level.command_mean_v, 4) for level in felt],
        }

    def answer(self, request: PageRequest) -> Answer:
        """Give the rig the order that a request asks for, and return the answer. Raises BadInput where it cannot be."""
        match request:
            case Save():
                return self._record(request)
            case FilePeaks():
                return {"peaks": peaks_of(open_reference(self.uploads.path(request.file)))}
            case Expected():
                return self._expected(request.level_db_sl)
            case orders.MeasureSettings():
                return self._measure(request)
            case StopPlaying():
                self.rig.order(orders.GenerateOrder(None))
            case GeneratorWave():
                path = str(self.uploads.path(request.file)) if request.kind == "file" else ""
                self.rig.order(orders.GenerateOrder(replace(request, file=path)))
            case orders.TouchOrder():
                channel = self._display.channel(request.channel)
                if request.load is not None:
                    channel.load(request.load)
                self.rig.order(request)
            case orders.PressOrder():
                self._display.channel(request.channel)
                self.rig.order(request)
            case orders.LiveOrder() | orders.RestOrder() | orders.ReopenOrder():
                self.rig.order(request)
        return {}

    async def use_controller(self, request: UseController, apart: Executor | None) -> Answer:
        """Load the controller that is asked for."""
        name = "a design"
        if request.source == "file":
            path = self.uploads.path(request.file)
            controller, name = await asyncio.to_thread(read_controller, path), path.name
        elif request.source == "loops":
            shapes = {name: shape_of(document) for name, document in (request.shapes or {}).items()}
            controller, name = await asyncio.to_thread(self._state.controller, FILE, shapes), "loops of the page"
        else:
            controller = await asyncio.get_running_loop().run_in_executor(apart, design_controller, self._display)
        controller.require_runs(self._display)
        curves = dict.fromkeys(channel.threshold.curve.name for channel in controller.display.channels)
        self._named = {"name": f"{name} ({controller.content_hash[:4]})", "curve": ", ".join(curves)}
        self._controller, self.rig.levels = controller, Levels(controller.display)
        self.rig.order(orders.LoadOrder(controller))
        return {"hash": controller.content_hash}

    def loaded_controller(self) -> Controller:
        """Return the controller that is loaded. Raises BadInput while there is none."""
        if self._controller is None or not self.rig.status.loaded:
            raise BadInput("no controller is loaded", "load one first")
        return self._controller

    def _expected(self, level_db_sl: float) -> Answer:
        low = min(channel.threshold.band_hz[0] for channel in self._display.channels)
        high = max(channel.threshold.band_hz[1] for channel in self._display.channels)
        frequency_hz = np.geomspace(low, high, _CURVE_POINTS)
        controller = self.loaded_controller()
        asked = {"asked_db_sl": level_db_sl, "jnd_db": AMPLITUDE_JND_DB, "frequency_hz": frequency_hz.tolist()}
        hum = {channel.name: expected_hum(controller, channel) for channel in controller.display.channels}
        return asked | {"curves": expected_curves(controller, level_db_sl, frequency_hz), "hum": hum}

    def _record(self, request: Save) -> Answer:
        column = self.channels.index(self._display.channel(request.channel).name)
        rate_hz = self._display.rate_hz
        rows = self.rig.samples.rows(max(0, request.end - round(request.span_s * rate_hz)), request.end)
        if not len(rows):
            raise BadInput("those samples are not kept any more", f"the last {KEPT_S:g} s")
        held = rows[:, [len(self.channels) * k + column for k in range(len(SIGNALS))]].astype(np.float64)
        time_s = np.arange(len(rows)) / rate_hz
        written = io.StringIO()
        np.savetxt(written, np.column_stack((time_s, held)), "%.9g", ",", header=_RECORD_COLUMNS, comments="")
        return {"text": written.getvalue(), "samples": len(rows), "name": f"{request.channel}.csv"}

    def _measure(self, settings: orders.MeasureSettings) -> Answer:
        check_level(settings.level_db_sl)
        controller, channels = self.loaded_controller(), tuple(settings.channels or self.channels)
        bands = [self._display.channel(name).threshold.band_hz for name in channels]
        band_hz = (max(low for low, _ in bands), min(high for _, high in bands))
        played = settings.frequency_hz or tuple(over_the_band(band_hz, settings.mains_hz))
        self.rig.points = None
        self.measurement = {"number": self.measurement["number"] + 1, "controller": self._named["name"]}
        full: dict[str, Any] = {"channels": channels, "frequency_hz": played, "band_hz": band_hz}
        order = replace(settings, **full, controller_hash=controller.content_hash)
        self.rig.order(orders.MeasureOrder(controller, order))
        set_here = {name: getattr(settings, name) for name in _OPTIONS}
        usual = {name: getattr(MeasurementOptions, name) for name in _OPTIONS} | {"rig": "simulated", "seed": 0}
        usual["mains_hz"] = controller.display.mains_hz(None, MeasurementOptions.mains_hz)
        options = {**set_here, "rig": self.rig.spec, "seed": self.rig.seed}
        command = command_line(
            "measure",
            controller="controller.json",
            channel=[] if set(channels) == set(self.channels) else channels,
            frequency_hz=",".join(f"{hertz:g}" for hertz in settings.frequency_hz) or None,
            **{name: value for name, value in options.items() if value != usual[name]},
            out="response.csv",
        )
        return {"command": command}


def expected_hum(controller: Controller, channel: Channel) -> dict[str, Any]:
    """Return the frequencies of the mains hum that the display file describes, and their level (dB SL) as the
    controller's loop moves the finger with it; none for a channel without a loop.
    """
    loop, lines = ChannelPrediction.of(controller, channel.name).loop, np.array(channel.environment.hum_hz)
    lines = lines if loop.feedback is not None else lines[:0]
    level = felt_db_sl(channel, felt_hum_v(channel, loop), lines) if lines.size else lines
    return {"frequency_hz": lines.tolist(), "level_db_sl": level.tolist()}


def expected_curves(controller: Controller, level_db_sl: float, frequency_hz: FloatArray) -> list[dict[str, Any]]:
    """Return the level (dB SL) that the controller's model expects at each frequency, for every channel, without load
    and under each load.
    """
    curves = []
    for channel in controller.display.channels:
        threshold_v = channel.threshold_voltage(frequency_hz)
        strength = controller.channel(channel.name).strength
        if strength is not None:
            threshold_v = threshold_v / np.abs(strength.response(level_db_sl, frequency_hz, controller.rate_hz))
        for load in (None, *(load.name for load in channel.loads)):
            there = ChannelPrediction.of(controller, channel.name, load).loop.position_response(frequency_hz)
            level = level_db_sl + db(np.abs(there) / threshold_v)
            curves.append({"channel": channel.name, "load": load or "none", "level_db_sl": level.tolist()})
    return curves
