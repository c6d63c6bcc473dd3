"""A sound card that is turned by hand: it calls back when the program sleeps, and its inputs hear its outputs."""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from tactuator.io.display import parse_display
from tactuator.model.controller import AntiWindup, ChannelController, Controller, Limits
from tactuator.model.description import Display
from tactuator.rig.sound.rig import SoundRig
from tactuator.rig.sound.stream import CardRows
from tactuator.runtime._core import ffi, lib

RATE_HZ = 8000.0
PERIOD = 64
PATIENCE_S, LONGEST_S = 6.0, 600.0
OVERFLOW = 2  # PortAudio's paInputOverflow
Answer = Callable[[np.ndarray], np.ndarray]


def sound_display(
    names: Sequence[str] = ("left", "right"),
    rate_hz: float = RATE_HZ,
    range_v: float = 1.5,
    channel: Mapping[str, Any] = MappingProxyType({}),
    tables: Mapping[str, Any] = MappingProxyType({}),
    **changes: Any,
) -> Display:
    """Channels on a card, each a light exciter of 150 Hz without loop; `changes` go into [sound], `channel` into every
    channel, and `tables` stand for those of these names."""
    plant = {"num": [40.0], "den": [1.0, 2 * 0.2 * 942.5, 942.5**2], "delay_s": 0.0}
    keys = {"sensor_gain_v_per_mm": 2.0, "travel_mm": 1.0, "plant": plant} | channel
    sound = {"output_full_scale_v": 2.0, "input_full_scale_v": 4.0} | changes
    document = {
        "display": {"name": "exciters", "rate_hz": rate_hz, "delay_samples": 0},
        "threshold": {"curve": "bolanowski-1988", "band_hz": [10.0, 400.0]},
        "feedback": {"structure": "none"},
        "converter": {"range_v": range_v},
        "sound": {key: value for key, value in sound.items() if value is not None},
        "channel": [{"name": name, **keys} for name in names],
    }
    return parse_display(document | tables)


def flat_controller(display: Display, gain: float = 0.01, **channel: Any) -> Controller:
    """A controller that multiplies by `gain` volts for a threshold unit."""
    given: dict[str, Any] = {
        "threshold_voltage_dc": 1.0,
        "prefilter_sos": np.array([[gain, 0.0, 0.0, 1.0, 0.0, 0.0]]),
        "feedback_sos": None,
        "anti_windup": AntiWindup(),
        "limits": Limits(1.5, 2.0),
    } | channel
    return Controller(display, tuple(ChannelController(name=one.name, **given) for one in display.channels))


class TurnedCard:
    """A card with `delay` samples from an output to the input of the same number. answer: what the inputs hear of the
    outputs (n, channels); flags: told at the calls of those numbers; stops_at: the call from which it is silent, for
    stops_for_s.
    """

    def __init__(
        self,
        rows: CardRows,
        delay: int = 0,
        answer: Answer = lambda out: out,
        flags: Callable[[int], int] = lambda call: 0,
        stops_at: int | None = None,
        stops_for_s: float = np.inf,
        hurry: float = 1.0,
        rate_hz: float = RATE_HZ,
        period: int = PERIOD,
        inputs: int = 0,
    ) -> None:
        self.rows, self.answer, self.flags, self.stops_at, self.hurry = rows, answer, flags, stops_at, hurry
        self.stops_for_s, self.rate_hz, self.period = stops_for_s, rate_hz, period
        self.calls, self.owed, self.silent_s = 0, 0.0, 0.0
        self.put_out: list[np.ndarray] = []
        self._heard = np.zeros((delay, inputs or rows.outputs), dtype=np.float32)
        self.closed: bool | None = None

    def sleep(self, seconds: float) -> None:
        self.owed += self.hurry * seconds * self.rate_hz
        while self.owed >= self.period:
            self.owed -= self.period
            if self.stops_at is None or self.calls < self.stops_at or self.silent_s >= self.stops_for_s:
                self._call()
            else:
                self.silent_s += self.period / self.rate_hz
        assert self.silent_s < PATIENCE_S, "the program waits for a card that is silent"
        assert self.calls * self.period / self.rate_hz < LONGEST_S, "the program does not come to an end"

    def _call(self) -> None:
        out = np.zeros((self.period, self.rows.outputs), dtype=np.float32)
        given = np.zeros((self.period, self._heard.shape[1]), dtype=np.float32)
        own = ffi.cast("tact_audio *", self.rows.address)
        buffers = [ffi.from_buffer("float[]", one) for one in (given, out)]
        # an output is heard a period later, as between the ports of a server
        given[: min(self.period, len(self._heard))] = self._heard[: self.period]
        lib.tact_audio_callback(*buffers, self.period, ffi.NULL, self.flags(self.calls), own)
        self.put_out.append(out)
        self._heard = np.concatenate([self._heard[self.period :], self.answer(out)])
        self.calls += 1

    def close(self, alive: bool) -> None:
        self.closed = alive


def turned_rig(display: Display, capacity: int = 16384, **card: Any) -> tuple[SoundRig, TurnedCard]:
    rows = CardRows(2, 2, capacity, RATE_HZ)
    turned = TurnedCard(rows, **{"delay": PERIOD} | card)
    return SoundRig(display, rows, turned, turned.sleep), turned
