"""Trials of a board: bit for bit against this machine, and what a period costs."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from tactuator.display.controller import Controller
from tactuator.errors import BadInput
from tactuator.rig.board.commissioning import soft_ticks
from tactuator.rig.board.frames import Request
from tactuator.rig.board.link import STREAM
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.boards import emulated_rig, in_process_rig
from tactuator.runtime.image import FORMATS

COUNTS_PER_INSTRUCTION = 1024.0 / 40.0
"""Of the boards' 25 MHz timer under `-icount shift=10`: 1024 ns an instruction, 40 ns a count."""
CLOCKS_MHZ = (168.0, 480.0, 600.0)
_CHUNK = 50_000
_BENCH_TICKS = 600
_LEVEL = 100.0
_TONES_HZ = (7.0, 53.0, 201.0, 31.0)


@dataclass(frozen=True)
class BitComparison:
    """Whether a board's commands are this machine's, bit for bit; samples of each of the channels, in each format."""

    board: str
    bit_exact: bool
    samples: int
    channels: int
    formats: tuple[str, ...]


@dataclass(frozen=True)
class PeriodCost:
    """Instructions of one period (converters, guard, filters; the simulated device excluded): the most of any tick."""

    board: str
    format: str
    channels: int
    instructions_per_tick: int
    share_of_period: dict[str, float]


def compare_bits(board: str, controller: Controller, samples: int, seed: int = 1) -> BitComparison:
    """A million (say) random and adversarial samples through the controllers in both formats, on board and host."""
    if samples < 1:
        raise BadInput(f"samples is {samples}; allowed: 1 or more")
    exact = True
    for number_format in FORMATS:
        with (
            emulated_rig(board, controller.display, 0, number_format, counting=None) as target,
            in_process_rig(controller.display, 0, number_format) as host,
        ):
            digests = [_digests(rig, controller, samples, seed) for rig in (target, host)]
        exact = exact and digests[0] == digests[1]
    return BitComparison(board, exact, samples, len(controller.channels), FORMATS)


def _digests(rig: BoardRig, controller: Controller, samples: int, seed: int) -> list[bytes]:
    """The digest after every stretch."""
    rig.load(controller)
    digests = []
    for at in range(0, samples, _CHUNK):
        payload = struct.pack("<IIB", seed, min(_CHUNK, samples - at), at == 0)
        digests.append(rig.client.must(Request.BIT_CHECK, payload, patience=10.0))
    return digests


def count_instructions(board: str, controller: Controller, number_format: str) -> PeriodCost:
    """Deterministic: the emulator's clock counts instructions. With a stream of tones, after the soft start."""
    soft = soft_ticks(controller.rate_hz)
    time_s = np.arange(soft + _BENCH_TICKS) / controller.rate_hz
    count = len(controller.channels)
    rows = np.stack([_LEVEL * np.sin(2.0 * np.pi * _TONES_HZ[c % 4] * time_s + 0.5) for c in range(count)], axis=1)
    with emulated_rig(board, controller.display, 0, number_format, counting="shift=10,sleep=off") as rig:
        rig.load(controller)
        client = rig.client
        client.must(Request.ARM)
        client.must(Request.BENCH, struct.pack("<I", 1))  # stops the timer: at this clock it would come too often
        client.start(1, STREAM, False, True)
        end = 0
        while end < rows.shape[0]:
            end, _ = client.stream(1, end, rows[end:].astype(np.float32), None)
        client.must(Request.BENCH, struct.pack("<I", soft))
        _, most, _, _ = struct.unpack("<4I", client.must(Request.BENCH, struct.pack("<I", _BENCH_TICKS)))
    instructions = round(most / COUNTS_PER_INSTRUCTION)
    shares = {f"{clock:g} MHz": instructions * controller.rate_hz / (clock * 1e6) for clock in CLOCKS_MHZ}
    return PeriodCost(board, number_format, count, instructions, shares)
