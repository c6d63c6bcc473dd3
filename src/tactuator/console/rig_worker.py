"""The process that holds the rig: it obeys calls, sends every sample, and leaves the rig at rest however it ends."""

from __future__ import annotations

import os
import queue
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.console.generator import Generator, GeneratorWave
from tactuator.console.rig_calls import (
    QUIT,
    Call,
    MeasureSettings,
    Mode,
    Points,
    Presented,
    RigStatus,
    WaitingCalls,
)
from tactuator.errors import BadInput, DeviceFault, TactuatorError, TimingMissed
from tactuator.io.response import write_responses
from tactuator.measure.error import ResponseLevels, as_read
from tactuator.measure.response import stepped_sine
from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.plain import picked
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.open import open_rig
from tactuator.rig.rig import Rig, Trace, touch_all
from tactuator.rig.simulated import PacedRig
from tactuator.rig.sound.rig import SoundRig
from tactuator.rig.sound.stream import CardGone
from tactuator.rig.transport import LinkDown
from tactuator.signals.record import Response
from tactuator.synthesis.felt import felt_db_sl

BLOCK_S = 0.02
"""Length of the generator's blocks: an order waits at most that long for the next one."""
_GUARD_S = 0.5
_PATIENCE_S = 5.0
"""Time for the rig to come to rest after the server has gone; then the process ends without it."""
_LAST_S = 1.0
_WHILE_LIVE = ("generate", "touch", "press")
"""Calls that are served while samples flow."""
_ERRORS = ("error_db", "error_jnd", "model_db", "unpredicted_db")


def hold_rig(pipe: Connection, spec: str, display: Display, seed: int) -> None:
    """Hold the rig of that name with `display`, and obey the calls that come through the pipe until it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the server, which then ends the pipe
    sender = Sender(pipe)
    worker = RigWorker(spec, display, seed, sender.tell)
    signal.signal(signal.SIGTERM, lambda number, frame: worker.call("quit"))
    threading.Thread(target=_reader, args=(pipe, worker), daemon=True).start()
    worker.run()
    sender.close()


def _reader(pipe: Connection, worker: RigWorker) -> None:
    with suppress(OSError, EOFError):
        while True:
            name, arguments = pipe.recv()
            worker.call(name, *arguments)
    worker.call("quit")
    threading.Timer(_PATIENCE_S, os._exit, args=(1,)).start()


class RigWorker:
    """Holder of the rig, whose public methods are called one after another; what goes on is ended by the next call that
    cannot be served meanwhile.

    tell: calls a method of RigProcess by name; it must not wait.
    """

    def __init__(self, spec: str, display: Display, seed: int, tell: Callable[..., None]) -> None:
        self._spec, self._display, self._seed, self._tell = spec, display, seed, tell
        self._calls = WaitingCalls()
        self._halt = threading.Event()
        self._generator = Generator(display, np.random.default_rng(seed))
        self._status = RigStatus(press_v={channel.name: 0.0 for channel in display.channels})
        self._rig: Rig | None = None
        self._opened: Rig | None = None
        self._controller: Controller | None = None
        self._after: Call | None = None

    def call(self, name: str, *arguments: Any) -> None:
        """Take a call of a method, from any thread; what ends a measurement ends it at once."""
        if name in ("rest", "quit"):
            self._halt.set()
        if warning := self._calls.put((name, arguments)):
            self._tell("take_refusal", warning)

    def run(self) -> None:
        """Open the rig and obey until the call to quit; then leave the rig at rest."""
        self._guarded(self._open)
        try:
            while (call := self._after or self._calls.get()) != QUIT:
                self._after = None
                self._obey(call)
        finally:
            self._let_go()

    def _obey(self, call: Call) -> None:
        name, arguments = call
        self._guarded(partial(getattr(self, name), *arguments))

    def _guarded(self, job: Callable[[], None]) -> None:
        try:
            job()
        except BadInput as error:
            if self._rig is None:
                self._say(mode="gone", fault=str(error), guard={}, refused=True)
            else:
                self._rest()
                self._end_as("idle")
            self._tell("take_refusal", str(error))
        except (LinkDown, CardGone) as error:
            self._let_go()
            self._end_as("gone", str(error))
            if isinstance(error, CardGone):  # PortAudio finds a card again in another process alone
                self._calls.put(QUIT)
        except TactuatorError as error:
            self._rest()
            self._end_as("fault", str(error))
        except Exception as error:
            self._rest()
            self._end_as("fault", f"{type(error).__name__}: {error}")

    def _end_as(self, mode: Mode, fault: str = "") -> None:
        self._say(mode=mode, fault=fault, guard=self._guard() if mode in ("idle", "fault") else {})

    def reopen(self) -> None:
        """Open the rig anew after it has gone."""
        self._let_go()
        self._open()

    def rest(self, number: int | None = None) -> None:
        """End what goes on, and bring the rig to rest; the end is reported with the number, if one is given."""
        self._halt.clear()
        self._rest()
        if self._rig is not None:
            self._end_as("idle")
        if number is not None:
            self._tell("take_presented", Presented(number, over=True))

    def _open(self) -> None:
        """Open the rig, if it is not open; simulated ones take their own time."""
        if self._rig is not None:
            return
        opened = open_rig(self._spec, self._display, self._seed)
        touchable = opened.has_finger_ports
        self._rig = PacedRig(opened) if touchable else opened
        self._opened = opened
        nothing: dict[str, str | None] = dict.fromkeys(opened.channels) if touchable else {}
        self._say(mode="idle", fault="", loaded="", touchable=touchable, touch=nothing, guard=self._guard())

    def load(self, controller: Controller) -> None:
        """Make a controller the one that runs."""
        self._open()
        assert self._rig is not None
        self._rig.load(controller)
        self._controller = controller
        self._end_as("idle")
        self._say(loaded=controller.content_hash)

    def live(self) -> None:
        """Play the generator and tell every sample, until something else is called for."""
        if self._rig is None:
            raise BadInput("the rig has gone", "open it again")
        if not self._status.loaded:
            raise BadInput("no controller is loaded", "load one before playing a reference")
        self._load_again()
        self._halt.clear()
        self._say(mode="live", fault="")
        looked = self._status.given_back
        self._allow_gaps(True)
        try:
            for trace in self._rig.stream(self._blocks()):
                self._tell_samples(trace)
                if self._status.given_back - looked >= _GUARD_S * self._display.rate_hz:
                    looked = self._status.given_back
                    self._say(guard=self._guard())
            self._rest()
            self._end_as("idle")
        finally:
            self._allow_gaps(False)
            self._generator = Generator(self._display, np.random.default_rng(self._seed))
            self._say(wave=None)

    def _allow_gaps(self, allowed: bool) -> None:
        """Let the scope go on over a sound card's gaps, which are counted and reported; nothing else may."""
        if isinstance(self._opened, SoundRig):
            self._opened.allow_gaps = allowed

    def _blocks(self) -> Iterator[FloatArray]:
        """Yield what the generator plays, the fingers pressed, until it is silent and something else is called for."""
        count = max(1, round(BLOCK_S * self._display.rate_hz))
        while True:
            self._take_calls()
            if self._after is not None and self._generator.silent:
                return
            for name, force_v in self._status.press_v.items():
                if force_v and isinstance(self._rig, PacedRig):
                    self._rig.finger(name).press(np.full(count, force_v))
            block = self._generator.block(count)
            if self._generator.wave is None and self._status.wave is not None:
                self._say(wave=None)  # a file is over
            self._status = replace(self._status, fed=self._status.fed + count)
            yield block

    def _take_calls(self) -> None:
        """Do what can be done while samples flow; anything else ends that, once the generator is silent."""
        while self._after is None:
            if (call := self._calls.get_nowait()) is None:
                return
            name, arguments = call
            if name in _WHILE_LIVE:
                try:
                    getattr(self, name)(*arguments)
                except BadInput as error:
                    self._tell("take_refusal", str(error))
            elif name != "live":
                self._after = call
                self._generator.ask(None)

    def generate(self, wave: GeneratorWave | None) -> None:
        """Play that from now on (None: silence)."""
        if self._status.mode != "live" and wave is not None:
            raise BadInput("the rig is not live", "start it before the generator")
        self._generator.ask(wave)
        self._say(wave=wave)

    def touch(self, channel: str, load: str | None) -> None:
        """Put a load of the display file on a channel's simulated finger port; None takes it off."""
        self._finger(channel).touch(load)
        self._say(touch=self._status.touch | {channel: load})

    def press(self, channel: str, force_v: float) -> None:
        """Press on a channel's simulated finger port with a force, volts of command, from now on."""
        self._finger(channel)
        self._say(press_v=self._status.press_v | {channel: force_v})

    def _load_again(self) -> None:
        """Load the controller again after a fault."""
        if self._status.mode == "fault" and self._controller is not None:
            self.load(self._controller)

    def _finger(self, channel: str) -> Any:
        if not isinstance(self._rig, PacedRig):
            raise BadInput("this display is real: a finger goes onto it by hand", "a simulated display")
        return self._rig.finger(channel)

    def _tell_samples(self, trace: Trace) -> None:
        if not len(trace):
            return
        rows = np.concatenate((trace.reference, trace.command_v, trace.position_v), axis=1).astype(np.float32)
        limited = int(trace.saturated.any(axis=1).sum())
        self._tell("take_samples", self._status.given_back, rows.tobytes(), limited)
        self._status = replace(self._status, given_back=self._status.given_back + len(rows))

    def present(self, number: int, blocks: tuple[FloatArray, ...]) -> None:
        """Play blocks of reference (n, channels), threshold units, as one stream, for an experiment; a halt that was
        ordered before it began counts.
        """
        if self._rig is None:
            fault = str(DeviceFault("the rig has gone", "open it again"))
            self._tell("take_presented", Presented(number, over=True, fault=fault))
            return
        self._load_again()
        self._say(mode="presenting", fault="")
        tell = partial(self._tell, "take_presented")
        for trace in presented(self._rig, number, blocks, self._halt.is_set, tell):
            self._tell_samples(trace)
        self._end_as("idle")

    def measure(self, controller: Controller, settings: MeasureSettings) -> None:
        """Measure the response, as `measure` does, at the rig opened anew; tell it point by point."""
        self._halt.clear()
        self.reopen()
        assert self._opened is not None
        self._say(mode="measuring", fault="")
        measured_so_far: tuple[Response, ...] = ()
        try:
            touch_all(self._opened, self._display.channels, settings.load)
            self.load(controller)
            self._say(mode="measuring")
            with TemporaryDirectory() as folder:

                def tell(responses: tuple[Response, ...], over: bool = False) -> None:
                    nonlocal measured_so_far
                    measured_so_far = responses
                    read = tuple(as_read(each, controller, settings.confidence_db) for each in responses)
                    self._tell("take_points", points_of(read, controller, settings, Path(folder), over))

                watch = partial(watched, halted=self._halt.is_set)
                stepped_sine(self._opened, np.array(settings.frequency_hz), settings, so_far=tell, watch=watch)
                tell(measured_so_far, over=True)
        except RigHalted:
            self._rest()
        self._end_as("idle")

    def _guard(self) -> dict[str, Any]:
        if self._rig is None or not isinstance(self._opened, BoardRig):
            return {}
        status = self._opened.status()
        where = self._display.channels[status.fault_channel].name if status.fault else ""
        return {
            "mode": status.mode.name.lower(),
            "fault": status.fault.name.lower().replace("_", " ") if status.fault else "",
            "channel": where,
            "late": status.late,
        }

    def _rest(self) -> None:
        if self._rig is not None:
            with suppress(TactuatorError):
                self._rig.rest()

    def _let_go(self) -> None:
        opened, self._rig = self._rig, None
        if opened is not None:
            with suppress(TactuatorError):
                opened.close()

    def _say(self, **changed: Any) -> None:
        gaps = self._opened.gaps if self._rig is not None and isinstance(self._opened, SoundRig) else 0
        self._status = replace(self._status, gaps=gaps, **changed)
        self._tell("take_status", self._status)


class Sender:
    """Sends through `pipe` in a thread of its own: a slow server holds nothing up, and no sample is dropped."""

    def __init__(self, pipe: Connection) -> None:
        self._waiting: queue.SimpleQueue[Call | None] = queue.SimpleQueue()
        self._pipe = pipe
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def tell(self, name: str, *arguments: Any) -> None:
        """Call a method of the server's RigProcess, after all that came before; return at once."""
        self._waiting.put((name, arguments))

    def close(self) -> None:
        """Wait until everything is sent, a second at most."""
        self._waiting.put(None)
        self._thread.join(_LAST_S)

    def _work(self) -> None:
        with suppress(OSError):
            while (call := self._waiting.get()) is not None:
                self._pipe.send(call)


class RigHalted(Exception):
    """Raised where what goes on at the rig is to stop."""


def watched(traces: Iterable[Trace], halted: Callable[[], bool]) -> Iterator[Trace]:
    """Yield traces as they come. Raises RigHalted as soon as `halted` says so, before anything begins as well."""
    source = iter(traces)
    while not halted():
        trace = next(source, None)
        if trace is None:
            return
        yield trace
    raise RigHalted


def presented(
    rig: Rig,
    number: int,
    blocks: tuple[FloatArray, ...],
    halted: Callable[[], bool],
    tell: Callable[[Presented], None],
) -> Iterator[Trace]:
    """Play blocks as one stream, tell each trace with the rig's own count of rows, and yield it.

    The end is reported in every case, with the reason where it was not the last row: that the rig was halted, or its
    fault, which is then raised.
    """

    def say(trace: Trace | None, **end: Any) -> None:
        played = None if rig.began_at is None else rig.rows_played
        tell(Presented(number, trace, rig.began_at, played, **end))

    try:
        for trace in watched(rig.stream(blocks), halted):
            say(trace)
            yield trace
    except RigHalted:
        rig.rest()
        say(None, over=True, halted=True)
    except TactuatorError as error:
        say(None, over=True, fault=str(error), missed=isinstance(error, TimingMissed))
        raise
    except Exception as error:
        say(None, over=True, fault=f"{type(error).__name__}: {error}")
        raise
    else:
        say(None, over=True)


def points_of(
    responses: tuple[Response, ...], controller: Controller, settings: MeasureSettings, folder: Path, over: bool
) -> Points:
    """Return what a page shows of a measurement, and the file that `measure --out response.csv` would write of it."""
    path = folder / "response.csv"
    write_responses(path, responses)
    levels = [ResponseLevels.of(response, controller) for response in responses]
    channels = [controller.display.channel(response.channel) for response in responses]
    shown = [
        {
            **picked(response, "channel", "load", asked_db_sl="level_db_sl"),
            **{name: getattr(response, name).tolist() for name in ("frequency_hz", "saturated", "reached")},
            **{name: _finite(values) for name, values in picked(level, *_ERRORS, level_db_sl="felt_db_sl").items()},
            "worst_first": level.worst_first,
            "confidence_db": _finite(response.confidence_db),
            "noise_db_sl": _finite(felt_db_sl(channel, response.noise_v, response.frequency_hz)),
            "within": _within(response, level),
        }
        for response, level, channel in zip(responses, levels, channels, strict=True)
    ]
    done = len(responses[0].frequency_hz) if responses else 0
    return Points({"responses": shown}, done, len(settings.frequency_hz), path.read_text("utf-8"), over)


def _within(response: Response, levels: ResponseLevels) -> str:
    greatest, (low, high) = np.max(np.abs(levels.error_db)), np.sort(response.frequency_hz)[[0, -1]]
    return f"felt within {greatest:.2f} dB of {response.level_db_sl:g} dB SL from {low:.4g} to {high:.4g} Hz"


def _finite(values: FloatArray) -> list[float | None]:
    """Return numbers as JSON has them: None for a level of nothing (a sensor that stands still) or no confidence."""
    return [float(value) if np.isfinite(value) else None for value in values]
