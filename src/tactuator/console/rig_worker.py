"""The process that holds the rig: it obeys orders, tells every sample, and leaves the rig at rest however it ends."""

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
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray
from tactuator.console import rig_orders as orders
from tactuator.console.generator import Generator
from tactuator.console.rig_orders import WaitingOrders
from tactuator.errors import BadInput, DeviceFault, TactuatorError, TimingMissed
from tactuator.io.response import write_responses
from tactuator.measure.error import ResponseLevels, as_read
from tactuator.measure.response import stepped_sine
from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.open import open_rig
from tactuator.rig.rig import Rig, Trace, WrappedRig, touch_all
from tactuator.rig.simulated import PacedRig
from tactuator.rig.sound.rig import SoundRig
from tactuator.rig.sound.stream import CardGone
from tactuator.rig.transport import LinkDown
from tactuator.signals.record import Response
from tactuator.synthesis.felt import felt_db_sl
from tactuator.table import picked

BLOCK_S = 0.02
"""Length of the generator's blocks: an order waits at most that long for the next one."""
_GUARD_S = 0.5
_PATIENCE_S = 5.0
"""Time in which the rig has to be at rest after the end of whoever orders; then the process ends without it."""
_LAST_S = 1.0
_ERRORS = ("error_db", "error_jnd", "model_db", "unpredicted_db")


def hold_rig(pipe: Connection, spec: str, display: Display, seed: int) -> None:
    """Hold the rig of that name with `display`, and obey the orders that come through the pipe until it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the server, which then ends the pipe
    sender = Sender(pipe)
    worker = RigWorker(spec, display, seed, sender.tell)
    signal.signal(signal.SIGTERM, lambda number, frame: worker.order(orders.QuitOrder()))
    threading.Thread(target=_reader, args=(pipe, worker), daemon=True).start()
    worker.run()
    sender.close()


def _reader(pipe: Connection, worker: RigWorker) -> None:
    with suppress(OSError, EOFError):
        while True:
            worker.order(pipe.recv())
    worker.order(orders.QuitOrder())
    threading.Timer(_PATIENCE_S, os._exit, args=(1,)).start()


class RigWorker:
    """Obeys orders one after another; what goes on is ended by the next order that it does not serve.

    tell: called with everything that is to be told; it must not wait.
    """

    def __init__(self, spec: str, display: Display, seed: int, tell: Callable[[orders.News], None]) -> None:
        self._spec, self._display, self._seed, self._tell = spec, display, seed, tell
        self._orders = WaitingOrders()
        self._halt = threading.Event()
        self._generator = Generator(display, np.random.default_rng(seed))
        self._status = orders.RigStatus(press_v={channel.name: 0.0 for channel in display.channels})
        self._rig: Rig | None = None
        self._opened: Rig | None = None
        self._controller: Controller | None = None
        self._after: orders.Order | None = None

    def order(self, order: orders.Order) -> None:
        """Take an order, from any thread; what ends a measurement ends it at once."""
        if isinstance(order, orders.RestOrder | orders.QuitOrder):
            self._halt.set()
        if warning := self._orders.put(order):
            self._tell(orders.Refused(warning))

    def run(self) -> None:
        """Open the rig and obey until the order to quit; then leave the rig at rest."""
        self._guarded(self._open)
        order: orders.Order = orders.RestOrder()
        try:
            while not isinstance(order, orders.QuitOrder):
                order, self._after = self._after or self._orders.get(), None
                self._guarded(partial(self._obey, order))
        finally:
            self._let_go()

    def _guarded(self, job: Callable[[], None]) -> None:
        try:
            job()
        except BadInput as error:
            if self._rig is None:
                self._say(mode="gone", fault=str(error), guard={}, refused=True)
            else:
                self._rest()
                self._end_as("idle")
            self._tell(orders.Refused(str(error)))
        except (LinkDown, CardGone) as error:
            self._let_go()
            self._end_as("gone", str(error))
            if isinstance(error, CardGone):  # PortAudio finds a card again in another process alone
                self._orders.put(orders.QuitOrder())
        except TactuatorError as error:
            self._rest()
            self._end_as("fault", str(error))
        except Exception as error:
            self._rest()
            self._end_as("fault", f"{type(error).__name__}: {error}")

    def _end_as(self, mode: orders.Mode, fault: str = "") -> None:
        self._say(mode=mode, fault=fault, guard=self._guard() if mode in ("idle", "fault") else {})

    def _obey(self, order: orders.Order) -> None:
        match order:
            case orders.LoadOrder():
                self._open()
                self._load(order)
            case orders.LiveOrder():
                self._live()
            case orders.MeasureOrder():
                self._measure(order)
            case orders.RestOrder():
                self._halt.clear()
                self._rest()
                if self._rig is not None:
                    self._end_as("idle")
                if isinstance(order, orders.AwaitedRestOrder):
                    self._tell(orders.Presented(order.number, over=True))
            case orders.PresentOrder():
                self._present(order)
            case orders.ReopenOrder():
                self._let_go()
                self._open()
            case orders.QuitOrder():
                pass
            case _:
                self._serve(order)

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

    def _load(self, order: orders.LoadOrder) -> None:
        assert self._rig is not None
        self._rig.load(order.controller)
        self._controller = order.controller
        self._end_as("idle")
        self._say(loaded=order.controller.content_hash)

    def _live(self) -> None:
        if self._rig is None:
            raise BadInput("the rig has gone", "open it again")
        if not self._status.loaded:
            raise BadInput("no controller is loaded", "load one before playing a reference")
        if self._status.mode == "fault" and self._controller is not None:
            self._load(orders.LoadOrder(self._controller))
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
        """Let the scope go on over a sound card's gaps, which are counted and told; nothing else may."""
        if isinstance(self._opened, SoundRig):
            self._opened.allow_gaps = allowed

    def _blocks(self) -> Iterator[FloatArray]:
        """Yield what the generator plays, the fingers pressed, until it is silent and something else is ordered."""
        count = max(1, round(BLOCK_S * self._display.rate_hz))
        while True:
            self._take_orders()
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

    def _take_orders(self) -> None:
        """Do what can be done while samples flow; anything else ends that, once the generator is silent."""
        while self._after is None:
            if (order := self._orders.get_nowait()) is None:
                return
            if isinstance(order, orders.GenerateOrder | orders.TouchOrder | orders.PressOrder):
                try:
                    self._serve(order)
                except BadInput as error:
                    self._tell(orders.Refused(str(error)))
            elif not isinstance(order, orders.LiveOrder):
                self._after = order
                self._generator.ask(None)

    def _serve(self, order: orders.Order) -> None:
        match order:
            case orders.GenerateOrder():
                if self._status.mode != "live" and order.wave is not None:
                    raise BadInput("the rig is not live", "start it before the generator")
                self._generator.ask(order.wave)
                self._say(wave=order.wave)
            case orders.TouchOrder():
                self._finger(order.channel).touch(order.load)
                self._say(touch=self._status.touch | {order.channel: order.load})
            case orders.PressOrder():
                self._finger(order.channel)
                self._say(press_v=self._status.press_v | {order.channel: order.force_v})

    def _finger(self, channel: str) -> Any:
        if not isinstance(self._rig, PacedRig):
            raise BadInput("this display is real: a finger goes onto it by hand", "a simulated display")
        return self._rig.finger(channel)

    def _tell_samples(self, trace: Trace) -> None:
        if not len(trace):
            return
        rows = np.concatenate((trace.reference, trace.command_v, trace.position_v), axis=1).astype(np.float32)
        limited = int(trace.saturated.any(axis=1).sum())
        self._tell(orders.Piece(self._status.given_back, rows.tobytes(), limited))
        self._status = replace(self._status, given_back=self._status.given_back + len(rows))

    def _present(self, order: orders.PresentOrder) -> None:
        """Play what an experiment asks for; a halt that was ordered before it began counts."""
        if self._rig is None:
            self._tell(
                orders.Presented(order.number, over=True, fault=str(DeviceFault("the rig has gone", "open it again")))
            )
            return
        if self._status.mode == "fault" and self._controller is not None:
            self._load(orders.LoadOrder(self._controller))
        self._say(mode="presenting", fault="")
        for trace in presented(self._rig, order, self._halt.is_set, self._tell):
            self._tell_samples(trace)
        self._end_as("idle")

    def _measure(self, order: orders.MeasureOrder) -> None:
        """Measure at the rig opened anew, so that it is what the command would measure; tell it point by point."""
        self._halt.clear()
        self._let_go()
        self._open()
        assert self._opened is not None
        self._say(mode="measuring", fault="")
        measured_so_far: tuple[Response, ...] = ()
        try:
            touch_all(self._opened, self._display.channels, order.settings.load)
            self._load(orders.LoadOrder(order.controller))
            self._say(mode="measuring")
            with TemporaryDirectory() as folder:

                def tell(responses: tuple[Response, ...], over: bool = False) -> None:
                    nonlocal measured_so_far
                    measured_so_far = responses
                    read = tuple(as_read(each, order.controller, settings.confidence_db) for each in responses)
                    self._tell(points_of(read, order, Path(folder), over))

                watched, settings = WatchedRig(self._opened, self._halt.is_set), order.settings
                stepped_sine(watched, np.array(settings.frequency_hz), settings, so_far=tell)
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
        self._tell(self._status)


class Sender:
    """Sends through `pipe` in a thread of its own: a slow server holds nothing up, and no sample is dropped."""

    def __init__(self, pipe: Connection) -> None:
        self._waiting: queue.SimpleQueue[orders.News | None] = queue.SimpleQueue()
        self._pipe = pipe
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def tell(self, news: orders.News) -> None:
        """Send it after all that came before; return at once."""
        self._waiting.put(news)

    def close(self) -> None:
        """Wait until everything is sent, a second at most."""
        self._waiting.put(None)
        self._thread.join(_LAST_S)

    def _work(self) -> None:
        with suppress(OSError):
            while (news := self._waiting.get()) is not None:
                self._pipe.send(news)


class RigHalted(Exception):
    """Raised where what goes on at the rig is to stop."""


class WatchedRig(WrappedRig):
    """The given rig; `halted` is asked with every piece of a stream, and before anything begins."""

    def __init__(self, rig: Rig, halted: Callable[[], bool]) -> None:
        super().__init__(rig)
        self._halted = halted

    def play(self, reference: ArrayLike) -> Trace:
        """Play a block; a halt comes after it."""
        self._go_on()
        return self._rig.play(reference)

    def stream(self, blocks: Iterable[ArrayLike]) -> Iterator[Trace]:
        """Stream blocks. Raises RigHalted as soon as that is wanted."""
        self._go_on()
        for trace in self._rig.stream(blocks):
            self._go_on()
            yield trace

    def drive(self, command_v: ArrayLike) -> Trace:
        """Drive the motors; a halt comes after it."""
        self._go_on()
        return self._rig.drive(command_v)

    def _go_on(self) -> None:
        if self._halted():
            raise RigHalted


def presented(
    rig: Rig, order: orders.PresentOrder, halted: Callable[[], bool], tell: Callable[[orders.Presented], None]
) -> Iterator[Trace]:
    """Play the blocks of an order as one stream, tell each trace with the rig's own count of rows, and yield it.

    The end is told in every case, with the reason where it was not the last row: that the rig was halted, or its fault,
    which is then raised.
    """

    def say(trace: Trace | None, **end: Any) -> None:
        played = None if rig.began_at is None else rig.rows_played
        tell(orders.Presented(order.number, trace, rig.began_at, played, **end))

    try:
        for trace in WatchedRig(rig, halted).stream(order.blocks):
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


def points_of(responses: tuple[Response, ...], order: orders.MeasureOrder, folder: Path, over: bool) -> orders.Points:
    """Return what a page shows of a measurement, and the file that `measure --out response.csv` would write of it."""
    path = folder / "response.csv"
    write_responses(path, responses)
    levels = [ResponseLevels.of(response, order.controller) for response in responses]
    channels = [order.controller.display.channel(response.channel) for response in responses]
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
    return orders.Points({"responses": shown}, done, len(order.settings.frequency_hz), path.read_text("utf-8"), over)


def _within(response: Response, levels: ResponseLevels) -> str:
    greatest, (low, high) = np.max(np.abs(levels.error_db)), np.sort(response.frequency_hz)[[0, -1]]
    return f"felt within {greatest:.2f} dB of {response.level_db_sl:g} dB SL from {low:.4g} to {high:.4g} Hz"


def _finite(values: FloatArray) -> list[float | None]:
    """Return numbers as JSON has them: None for a level of nothing (a sensor that stands still) or no confidence."""
    return [float(value) if np.isfinite(value) else None for value in values]
