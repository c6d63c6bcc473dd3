"""Processor cycles of the board's step on a connected board that has a counter, beside the emulator's instructions."""

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
from tactuator.rig.board.frames import Request, RequestOutcome
from tactuator.rig.board.link import LinkClient, understood
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.board_check.period_cost import count_instructions
from tactuator.rig.boards import BOARDS, find_board

_COUNTS = struct.Struct("<4I")
_LEVEL, _TONES_HZ = 20.0, (7.0, 53.0, 201.0, 31.0)
_POLL_S, _PIECES = 0.01, 30


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
    format: str
    channels: int
    cases: dict[str, Cycles]


def count_cycles(
    rig: BoardRig,
    controller: Controller,
    seconds: float = 1.0,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> PeriodCycles:
    """Count the cycles of the step on a connected board, `seconds` of each case, in float32. The board drives its
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
    for name, level in (("silent", 0.0), ("usual", _LEVEL)):
        counts[name] = counter.read_while(rig, level * _tones(controller, 3 * counter.periods))
    rig.off()
    known: dict[str, int] = {}
    with contextlib.suppress(BadInput):  # no emulator, or not of this board
        known = count_instructions(find_board(status.name).name, controller, "float32").cases
    clock_hz = find_board(status.name).timer_hz if status.name in BOARDS else float("nan")
    cases = {
        name: Cycles(
            counter.periods, least, total / counter.periods, most, known.get(name), most * controller.rate_hz / clock_hz
        )
        for name, (least, most, total) in counts.items()
    }
    return PeriodCycles(status.name, "float32", len(controller.channels), cases)


class _Counter:
    """The board's counter over so many periods: begun, and read once they are over."""

    def __init__(
        self,
        client: LinkClient,
        periods: int,
        rate_hz: float,
        clock: Callable[[], float],
        sleep: Callable[[float], None],
    ) -> None:
        self._client, self.periods, self._rate_hz = client, periods, rate_hz
        self._clock, self._sleep = clock, sleep

    def begin(self) -> None:
        """Begin anew: another number of periods, none here, ends what was counted before."""
        self._ask(0)
        self._ask(self.periods)

    def read(self) -> tuple[int, int, int]:
        """Return the least, the most and the sum. Raises DeviceFault where the periods take three times their time."""
        end_s = self._clock() + 1.0 + 3.0 * self.periods / self._rate_hz
        while self._clock() < end_s:
            least, most, total = self._ask(self.periods)
            if most:
                return least, most, total
            self._sleep(_POLL_S)
        raise DeviceFault(f"the board has not made {self.periods} periods", "one whose timer goes")

    def read_while(self, rig: BoardRig, rows: FloatArray) -> tuple[int, int, int]:
        """Return what is counted while the rows (n, channels) play: from where their trace begins to come."""
        for at, _ in enumerate(rig.stream(np.array_split(rows, _PIECES))):
            if at == 0:
                self.begin()
        return self.read()

    def _ask(self, periods: int) -> tuple[int, int, int]:
        outcome, answer = self._client.ask(Request.BENCH, struct.pack("<I", periods))
        if outcome is not RequestOutcome.DONE:
            raise BadInput("the board has no counter of cycles", "one that has, an STM32F405 say")
        with understood(Request.BENCH):
            least, most, total, _ = _COUNTS.unpack(answer)
        return least, most, total


def _tones(controller: Controller, count: int) -> FloatArray:
    time_s = np.arange(count) / controller.rate_hz
    hertz = (_TONES_HZ[c % 4] for c in range(len(controller.channels)))
    return np.stack([np.sin(2.0 * np.pi * frequency * time_s) for frequency in hertz], axis=1)
