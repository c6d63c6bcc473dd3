"""The process that holds the rig: it obeys calls, sends every sample, and leaves the rig at rest however it ends."""

from __future__ import annotations

import itertools
import os
import queue
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.console.generator import Generator, GeneratorWave
from tactuator.console.rig_calls import ListenSettings, MeasureSettings, Mode, Points, Presented, RigStatus
from tactuator.errors import BadInput, DeviceFault, TactuatorError, TimingMissed
from tactuator.measure.error import as_read
from tactuator.measure.response import stepped_sine
from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.open import open_rig
from tactuator.rig.rig import Rig, Trace, touch_all
from tactuator.rig.simulated import PacedRig
from tactuator.rig.sound.rig import SoundRig
from tactuator.rig.sound.stream import CardGone
from tactuator.rig.transport import LinkDown
from tactuator.signals.record import Response
from tactuator.speech.coding import coding_of
from tactuator.speech.live.level import LevelSettings
from tactuator.speech.live.meter import LiveMeter
from tactuator.speech.live.run import fed_shortly, prompt, run_live
from tactuator.speech.live.source import FileSource, Microphone, Source
from tactuator.speech.live.stream import LiveStream

Call = tuple[int, str, tuple[Any, ...]]
"""Number, name of a method of RigWorker, and its arguments."""
WAITING_MAX = 1000
"""Calls that may wait, while a measurement goes on for instance; a page makes less than a hundred a second."""
BLOCK_S = 0.02
"""Length of the generator's blocks: an order waits at most that long for the next one."""
_GUARD_S = 0.5
_PATIENCE_S = 5.0
"""Time for the rig to come to rest after the server has gone; then the process ends without it."""
_LAST_S = 1.0
SWITCH_S = 0.001
"""Longest time for which what computes keeps a call from being taken: a stop is one."""
_WHILE_LIVE = ("generate", "mute", "touch", "press")
"""Calls that are served while samples flow."""


def hold_rig(pipe: Connection, spec: str, display: Display, seed: int) -> None:
    """Hold the rig of that name with `display`, and obey the calls that come through the pipe until it ends."""
    sys.setswitchinterval(SWITCH_S)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the server, which then ends the pipe
    sender = Sender(pipe)
    worker = RigWorker(spec, display, seed, sender.tell)
    signal.signal(signal.SIGTERM, lambda number, frame: worker.call("quit"))
    threading.Thread(target=_reader, args=(pipe, worker), daemon=True).start()
    worker.run()
    sender.close()


def _reader(pipe: Connection, worker: RigWorker) -> None:
    with prompt(), suppress(OSError, EOFError):
        while True:
            name, arguments = pipe.recv()
            worker.call(name, *arguments)
    worker.call("quit")
    threading.Timer(_PATIENCE_S, os._exit, args=(1,)).start()


class RigWorker:
    """Holder of the rig, whose public methods are called one after another. `live` and `listen` go on until a call that
    cannot be served meanwhile; a measurement or a presentation ends by `rest` and `quit` alone.

    tell: calls a method of RigProcess by name; it must not wait.
    """

    def __init__(self, spec: str, display: Display, seed: int, tell: Callable[..., None]) -> None:
        self._spec, self._display, self._seed, self._tell = spec, display, seed, tell
        self._calls: queue.SimpleQueue[Call] = queue.SimpleQueue()
        self._numbers = itertools.count(1)
        self._obeyed = self._ending = self._looked = 0
        """Numbers of the call that is being obeyed, and of the newest one that ends all before it; and the row at which
        the guard was last looked at."""
        self._generator = Generator(display, np.random.default_rng(seed))
        self._status = RigStatus(press_v={channel.name: 0.0 for channel in display.channels})
        self._rig: Rig | None = None
        self._opened: Rig | None = None
        self._controller: Controller | None = None
        self._stream: LiveStream | None = None
        self._after: Call | None = None

    def call(self, name: str, *arguments: Any) -> None:
        """Take a call of a method, from any thread. Where many wait another is refused, unless it ends something or an
        experiment waits for it.
        """
        number = next(self._numbers)
        if name in ("rest", "quit"):
            self._ending = number
        elif self._calls.qsize() >= WAITING_MAX and name != "present" and (name, arguments) != ("generate", (None,)):
            refusal = BadInput(f"{WAITING_MAX} orders wait for the rig", "another once they are done")
            self._tell("take_refusal", str(refusal))
            return
        self._calls.put((number, name, arguments))

    def run(self) -> None:
        """Open the rig and obey until the call to quit; then leave the rig at rest."""
        self._guarded(self._open)
        try:
            while True:
                self._obeyed, name, arguments = self._after or self._calls.get()
                self._after = None
                if name == "quit":
                    return
                self._guarded(partial(getattr(self, name), *arguments))
        finally:
            self._let_go()

    def _watched(self, traces: Iterable[Trace]) -> Iterator[Trace]:
        """Yield traces as they come. Raises RigHalted as soon as a later call ends the one that is being obeyed, before
        anything begins as well.
        """
        source = iter(traces)
        while self._obeyed > self._ending:
            trace = next(source, None)
            if trace is None:
                return
            yield trace
        raise RigHalted

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
                self.call("quit")
        except Exception as error:
            self._rest()
            self._end_as("fault", _words(error))

    def _end_as(self, mode: Mode, fault: str = "") -> None:
        self._say(mode=mode, fault=fault, guard=self._guard() if mode in ("idle", "fault") else {})

    def reopen(self) -> None:
        """Open the rig anew after it has gone."""
        self._let_go()
        self._open()

    def rest(self, number: int | None = None) -> None:
        """End what goes on, and bring the rig to rest; the end is reported with the number, if one is given."""
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
        """Play the generator and send every sample, until another call."""
        rig, _ = self._loaded_rig()
        self._say(mode="live", fault="")
        self._allow_gaps(True)
        try:
            for trace in rig.stream(self._blocks()):
                self._tell_flowing(trace)
            self._rest()
            self._end_as("idle")
        finally:
            self._allow_gaps(False)
            self._generator = Generator(self._display, np.random.default_rng(self._seed))
            self._say(wave=None)

    def listen(self, settings: ListenSettings) -> None:
        """Let fingers feel sound as it comes, until it ends or another call."""
        rig, controller = self._loaded_rig()
        assert self._opened is not None
        source: Source | None = None
        try:
            source = FileSource(settings.file) if settings.file else Microphone(settings.microphone or None)
            with closing(source), fed_shortly(self._opened):
                level = LevelSettings(settings.level_db_sl)
                self._stream = LiveStream(source, controller, coding_of(settings.coding), level, time.monotonic)
                meter = LiveMeter(self._stream, self._opened)
                self._say(mode="listening", fault="")
                run_live(self._stream, rig, source, partial(self._listened, meter))
        except RigHalted:
            pass
        except DeviceFault as error:
            if source is not None and error is not getattr(source, "fault", None):
                raise
            self._tell("take_refusal", str(error))  # the microphone's: the rig is there
        finally:
            self._stream = None
        self._end_as("idle")

    def _listened(self, meter: LiveMeter, trace: Trace) -> None:
        if self._obeyed <= self._ending:
            raise RigHalted
        self._tell_flowing(trace)
        for block in meter.push(trace):
            self._tell("take_heard", block)
        self._take_calls()

    def _loaded_rig(self) -> tuple[Rig, Controller]:
        """Return the rig and its controller, which is loaded again after a fault. Raises BadInput without one."""
        if self._rig is None:
            raise BadInput("the rig has gone: open it again")
        if not self._status.loaded or self._controller is None:
            raise BadInput("no controller is loaded: load one before playing a reference")
        self._load_again()
        return self._rig, self._controller

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
            try:
                call = self._calls.get_nowait()
            except queue.Empty:
                return
            _, name, arguments = call
            if name in _WHILE_LIVE:
                try:
                    getattr(self, name)(*arguments)
                except BadInput as error:
                    self._tell("take_refusal", str(error))
            elif name != "live" or self._stream is not None:
                self._after = call
                self.generate(None)

    def generate(self, wave: GeneratorWave | None) -> None:
        """Play that from now on (None: silence)."""
        if self._status.mode != "live" and wave is not None:
            raise BadInput("the rig is not live: start it before the generator")
        if self._stream is not None:
            self._stream.stop()
        self._generator.ask(wave)
        self._say(wave=wave)

    def mute(self, muted: bool) -> None:
        """Let live sound go on unfelt, or be felt again."""
        if self._stream is not None:
            self._stream.muted = muted

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

    def _tell_flowing(self, trace: Trace) -> None:
        """Send samples, and every half second the guard's status."""
        self._tell_samples(trace)
        if self._status.given_back - self._looked >= _GUARD_S * self._display.rate_hz:
            self._looked = self._status.given_back
            self._say(guard=self._guard())

    def _tell_samples(self, trace: Trace) -> None:
        if not len(trace):
            return
        rows = np.concatenate((trace.reference, trace.command_v, trace.position_v), axis=1).astype(np.float32)
        limited = int(trace.saturated.any(axis=1).sum())
        self._tell("take_samples", self._status.given_back, rows.tobytes(), limited)
        self._status = replace(self._status, given_back=self._status.given_back + len(rows))

    def present(self, number: int, blocks: tuple[FloatArray, ...]) -> None:
        """Play blocks of reference (n, channels), threshold units, as one stream, for an experiment.

        Each trace is reported with the rig's own count of rows, and the end in every case, with the reason where it was
        not the last row: that the rig was halted, or its fault.
        """
        if self._rig is None:
            fault = str(DeviceFault("the rig has gone: open it again"))
            self._tell("take_presented", Presented(number, over=True, fault=fault))
            return
        self._load_again()
        self._say(mode="presenting", fault="")
        rig = self._rig

        def report(trace: Trace | None = None, **end: Any) -> None:
            played = None if rig.began_at is None else rig.rows_played
            self._tell("take_presented", Presented(number, trace, rig.began_at, played, **end))

        try:
            for trace in self._watched(rig.stream(blocks)):
                report(trace)
                self._tell_samples(trace)
        except RigHalted:
            self._rest()
            report(over=True, halted=True)
        except Exception as error:
            report(over=True, fault=_words(error), missed=isinstance(error, TimingMissed))
            raise
        else:
            report(over=True)
        self._end_as("idle")

    def measure(self, controller: Controller, settings: MeasureSettings) -> None:
        """Measure the response, as `measure response` does, at the rig opened anew; send it point by point."""
        self.reopen()
        assert self._opened is not None
        self._say(mode="measuring", fault="")
        measured_so_far: tuple[Response, ...] = ()
        try:
            touch_all(self._opened, self._display.channels, settings.load)
            self.load(controller)
            self._say(mode="measuring")

            def report(responses: tuple[Response, ...], over: bool = False) -> None:
                nonlocal measured_so_far
                measured_so_far = responses
                read = tuple(as_read(each, controller, settings.confidence_db) for each in responses)
                self._tell("take_points", Points.of(read, controller, settings, over))

            stepped_sine(self._opened, np.array(settings.frequency_hz), settings, so_far=report, watch=self._watched)
            report(measured_so_far, over=True)
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
    """Sends through `pipe` in a separate thread: a slow server holds nothing up, and no sample is dropped."""

    def __init__(self, pipe: Connection) -> None:
        self._waiting: queue.SimpleQueue[tuple[str, tuple[Any, ...]] | None] = queue.SimpleQueue()
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
        with prompt(), suppress(OSError):
            while (call := self._waiting.get()) is not None:
                self._pipe.send(call)


def _words(error: Exception) -> str:
    return str(error) if isinstance(error, TactuatorError) else f"{type(error).__name__}: {error}"


class RigHalted(Exception):
    """Raised where what goes on at the rig is to stop."""
