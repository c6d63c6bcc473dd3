"""Safety table: what a board's guard holds every image to (layout: core/board/safety.h)."""

from __future__ import annotations

import struct
from dataclasses import astuple, dataclass, fields
from enum import IntEnum

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.description import Converter
from tactuator.runtime._core import ffi, lib
from tactuator.runtime.image import delta_coefficients_single, sealed

NEVER = 1.0e6
"""A limit in volts that no sensor reaches."""
NEVER_TICKS: int = lib.TACT_SAFETY_NEVER
"""A time that does not come."""


class Fault(IntEnum):
    """Faults that the guard latches (tact_fault)."""

    NONE = 0
    COMFORT = 1
    TRAVEL = 2
    SENSOR_OPEN = 3
    SENSOR_SHORTED = 4
    SENSOR_FROZEN = 5
    SENSOR_REVERSED = 6
    SENSOR_DISAGREES = 7
    SENSOR_STUCK = 8
    SENSOR_JUMPS = 9
    NOT_A_NUMBER = 10
    LATE = 11
    SILENCE = 12

    @property
    def words(self) -> str:
        """Return the fault in words for a person: "sensor frozen"."""
        return self.name.lower().replace("_", " ")


class SafetyRefusal(IntEnum):
    """Reasons for which the core refuses a table (tact_safety_refusal)."""

    GOOD = 0
    TRUNCATED = 1
    NOT_A_TABLE = 2
    VERSION_UNKNOWN = 3
    CHECKSUM = 4
    CHANNELS = 5
    NUMBER = 6

    def error(self) -> BadInput:
        """Return the refusal as an error."""
        words = self.name.lower().replace("_", " ")
        return BadInput(words, "what core/board/safety.h says", where=("safety table",))


@dataclass(frozen=True)
class StateObserver:
    """The plant under a zero-order hold with its correction, as guard.h draws it.

    x' = x + w' + correct_x nu, w' = w + drive (m + m_before) - damp w - spring x + correct_w nu, nu = y - x; x in
    volts of y, w in volts a tick, m in volts of command.
    """

    drive: float
    damp: float
    spring: float
    correct_x: float
    correct_w: float


@dataclass(frozen=True)
class Standstill:
    """The limits for a reading that stays within so many codes: it is stuck once the command since then should have
    moved the motor by stray_max_v (volts of y).
    """

    codes: int
    stray_max_v: float


@dataclass(frozen=True)
class Jump:
    """The change of the reading's motion, from one comparison to the next but one, that no force of a finger explains:
    least_v (volts of y) and a share of the motion's change by the plant's model.
    """

    least_v: float
    share: float


@dataclass(frozen=True, eq=False)
class ChannelSafety:
    """Limits, plant and weighting of one channel, in the order and units of core/board/safety.h.

    weighting_sos: (2, 6).
    """

    converter: Converter
    position_code_max: int
    frozen_ticks: int
    stop_max_v: float
    stop_lead: float
    command_max_v: float
    reference_max: float
    comfort_max: float
    disagreement_v: float
    reversal_power: float
    observer: StateObserver
    standstill: Standstill
    jump: Jump
    travel_max: float
    weighting_sos: FloatArray


@dataclass(frozen=True, eq=False)
class SafetyTable:
    """Of a whole board, in the order of core/board/safety.h.

    lateness_max: share of a period, up to 1; the ramps in ticks; each channel is compared (and weighed) every `turns`
    ticks; travel_share: of the reference into its slow part, a tick; lock_ticks: how long a sensor or travel fault
    keeps from a clear; lock_faults: how many of them keep from another run.
    """

    rate_hz: float
    delay_samples: int
    lateness_max: float
    silence_ticks: int
    soft_start_ticks: int
    fade_ticks: int
    ramp_ticks: int
    quick_ticks: int
    turns: int
    travel_share: float
    lock_ticks: int
    lock_faults: int
    channels: tuple[ChannelSafety, ...]


def safety_bytes(table: SafetyTable) -> bytes:
    """Return the table as a board takes it (core/board/safety.h). Raises BadInput for a delay that boards do not have
    (0), and if the core would refuse it.
    """
    if not 1 <= table.delay_samples <= lib.TACT_BOARD_DELAY_MAX:
        raise BadInput(f"{table.delay_samples}", f"1 to {lib.TACT_BOARD_DELAY_MAX} on a board", key="delay_samples")
    rate_hz, _, lateness_max, *ticks, _ = (getattr(table, field.name) for field in fields(table))
    lateness = max(1, min(255, round(256.0 * lateness_max)))
    body = struct.pack("<fiiiiiiifii", rate_hz, lateness, *ticks)
    body += b"".join(_channel_bytes(channel) for channel in table.channels)
    head = struct.pack("<4sHBBI", b"TACS", 2, len(table.channels), table.delay_samples, 12 + len(body) + 4)
    content = sealed(head + body)
    refusal = check_safety(content, len(table.channels))
    if refusal is not SafetyRefusal.GOOD:
        raise refusal.error()
    return content


def check_safety(content: bytes, channels_max: int) -> SafetyRefusal:
    """Return the core's own verdict on a table for a board of so many channels."""
    table = ffi.new("tact_safety *")
    return SafetyRefusal(lib.tact_safety_parse(table, ffi.from_buffer(content), len(content), channels_max))


def _channel_bytes(channel: ChannelSafety) -> bytes:
    converter = channel.converter
    if np.shape(channel.weighting_sos)[0] != lib.TACT_WEIGHTING_COUNT:
        raise BadInput(f"weighting has {len(channel.weighting_sos)} sections", f"{lib.TACT_WEIGHTING_COUNT}")
    sections = delta_coefficients_single(channel.weighting_sos, lib.TACT_WEIGHTING_COUNT, "weighting")
    numbers: list[float] = []
    for limit in (getattr(channel, field.name) for field in fields(channel)[1:-1]):
        numbers += astuple(limit) if isinstance(limit, StateObserver | Standstill | Jump) else (limit,)
    head = struct.pack("<iiff", converter.bits, converter.polarity, converter.range_v, converter.offset_v)
    return head + struct.pack("<ii12fi4f", *numbers) + sections.astype("<f4").tobytes()
