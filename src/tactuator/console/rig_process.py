"""The rig's process seen from the server: its orders, its newest samples and their levels, and its status."""

import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

import numpy as np
import scipy

from tactuator.arrays import FloatArray
from tactuator.console import rig_orders as orders
from tactuator.console.rig_worker import hold_rig
from tactuator.console.scope import KEPT_S, SIGNALS, Rows, ScopeSamples
from tactuator.errors import BadInput, DeviceFault
from tactuator.model.description import Channel, Display
from tactuator.signals.decibels import db

_ENDED = ("the process that holds the rig has ended", "open the rig again")
_END_S = 8.0
SECONDS = 1.0
"""Length of the window: the lines of its spectrum are 1 Hz apart, and a Hann window's are 1.5 Hz wide."""
_POINTS = 160
_HANN_POWER, _HANN_SUM = 0.375, 0.5
"""Mean square, and mean, of a Hann window."""
_FLOOR_DB_SL = -120.0


@dataclass(frozen=True, eq=False)
class ChannelLevel:
    """Levels of one channel over the last second. spectrum_db_sl: at Levels.frequency_hz, the greatest line of each
    stretch, as a sinusoid of that amplitude; level_db_sl: of the sinusoid with the power of all lines of the band, each
    weighted by the threshold curve; the hum and noise of the sensor itself are among them. tone_db_sl: of the tone that
    is played, if one is. command_mean_v: what the command holds against. peak_hz, peak_db_sl: of the strongest
    sinusoid, between the lines.
    """

    spectrum_db_sl: FloatArray
    level_db_sl: float
    tone_db_sl: float | None
    command_mean_v: float
    peak_hz: float
    peak_db_sl: float


class Levels:
    """Levels of a display's channels in dB SL, from the voltage of its sensors and its threshold curves."""

    def __init__(self, display: Display) -> None:
        self._length = round(SECONDS * display.rate_hz)
        lines = scipy.fft.rfftfreq(self._length, 1.0 / display.rate_hz)
        top = min(0.45 * display.rate_hz, max(2.0 * channel.threshold.band_hz[1] for channel in display.channels))
        edges = np.unique(np.round(np.geomspace(2.0, top, _POINTS + 1) * SECONDS).astype(int))
        self._edges = edges[:-1]
        self._last = int(edges[-1])
        self.frequency_hz: FloatArray = np.sqrt(lines[edges[:-1]] * lines[np.maximum(edges[1:] - 1, edges[:-1])])
        self._display = display
        self._channels = [_Weight.of(channel, lines) for channel in display.channels]
        self._window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(self._length) / self._length)

    def of(self, samples: ScopeSamples, tone_hz: float | None = None) -> list[ChannelLevel] | None:
        """Return the levels of the last second, channel by channel; None while less than that is there. tone_hz: of the
        tone that is played, if one is.
        """
        rows = samples.rows(samples.end - self._length, samples.end)
        return None if len(rows) < self._length or not np.all(np.isfinite(rows)) else self.of_rows(rows, tone_hz)

    def of_rows(self, rows: Rows, tone_hz: float | None = None) -> list[ChannelLevel]:
        """Return the levels of one second of rows (n, series), channel by channel."""
        count = len(self._channels)
        position = rows[:, SIGNALS.index("position") * count :].astype(np.float64)
        command = rows[:, SIGNALS.index("command") * count :][:, :count]
        windowed = (position - position.mean(axis=0)) * self._window[:, None]
        means = command.mean(axis=0, dtype=np.float64).tolist()
        return [self._level(index, windowed[:, index], tone_hz, means[index]) for index in range(count)]

    def _tone(self, index: int, windowed: FloatArray, tone_hz: float) -> float:
        """Return the level of a sinusoid of that frequency on a channel, dB SL."""
        turns = tone_hz / self._display.rate_hz * np.arange(self._length)
        volts = np.abs(np.exp(-2j * np.pi * turns) @ windowed) * 2.0 / (_HANN_SUM * self._length)
        with np.errstate(divide="ignore"):
            return max(float(db(volts / self._display.channels[index].threshold_voltage(tone_hz))), _FLOOR_DB_SL)

    def _peak_hz(self, spectrum: FloatArray, units: FloatArray) -> float:
        """Return the frequency of the strongest sinusoid: the greater neighbour of a Hann window's line tells how far
        it stands from the line (Rife & Vincent 1970).
        """
        line = int(self._edges[0]) + int(np.argmax(units[self._edges[0] : self._last]))
        side = 1 if spectrum[line + 1] > spectrum[line - 1] else -1
        ratio = float(spectrum[line + side] / max(spectrum[line], np.finfo(float).tiny))
        return (line + side * min((2.0 * ratio - 1.0) / (ratio + 1.0), 1.0)) / SECONDS

    def _level(self, index: int, windowed: FloatArray, tone_hz: float | None, command_mean_v: float) -> ChannelLevel:
        # in threshold units: amplitude of a sinusoid at each line
        weight, spectrum = self._channels[index], np.abs(scipy.fft.rfft(windowed))
        units = spectrum * 2.0 / (_HANN_SUM * self._length) * weight.per_volt
        most = np.maximum.reduceat(units[: self._last], self._edges)
        # a sinusoid's power is spread over three lines: the window's mean square against its squared mean
        power = float(np.sum(units[weight.band] ** 2)) * _HANN_SUM**2 / _HANN_POWER
        with np.errstate(divide="ignore"):
            level = max(float(db(np.sqrt(power))), _FLOOR_DB_SL)
            stretches = np.maximum(db(most), _FLOOR_DB_SL)
        tone_db_sl = None if tone_hz is None else self._tone(index, windowed, tone_hz)
        peak_hz = self._peak_hz(spectrum, units)
        peak_db_sl = self._tone(index, windowed, peak_hz)
        return ChannelLevel(stretches, level, tone_db_sl, command_mean_v, peak_hz, peak_db_sl)


@dataclass(frozen=True, eq=False)
class _Weight:
    """Threshold units per volt of the sensor at each line (0 at rest), and the lines of the channel's band."""

    per_volt: FloatArray
    band: FloatArray

    @classmethod
    def of(cls, channel: Channel, lines: FloatArray) -> "_Weight":
        low, high = channel.threshold.band_hz
        threshold_v = channel.threshold_voltage(np.maximum(lines, lines[1]))
        # a window's side reaches two lines beyond: without the lowest two there is no leakage of the mean
        inside = (lines >= max(low, 2.0 * lines[1]) - 1e-9) & (lines <= high + 2.0 * lines[1])
        return cls(np.where(lines > 0.0, 1.0 / threshold_v, 0.0), inside)


class RigProcess:
    """A rig held by a process of its own, which brings it to rest when this one ends, however that comes about.

    spec: as of --rig. changed: called, from another thread, whenever something but samples has come; set it to be told.
    presented: called with what an experiment has played, and with None where the process has ended.
    """

    def __init__(self, spec: str, display: Display, seed: int = 0) -> None:
        self.spec, self.display, self.seed = spec, display, seed
        self.status = orders.RigStatus()
        self.points: orders.Points | None = None
        self.samples = ScopeSamples(len(display.channels), round(KEPT_S * display.rate_hz))
        self.levels = Levels(display)
        self.changed: Callable[[orders.News], None] = lambda news: None
        self.taken: Callable[[orders.Piece], None] = lambda piece: None
        self.presented: Callable[[orders.Presented | None], None] = lambda piece: None
        self._before = 0
        self._felt: tuple[int, list[ChannelLevel] | None] = (-1, None)
        self._pipe: Connection
        self._process: BaseProcess
        self._thread: threading.Thread
        self._begin()

    def _begin(self) -> None:
        """Begin the process and wait until the rig is open. Raises BadInput with its reason where it cannot be, and
        DeviceFault where a device is the reason.
        """
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=hold_rig, args=(theirs, self.spec, self.display, self.seed))
        self._process.start()
        theirs.close()
        self._before = self.samples.end
        try:
            first = self._pipe.recv()
            if first.mode == "gone":
                raise BadInput(first.fault) if first.refused else DeviceFault(first.fault)
        except BaseException as error:  # or interrupted or told to end while the rig was being opened
            self._end()
            if isinstance(error, EOFError | OSError):
                raise DeviceFault(*_ENDED) from None
            raise
        self.status = first
        self._thread = threading.Thread(target=self._read, args=(self._pipe,), daemon=True)
        self._thread.start()

    def order(self, order: orders.Order) -> None:
        """Hand an order to the process; after the process has ended, the order to open the rig begins another."""
        if isinstance(order, orders.ReopenOrder) and not self._process.is_alive():
            self._begin()
            self.changed(self.status)
            return
        with suppress(OSError):
            self._pipe.send(order)

    def felt(self) -> list[ChannelLevel] | None:
        """Return the levels of the last second; computed at most once for the same samples."""
        end = self.samples.end
        if end - self._felt[0] >= 0.1 * self.display.rate_hz or end < self._felt[0]:
            wave = self.status.wave
            tone_hz = wave.frequency_hz if wave is not None and wave.kind == "tone" else None
            self._felt = (end, self.levels.of(self.samples, tone_hz))
        return self._felt[1]

    def close(self) -> None:
        """Bring the rig to rest, and end the process."""
        self.changed = lambda news: None
        self._end()

    def _end(self) -> None:
        with suppress(OSError):
            self._pipe.send(orders.QuitOrder())
        self._process.join(_END_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._pipe.close()

    def _read(self, pipe: Connection) -> None:
        try:
            while True:
                self._take(pipe.recv())
        except (EOFError, OSError):
            if self.status.mode != "gone":  # else it has said why
                self._take(orders.RigStatus(mode="gone", fault=str(DeviceFault(*_ENDED))))
            self.presented(None)

    def _take(self, news: orders.News) -> None:
        match news:
            case orders.Piece():
                rows = np.frombuffer(news.content, dtype=np.float32).reshape(-1, self.samples.series)
                self.samples.add(self._before + news.first, rows, news.saturated)
                self.taken(news)
                return
            case orders.Presented():
                self.presented(news)
                return
            case orders.RigStatus():
                self.status = news
            case orders.Points():
                self.points = news
            case orders.Refused():
                pass
        self.changed(news)
