"""The rig as the pages use it: which page has the controls, and the controller that is loaded."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.console.generator import MOST_DB_SL
from tactuator.console.levels import Levels
from tactuator.console.requests import Answer
from tactuator.console.rig_process import RigProcess
from tactuator.console.scope import SIGNALS
from tactuator.console.state import ConsoleState
from tactuator.errors import BadInput
from tactuator.measure.error import ChannelPrediction
from tactuator.measure.options import MeasurementOptions
from tactuator.model.controller import Controller
from tactuator.model.description import Channel
from tactuator.perception.curve import AMPLITUDE_JND_DB
from tactuator.plain import picked
from tactuator.signals.decibels import db
from tactuator.synthesis.felt import felt_db_sl, felt_hum_v

_CURVE_POINTS = 120


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
        """Give the rig to an experiment until `free`; stop: ends what it plays, whichever page asks. Raises BadInput
        where a page has the controls, or another experiment.
        """
        if self.reserved is not None:
            raise BadInput("an experiment has the rig: end that one first")
        if self.holder is not None:
            raise BadInput("another page has the controls of the rig: take them over, and begin then")
        self.reserved = stop
        self.tell_all()

    def free(self) -> None:
        """End the experiment's hold on the rig; the controls are then free to take."""
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
            raise BadInput("this page watches: take over the controls first")

    def _require_no_experiment(self) -> None:
        if self.reserved is not None:
            raise BadInput("an experiment has the rig", "watching, stopping it, or ending it in its view")

    def tell_all(self) -> None:
        """Send every page the rig's status."""
        for page in self._pages:
            page.news.set()

    def tell_refusal(self, text: str) -> None:
        """Send the page that has the controls what the rig refused."""
        if self.holder is not None:
            self.holder.refusals.append(text)
            self.holder.news.set()


class RigSession:
    """Use of one rig by the pages of a console, whichever page it is. state: where the loops of the page are made."""

    def __init__(self, rig: RigProcess, state: ConsoleState) -> None:
        self.rig, self.display, self.state = rig, rig.display, state
        self.controls, self.uploads = Controls(), state.uploads
        self.channels = tuple(channel.name for channel in rig.display.channels)
        self._controller: Controller | None = None
        self.named = {"name": "", "curve": ""}
        self.measurement: dict[str, Any] = {"number": 0}

    def listen(self) -> None:
        """Pass what the rig's process reports, on another thread, on to the pages of this loop."""
        loop = asyncio.get_running_loop()

        def on_loop(function: Any, *arguments: Any) -> None:
            with suppress(RuntimeError):  # the server has ended, and with it the loop
                loop.call_soon_threadsafe(function, *arguments)

        self.rig.changed = lambda: on_loop(self.controls.tell_all)
        self.rig.refused = lambda text: on_loop(self.controls.tell_refusal, text)

    def about(self) -> dict[str, Any]:
        """Return what a page has to know of the rig and its display."""
        display = self.display
        return {
            "rig": self.rig.spec,
            **picked(display, "rate_hz", display="name"),
            "channels": [
                picked(channel, "name", band_hz="threshold.band_hz", range_v="converter.range_v")
                | {"loads": [load.name for load in channel.loads], "loop": channel.feedback.structure != "none"}
                for channel in display.channels
            ],
            "controller": self.named,
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

    def load(self, controller: Controller, name: str) -> None:
        """Load a controller. Raises BadInput where it does not run on the rig's display."""
        controller.require_runs(self.display)
        curves = dict.fromkeys(channel.threshold.curve.name for channel in controller.display.channels)
        self.named = {"name": f"{name} ({controller.content_hash[:4]})", "curve": ", ".join(curves)}
        self._controller, self.rig.levels = controller, Levels(controller.display)
        self.rig.call("load", controller)

    def end(self, name: str, *arguments: object) -> None:
        """Call what ends something on the rig; an experiment that has the rig is stopped instead."""
        if self.controls.reserved is None:
            self.rig.call(name, *arguments)
        else:
            self.controls.reserved()

    def loaded_controller(self) -> Controller:
        """Return the loaded controller. Raises BadInput without one."""
        if self._controller is None or not self.rig.status.loaded:
            raise BadInput("no controller is loaded; load one first")
        return self._controller

    def expected(self, level_db_sl: float) -> Answer:
        """Return the levels that the loaded controller's model expects, over frequency."""
        low = min(channel.threshold.band_hz[0] for channel in self.display.channels)
        high = max(channel.threshold.band_hz[1] for channel in self.display.channels)
        frequency_hz = np.geomspace(low, high, _CURVE_POINTS)
        controller = self.loaded_controller()
        asked = {"asked_db_sl": level_db_sl, "jnd_db": AMPLITUDE_JND_DB, "frequency_hz": frequency_hz.tolist()}
        hum = {channel.name: expected_hum(controller, channel) for channel in controller.display.channels}
        return asked | {"curves": expected_curves(controller, level_db_sl, frequency_hz), "hum": hum}


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
