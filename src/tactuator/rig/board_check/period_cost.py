"""Counts the instructions that one period costs a board."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from tactuator.display.controller import Controller
from tactuator.rig.board.commissioning import soft_ticks
from tactuator.rig.board.frames import Request
from tactuator.rig.board.link import STREAM
from tactuator.rig.boards import emulated_rig
from tactuator.rig.program import find_board

COUNTING, INSTRUCTION_S = "shift=10,sleep=off", 1024e-9
"""An instruction takes 1024 ns of the emulator's time, so that the boards' timers tell one from two."""
CLOCKS_MHZ = (168.0, 480.0, 600.0)
_BENCH_TICKS = 600
_LEVEL = 100.0
_TONES_HZ = (7.0, 53.0, 201.0, 31.0)


@dataclass(frozen=True)
class PeriodCost:
    """Instructions of one period (converters, guard, filters; the simulated device excluded): the most of any tick."""

    board: str
    format: str
    channels: int
    instructions_per_tick: int
    share_of_period: dict[str, float]


def count_instructions(board: str, controller: Controller, number_format: str) -> PeriodCost:
    """Deterministic: the emulator's clock counts instructions. With a stream of tones, after the soft start."""
    soft = soft_ticks(controller.rate_hz)
    time_s = np.arange(soft + _BENCH_TICKS) / controller.rate_hz
    count = len(controller.channels)
    rows = np.stack([_LEVEL * np.sin(2.0 * np.pi * _TONES_HZ[c % 4] * time_s + 0.5) for c in range(count)], axis=1)
    with emulated_rig(board, controller.display, 0, number_format, counting=COUNTING) as rig:
        rig.load(controller)
        client = rig.client
        client.must(Request.BENCH, struct.pack("<I", 1))  # stops the timer: at this clock it would come too often
        client.must(Request.ARM)
        client.start(1, STREAM, False, True)
        end = 0
        while end < rows.shape[0]:
            end, _ = client.stream(1, end, rows[end:].astype(np.float32), None)
        client.must(Request.BENCH, struct.pack("<I", soft))
        _, most, _, _ = struct.unpack("<4I", client.must(Request.BENCH, struct.pack("<I", _BENCH_TICKS)))
    instructions = round(most / (INSTRUCTION_S * find_board(board).timer_hz))
    shares = {f"{clock:g} MHz": instructions * controller.rate_hz / (clock * 1e6) for clock in CLOCKS_MHZ}
    return PeriodCost(board, number_format, count, instructions, shares)
