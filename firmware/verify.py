"""Whether a connected board computes what this machine does: a run of it, computed again here from its readings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactuator.errors import BadInput
from tactuator.model.controller import Controller
from tactuator.rig.board.commissioning import safety_table
from tactuator.rig.board.link import SAFETY, STREAM, Request
from tactuator.rig.board.rig import BoardRig
from tactuator.runtime._core import ffi, lib
from tactuator.runtime.image import build_image
from tactuator.runtime.safety_table import (
    NEVER,
    NEVER_TICKS,
    ChannelSafety,
    Jump,
    SafetyTable,
    Standstill,
    safety_bytes,
)

_RMS = 20.0
_FIRST_S, _SILENT_S = 0.1, 0.3
"""Time until the first row of a run is played, and until the first that is not zero."""
_REQUEST_ROWS = 128
_CODE = 0xFFFFFF
_GUARD_MAX = 1e5
Codes = NDArray[np.int64]


@dataclass(frozen=True)
class Verified:
    """What became of `ticks` of a run. first_difference: the tick at which a command was not this machine's; None where
    all are. late: interrupts that came too late. cycles: the most of any step; 0 where the board does not count them.
    """

    board: str
    ticks: int
    first_difference: int | None
    late: int
    cycles: int

    @property
    def holds(self) -> bool:
        """Return whether every command is this machine's, and no interrupt was late."""
        return self.first_difference is None and self.late == 0


def verify(rig: BoardRig, controller: Controller, seconds: float = 10.0, seed: int = 0, bare: bool = False) -> Verified:
    """Let a board play noise of 26 dB SL rms in closed loop, and compare each of its commands, bit for bit, with what
    this machine's core makes of the same rows and of the board's own readings.

    bare: on a board that lacks a converter; its guard watches nothing, and its outputs stay safe.

    Raises BadInput for less than a second, where the board holds another display's table, and for a bare run on a board
    that lacks nothing; RigFault where its guard ends the run, RigIncomplete where something is missing.
    """
    if not seconds >= 1.0:
        raise BadInput(f"{seconds:g} s", "a second or more")
    table, image = safety_table(controller.display), build_image(controller)
    if bare:
        if not rig.status().missing:
            raise BadInput("the board lacks nothing", "a run that is not bare")
        table = _unguarded(table)
        rig.client.upload(SAFETY, safety_bytes(table))
    rig.load(controller)
    before = rig.status()
    if before.safety_crc != int.from_bytes(safety_bytes(table)[-4:], "little"):
        raise BadInput("the board holds another display's safety table", "the one it was commissioned with")
    rows = _rows(round(seconds * rig.rate_hz), len(rig.channels), round(_SILENT_S * rig.rate_hz), seed)
    first = 0 if rig.waits else round(_FIRST_S * rig.rate_hz)
    try:
        traced = _played(rig, rows, first, bare)
        after = rig.status()
    finally:
        rig.off()
    ours = replayed(table, image, rows, first, traced[:, 1::2])
    differs = np.flatnonzero((traced[:, ::2] != ours).any(axis=1))
    difference = int(differs[0]) if differs.size else None
    return Verified(after.name, len(traced), difference, after.late - before.late, after.cycles)


def _rows(count: int, channels: int, silent: int, seed: int) -> NDArray[np.float32]:
    """Return noise after silence: rows that come while the board still plays zeros do not move its limits."""
    rows = _RMS * np.random.default_rng(seed).standard_normal((count, channels))
    rows[:silent] = 0.0
    return rows.astype(np.float32)


def _played(rig: BoardRig, rows: NDArray[np.float32], first: int, bare: bool) -> Codes:
    """Play rows from tick `first` of a new run on, and return its trace from its beginning: of each channel the command
    with its flags, and the reading; shape (ticks, 2 channels).
    """
    client, width, status = rig.client, rows.shape[1], rig.status()
    run, lead = (status.run + 1) & 0xFFFFFFFF, min(round(_SILENT_S * rig.rate_hz), status.stream_capacity * 7 // 8)
    client.must(Request.ARM, bytes([bare]))
    client.start(run, STREAM, False, rig.waits)
    parts: list[Codes] = []
    end, tick, got = first, 0, 0
    while got < first + len(rows):
        if end < first + len(rows) and end - tick < lead:
            sent = rows[end - first :][:_REQUEST_ROWS]
            end, tick = client.stream(run, end, sent, None)
        part = client.trace(run, got, first + len(rows) - got, width, False)
        taken = np.empty((len(part.flags), 2 * width), dtype=np.int64)
        taken[:, ::2] = part.command_code & _CODE | part.flags.astype(np.int64) << 24
        taken[:, 1::2] = part.position_code
        parts.append(taken)
        got += len(taken)
        tick = max(tick, got)
        if not len(taken):
            rig.status().require_no_fault()
    return np.concatenate(parts)


def replayed(table: SafetyTable, image: bytes, rows: NDArray[np.float32], first: int, readings: Codes) -> Codes:
    """Return the commands with their flags that this machine's core gives in a run with these rows and readings.

    Its guard sees nothing: what it knew before the run began is the board's alone.
    """
    ticks, width = readings.shape
    capacity = 1 << int(ticks).bit_length()
    board, parsed, loaded = ffi.new("tact_board *"), ffi.new("tact_safety *"), ffi.new("tact_image *")
    stream, trace = ffi.new("float[]", capacity * width), ffi.new("int32_t[]", 2 * capacity * width)
    lib.tact_board_reset(board, width, stream, capacity, trace, capacity)
    content = safety_bytes(_unguarded(table))
    lib.tact_safety_parse(parsed, content, len(content), width)
    lib.tact_image_parse(loaded, image, len(image), table.rate_hz, table.delay_samples, width)
    assert lib.tact_board_take_safety(board, parsed)
    assert lib.tact_board_take_image(board, loaded)
    assert lib.tact_board_arm(board)
    assert lib.tact_board_start(board, 1, STREAM, 0, 0)
    wants, codes = np.ascontiguousarray(rows), np.ascontiguousarray(readings, dtype=np.int32)
    for tick in range(ticks):
        if first <= tick < first + len(wants):
            lib.tact_board_stream(board, tick, ffi.from_buffer("float[]", wants[tick - first]), 1)
        board.silence = 0
        lib.tact_period_step(board, ffi.from_buffer("int32_t[]", codes[tick]), 0)
    return np.frombuffer(ffi.buffer(trace), dtype=np.uint32).reshape(-1, 2 * width)[:ticks, ::2].astype(np.int64)


def _unguarded(table: SafetyTable) -> SafetyTable:
    return replace(table, channels=tuple(map(_unguarded_channel, table.channels)))


def _unguarded_channel(channel: ChannelSafety) -> ChannelSafety:
    return replace(
        channel, position_code_max=1 << 24, frozen_ticks=NEVER_TICKS, stop_max_v=NEVER, comfort_max=_GUARD_MAX,
        disagreement_v=NEVER, reversal_power=NEVER, standstill=Standstill(0, NEVER), jump=Jump(NEVER, 0.0),
    )  # fmt: skip
