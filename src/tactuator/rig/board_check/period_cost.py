"""Counts the instructions that one period costs a board: in the usual run, and in every other that costs more."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.model.controller import Controller
from tactuator.rig.board.commissioning import soft_ticks
from tactuator.rig.board.frames import Request
from tactuator.rig.board.link import STIMULUS, STREAM, LinkClient, understood
from tactuator.rig.board.tones import TONES_MAX, BoardTone, stimulus_payloads
from tactuator.rig.boards import find_board
from tactuator.rig.open import emulated_rig
from tactuator.rig.samples import REFERENCE_MAX

COUNTING, INSTRUCTION_S = "shift=10,sleep=off", 1024e-9
"""An instruction takes 1024 ns of the emulator's time, so that the boards' timers tell one from two."""
CLOCKS_MHZ = (168.0, 480.0, 600.0)
_TICKS, _ONCE, _LEVEL = 560, 400, 100.0
_TONES_HZ = (7.0, 53.0, 201.0, 31.0)
_SENSOR_OPEN = 1


@dataclass(frozen=True)
class PeriodCost:
    """Instructions of one period (latch, guard, filters, supervisor; converters and simulated device excluded).

    instructions_per_tick: the most of any tick of the usual run. cases: of each run. worst: of all.
    """

    board: str
    format: str
    channels: int
    instructions_per_tick: int
    worst: int
    cases: dict[str, int]
    share_of_period: dict[str, float]
    worst_share_of_period: dict[str, float]


class _Bench:
    """Runs of a board whose timer stands still: periods pass as they are asked for, and are counted."""

    def __init__(self, client: LinkClient, controller: Controller, counts_per_instruction: float) -> None:
        self._client, self._controller, self._counts = client, controller, counts_per_instruction
        self._soft, self._run = soft_ticks(controller.rate_hz), client.status().run
        self._names = tuple(channel.name for channel in controller.display.channels)
        self.most(1)  # stops the timer: at this clock it would come too often
        client.must(Request.ARM)

    def most(self, ticks: int) -> int:
        """Return the most instructions of any of the next ticks."""
        most = 0
        for at in range(0, ticks, _ONCE):
            self._ask(0)
            most = max(most, self._ask(min(_ONCE, ticks - at)))
        return round(most / self._counts)

    def _ask(self, periods: int) -> int:
        with understood(Request.BENCH):
            return int(struct.unpack("<4I", self._client.must(Request.BENCH, struct.pack("<I", periods)))[1])

    def usual(self) -> int:
        """Return the cost of tones that stream in, after the soft start."""
        return self._stream(self._waves())

    def silent(self) -> int:
        """Return the cost of a stream of zeros."""
        return self._stream(np.zeros_like(self._waves()))

    def soft_start(self) -> int:
        """Return the cost of the soft start, tones streaming in."""
        return self._stream(self._waves(), counts_start=True)

    def limited(self) -> int:
        """Return the cost where every channel's command is cut at nearly every tick."""
        rows = self._waves()
        signs = np.sign(np.sin(2.5 * np.arange(len(rows))))
        return self._stream(np.repeat(REFERENCE_MAX * signs[:, None], rows.shape[1], axis=1))

    def tones(self) -> int:
        """Return the cost of as many tones as a board makes, all in their ramps, soft start and limits included."""
        return self._play_tones(self._soft + _TICKS)

    def faults(self) -> int:
        """Return the cost where all sensors fail at once in the middle of all those tones, and of what follows."""
        self._play_tones(self._soft + _TICKS // 2, rests=False)
        for channel in range(len(self._names)):
            self._client.must(Request.BREAK, struct.pack("<2Bf", channel, _SENSOR_OPEN, 0.0))
        return self.most(_TICKS)

    def _waves(self) -> FloatArray:
        time_s = np.arange(self._soft + _TICKS) / self._controller.rate_hz
        hertz = (_TONES_HZ[c % 4] for c in range(len(self._names)))
        return np.stack([_LEVEL * np.sin(2.0 * np.pi * frequency * time_s + 0.5) for frequency in hertz], axis=1)

    def _stream(self, rows: FloatArray, counts_start: bool = False) -> int:
        self._run += 1
        self._client.start(self._run, STREAM, False, True)
        end = 0
        while end < len(rows):
            end, _ = self._client.stream(self._run, end, rows[end:].astype(np.float32), None)
        start, rest = self.most(self._soft), self.most(_TICKS)
        self._rest()
        return start if counts_start else rest

    def _play_tones(self, ticks: int, rests: bool = True) -> int:
        rate_hz, half = self._controller.rate_hz, ticks // 2 + 1
        tones = [
            BoardTone(180.0 + 23.0 * n, 150.0, 0.0, 2.0 * half / rate_hz, half / rate_hz) for n in range(TONES_MAX)
        ]
        for payload in stimulus_payloads(dict.fromkeys(self._names, tones), self._names, rate_hz, 0):
            self._client.must(Request.STIMULUS, payload)
        self._run += 1
        self._client.start(self._run, STIMULUS, False, False)
        most = self.most(ticks)
        if rests:
            self._rest()
        return most

    def _rest(self) -> None:
        self._client.must(Request.STOP)
        self.most(self._soft)


CASES: dict[str, Callable[[_Bench], int]] = {
    "usual": _Bench.usual,
    "silent": _Bench.silent,
    "soft start": _Bench.soft_start,
    "limited": _Bench.limited,
    "on-board tones": _Bench.tones,
    "faults": _Bench.faults,
}


def count_instructions(board: str, controller: Controller, number_format: str) -> PeriodCost:
    """Count the instructions of periods in every case. Deterministic: the emulator's clock counts instructions."""
    counts = INSTRUCTION_S * find_board(board).timer_hz
    with emulated_rig(board, controller.display, 0, number_format, counting=COUNTING) as rig:
        rig.load(controller)
        bench = _Bench(rig.client, controller, counts)
        cases = {name: case(bench) for name, case in CASES.items()}
    usual, worst = cases["usual"], max(cases.values())
    shares = [
        {f"{clock:g} MHz": count * controller.rate_hz / (clock * 1e6) for clock in CLOCKS_MHZ}
        for count in (usual, worst)
    ]
    return PeriodCost(board, number_format, len(controller.channels), usual, worst, cases, *shares)
