"""The cost of one period on a board, in instructions of the emulator and in cycles of a connected board.

Instructions are counted in the usual run and in every other that costs more, cycles on a board that has a counter.
"""

from __future__ import annotations

import contextlib
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, DeviceFault
from tactuator.model.controller import Controller
from tactuator.rig.board.commissioning import soft_ticks
from tactuator.rig.board.link import STIMULUS, STREAM, LinkClient, Request, RequestOutcome, understood
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.board.stream import TONES_MAX, BoardTone, stimulus_payloads
from tactuator.rig.boards import BOARDS, find_board
from tactuator.rig.open import emulated_rig
from tactuator.runtime.simulation import REFERENCE_MAX

COUNTING, INSTRUCTION_S = "shift=10,sleep=off", 1024e-9
"""An instruction takes 1024 ns of the emulator's time, so that the boards' timers tell one from two."""
CLOCKS_MHZ = (168.0, 480.0, 600.0)
_TICKS, _ONCE, _LEVEL = 560, 400, 100.0
_TONES_HZ = (7.0, 53.0, 201.0, 31.0)
_SENSOR_OPEN = 1
_USUAL_LEVEL = 20.0
_POLL_S, _PIECES = 0.01, 30


@dataclass(frozen=True)
class PeriodCost:
    """Instructions of one period (latch, guard, filters, supervisor; converters and simulated device excluded).

    instructions_per_tick: the most of any tick of the usual run. cases: of each run. worst: of all.
    """

    board: str
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

    def limited(self) -> int:
        """Return the cost where every channel's command is cut at nearly every tick."""
        rows = self.waves()
        signs = np.sign(np.sin(2.5 * np.arange(len(rows))))
        return self.stream(np.repeat(REFERENCE_MAX * signs[:, None], rows.shape[1], axis=1))

    def faults(self) -> int:
        """Return the cost where all sensors fail at once in the middle of all those tones, and of what follows."""
        self.play_tones(self._soft + _TICKS // 2, rests=False)
        for channel in range(len(self._names)):
            self._client.must(Request.BREAK, struct.pack("<2Bf", channel, _SENSOR_OPEN, 0.0))
        return self.most(_TICKS)

    def waves(self) -> FloatArray:
        """Return tones for the usual run and its soft start, (n, channels), threshold units."""
        return _LEVEL * _tones(self._controller, self._soft + _TICKS, 0.5)

    def stream(self, rows: FloatArray, counts_start: bool = False) -> int:
        """Return the cost of rows that stream in: of the soft start, or of what follows it."""
        self._run += 1
        self._client.start(self._run, STREAM, False, True)
        end = 0
        while end < len(rows):
            end, _ = self._client.stream(self._run, end, rows[end:].astype(np.float32), None)
        start, rest = self.most(self._soft), self.most(_TICKS)
        self._rest()
        return start if counts_start else rest

    def play_tones(self, ticks: int = 0, rests: bool = True) -> int:
        """Return the cost of as many tones as a board makes, all in their ramps, soft start and limits included."""
        ticks = ticks or self._soft + _TICKS
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
    "usual": lambda bench: bench.stream(bench.waves()),
    "silent": lambda bench: bench.stream(np.zeros_like(bench.waves())),
    "soft start": lambda bench: bench.stream(bench.waves(), counts_start=True),
    "limited": _Bench.limited,
    "on-board tones": _Bench.play_tones,
    "faults": _Bench.faults,
}


def count_instructions(board: str, controller: Controller) -> PeriodCost:
    """Count the instructions of periods in every case. Deterministic: the emulator's clock counts instructions."""
    counts = INSTRUCTION_S * find_board(board).timer_hz
    with emulated_rig(board, controller.display, 0, counting=COUNTING) as rig:
        rig.load(controller)
        bench = _Bench(rig.client, controller, counts)
        cases = {name: case(bench) for name, case in CASES.items()}
    usual, worst = cases["usual"], max(cases.values())
    shares = [
        {f"{clock:g} MHz": count * controller.rate_hz / (clock * 1e6) for clock in CLOCKS_MHZ}
        for count in (usual, worst)
    ]
    return PeriodCost(board, len(controller.channels), usual, worst, cases, *shares)


@dataclass(frozen=True)
class Cycles:
    """Cycles of one period's step over `periods` of them: the least, the mean and the most. instructions: the most that
    the emulator counts in this case, with latch and supervisor; None where it does not count it, or is missing.
    """

    periods: int
    least: int
    mean: float
    most: int
    instructions: int | None
    share_of_period: float


@dataclass(frozen=True)
class PeriodCycles:
    """Cycles of a connected board in each case: at rest, in silence, and with tones of 26 dB SL."""

    board: str
    channels: int
    cases: dict[str, Cycles]


def count_cycles(
    rig: BoardRig,
    controller: Controller,
    seconds: float = 1.0,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> PeriodCycles:
    """Count the cycles of the step on a connected board, `seconds` of each case. The board drives its
    motors: in silence, and with tones of 20 times threshold.

    Raises BadInput for a board whose display is simulated (its instructions are counted) or that has no counter, and
    DeviceFault where the periods do not come.
    """
    status = rig.status()
    if status.allows_hold:
        raise BadInput(f"{status.name} has a simulated display", "without --rig, where instructions are counted")
    counter = _Counter(rig.client, round(seconds * controller.rate_hz), controller.rate_hz, clock, sleep)
    rig.off()
    counter.begin()
    counts = {"at rest": counter.read()}
    rig.load(controller)
    rig.play(np.zeros((soft_ticks(controller.rate_hz), len(controller.channels))))
    for name, level in (("silent", 0.0), ("usual", _USUAL_LEVEL)):
        rows = level * _tones(controller, 3 * counter.periods, 0.0)
        for at, _ in enumerate(rig.stream(np.array_split(rows, _PIECES))):
            if at == 0:  # from where their trace begins to come
                counter.begin()
        counts[name] = counter.read()
    rig.off()
    known: dict[str, int] = {}
    with contextlib.suppress(BadInput):  # no emulator, or not of this board
        known = count_instructions(find_board(status.name).name, controller).cases
    clock_hz = find_board(status.name).timer_hz if status.name in BOARDS else float("nan")
    cases = {
        name: Cycles(
            counter.periods, least, total / counter.periods, most, known.get(name), most * controller.rate_hz / clock_hz
        )
        for name, (least, most, total) in counts.items()
    }
    return PeriodCycles(status.name, len(controller.channels), cases)


@dataclass(frozen=True)
class _Counter:
    """The board's counter over so many periods: begun, and read once they are over."""

    client: LinkClient
    periods: int
    rate_hz: float
    clock: Callable[[], float]
    sleep: Callable[[float], None]

    def begin(self) -> None:
        """Begin anew: another number of periods, none here, ends what was counted before."""
        self._ask(0)
        self._ask(self.periods)

    def read(self) -> tuple[int, int, int]:
        """Return the least, the most and the sum. Raises DeviceFault where the periods take three times their time."""
        end_s = self.clock() + 1.0 + 3.0 * self.periods / self.rate_hz
        while self.clock() < end_s:
            least, most, total = self._ask(self.periods)
            if most:
                return least, most, total
            self.sleep(_POLL_S)
        raise DeviceFault(f"the board has not made {self.periods} periods", "one whose timer goes")

    def _ask(self, periods: int) -> tuple[int, int, int]:
        outcome, answer = self.client.ask(Request.BENCH, struct.pack("<I", periods))
        if outcome is not RequestOutcome.DONE:
            raise BadInput("the board has no counter of cycles", "one that has, an STM32F405 say")
        with understood(Request.BENCH):
            least, most, total, _ = struct.unpack("<4I", answer)
        return least, most, total


def _tones(controller: Controller, count: int, phase: float) -> FloatArray:
    time_s = np.arange(count) / controller.rate_hz
    hertz = (_TONES_HZ[c % 4] for c in range(len(controller.channels)))
    return np.stack([np.sin(2.0 * np.pi * frequency * time_s + phase) for frequency in hertz], axis=1)
