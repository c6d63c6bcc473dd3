"""Orders to the rig, made from the requests of pages: controllers, waves, measurements, and records to keep."""

from __future__ import annotations

import asyncio
import io
from concurrent.futures import Executor
from typing import Any

import numpy as np

from tactuator.console.held_rig import orders
from tactuator.console.held_rig.generator import MOST_DB_SL, GeneratorWave
from tactuator.console.held_rig.measuring import expected_curves
from tactuator.console.scope import messages
from tactuator.console.scope.host import RigHost
from tactuator.console.scope.samples import SIGNALS
from tactuator.console.shaping.factors import shape_of
from tactuator.console.workshop import FILE, Workshop
from tactuator.errors import BadInput
from tactuator.io.controller import read_controller
from tactuator.measure.frequencies import over_the_band
from tactuator.measure.options import MeasurementOptions
from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.synthesis.design import design_controller

_CURVE_POINTS = 120


class Desk:
    """Orders to one rig, whichever page they come from. workshop: where the loops of the page are made."""

    def __init__(self, host: RigHost, workshop: Workshop) -> None:
        self._host, self._workshop = host, workshop
        self._controller: Controller | None = None

    @property
    def channels(self) -> tuple[str, ...]:
        """Return the names of the channels."""
        return tuple(channel.name for channel in self._host.display.channels)

    def about(self) -> dict[str, Any]:
        """Return what a page has to know of the rig, its display and the controller that is loaded."""
        display = self._host.display
        return {
            "rig": self._host.spec,
            "display": display.name,
            "rate_hz": display.rate_hz,
            "channels": [
                {
                    "name": one.name,
                    "loads": [load.name for load in one.loads],
                    "band_hz": list(one.threshold.band_hz),
                    "range_v": one.converter.range_v,
                    "loop": one.feedback.structure != "none",
                }
                for one in display.channels
            ],
            "signals": SIGNALS,
            "most_db_sl": MOST_DB_SL,
            "frequency_hz": self._host.levels.frequency_hz.tolist(),
        }

    def levels(self) -> dict[str, Any] | None:
        """Return the levels of the last second, channel by channel, rounded to what is shown."""
        felt = self._host.felt()
        if felt is None:
            return None
        return {
            "spectrum_db_sl": [np.round(one.spectrum_db_sl, 1).tolist() for one in felt],
            "level_db_sl": [round(one.level_db_sl, 2) for one in felt],
            "tone_db_sl": [None if one.tone_db_sl is None else round(one.tone_db_sl, 2) for one in felt],
            "command_mean_v": [round(one.command_mean_v, 4) for one in felt],
        }

    def ordered(self, request: messages.Request) -> dict[str, Any]:
        """Give the rig the order that a request asks for, and return the answer. Raises BadInput where it cannot be."""
        match request:
            case messages.Simple(do="live"):
                self._host.order(orders.LiveOrder())
            case messages.Simple(do="stop"):
                self._host.order(orders.GenerateOrder(None))
            case messages.Simple(do="rest"):
                self._host.order(orders.RestOrder())
            case messages.Simple(do="reopen"):
                self._host.order(orders.ReopenOrder())
            case messages.Play():
                self._host.order(orders.GenerateOrder(self._wave(request)))
            case messages.TouchFinger():
                if request.load is not None:
                    self._display.channel(request.channel).load(request.load)
                self._host.order(orders.TouchOrder(self._display.channel(request.channel).name, request.load))
            case messages.PressFinger():
                self._host.order(orders.PressOrder(self._display.channel(request.channel).name, request.force_v))
            case messages.MeasureResponse():
                return self._measure(request)
        return {}

    async def use_controller(self, request: messages.UseController, apart: Executor | None) -> dict[str, Any]:
        """Load the controller that is asked for."""
        if request.source == "file":
            made = await asyncio.to_thread(read_controller, self._workshop.drawer.path(request.file))
        elif request.source == "loops":
            shapes = {name: shape_of(one) for name, one in request.shapes.items()}
            made = await asyncio.to_thread(self._workshop.controller, FILE, shapes)
        else:
            made = await asyncio.get_running_loop().run_in_executor(apart, design_controller, self._display)
        made.require_runs(self._display)
        self._controller = made
        self._host.order(orders.LoadOrder(made))
        return {"hash": made.content_hash}

    def expected(self, level_db_sl: float) -> dict[str, Any]:
        """Return the levels that the controller's model expects over the bands of the channels."""
        low = min(channel.threshold.band_hz[0] for channel in self._display.channels)
        high = max(channel.threshold.band_hz[1] for channel in self._display.channels)
        frequency_hz = np.geomspace(low, high, _CURVE_POINTS)
        curves = expected_curves(self.loaded_controller(), level_db_sl, frequency_hz)
        return {"frequency_hz": frequency_hz.tolist(), "curves": curves}

    def record(self, request: messages.Save) -> dict[str, Any]:
        """Return the samples of a channel as the text of a record, which `identify` reads."""
        column = self.channels.index(self._display.channel(request.channel).name)
        rate_hz = self._display.rate_hz
        start = max(0, request.end - round(request.span_s * rate_hz))
        rows = self._host.samples.rows(start, request.end)
        if not len(rows):
            raise BadInput("those samples are not kept any more", "the last 60 s")
        held = rows[:, [len(self.channels) * k + column for k in range(len(SIGNALS))]].astype(np.float64)
        time_s = np.arange(len(rows)) / rate_hz
        written = io.StringIO()
        np.savetxt(written, np.column_stack((time_s, held)), "%.9g", ",", header=_HEADER, comments="")
        return {"text": written.getvalue(), "samples": len(rows), "name": f"{request.channel}.csv"}

    def loaded_controller(self) -> Controller:
        """Return the controller that is loaded. Raises BadInput while there is none."""
        if self._controller is None or not self._host.standing.loaded:
            raise BadInput("no controller is loaded", "load one first")
        return self._controller

    @property
    def _display(self) -> Display:
        return self._host.display

    def _wave(self, request: messages.Play) -> GeneratorWave:
        path = str(self._workshop.drawer.path(request.file)) if request.kind == "file" else ""
        return GeneratorWave(
            request.kind, request.level_db_sl, tuple(request.channels), request.frequency_hz, request.to_hz,
            request.sweep_s, path,
        )  # fmt: skip

    def _measure(self, request: messages.MeasureResponse) -> dict[str, Any]:
        bands = [self._display.channel(name).threshold.band_hz for name in request.channels]
        band_hz = (max(low for low, _ in bands), min(high for _, high in bands))
        wanted = tuple(request.frequency_hz) or tuple(over_the_band(band_hz, request.mains_hz))
        order = orders.MeasureOrder(
            self.loaded_controller(), tuple(request.channels), wanted, request.level_db_sl, request.load,
            request.confidence_db, request.longest_s, request.mains_hz, band_hz,
        )  # fmt: skip
        self._host.points = None
        self._host.order(order)
        return {"command": self._command(request)}

    def _command(self, request: messages.MeasureResponse) -> str:
        """Return the command line that measures the same."""
        words = ["tactuator measure --controller controller.json"]
        if set(request.channels) != set(self.channels):
            words += [f"--channel {name}" for name in request.channels]
        if request.frequency_hz:
            words.append("--frequency-hz " + ",".join(f"{one:g}" for one in request.frequency_hz))
        for option, value, usual in (
            ("level-db-sl", request.level_db_sl, MeasurementOptions.level_db_sl),
            ("load", request.load, MeasurementOptions.load),
            ("confidence-db", request.confidence_db, MeasurementOptions.confidence_db),
            ("longest-s", request.longest_s, MeasurementOptions.longest_s),
            ("mains-hz", request.mains_hz, MeasurementOptions.mains_hz),
            ("rig", self._host.spec, "simulated"), ("seed", self._host.seed, 0),
        ):  # fmt: skip
            if value != usual:
                words.append(f"--{option} {value if isinstance(value, str) else format(value, 'g')}")
        return " ".join([*words, "--out response.csv"])


_HEADER = "time_s,reference,command_v,position_v"
