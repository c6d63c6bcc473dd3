"""The host's end of the link: frames (COBS, CRC-32), requests that are repeated until they are answered, and what the
answers mean (layouts: core/wire/frame.h, core/link/link.h).
"""

from __future__ import annotations

import struct
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactuator.errors import BadInput, DeviceFault, TactuatorError
from tactuator.rig.transport import LinkDown, Transport
from tactuator.runtime._core import lib
from tactuator.runtime.image import ImageRefusal
from tactuator.runtime.safety_table import Fault, SafetyRefusal

VERSION, PAYLOAD_MAX, ANSWER = lib.TACT_LINK_VERSION, lib.TACT_PAYLOAD_MAX, lib.TACT_ANSWER
IMAGE, SAFETY, SIMULATED_DISPLAY = lib.TACT_UPLOAD_IMAGE, lib.TACT_UPLOAD_SAFETY, lib.TACT_UPLOAD_DISPLAY
SILENT, STREAM, STIMULUS = lib.TACT_SILENT, lib.TACT_STREAM, lib.TACT_STIMULUS
_COBS_BLOCK_BYTES = 254
"""The longest stretch without a zero that one code byte counts (Cheshire and Baker 1999)."""
_ANSWER_S, _TRIES = 2.0, 5
"""A frame of PAYLOAD_MAX takes 0.4 s at 115,200 baud; a link on which five in a row are lost carries no stream."""
_CHUNK_BYTES = 1024
"""Of an upload: a lost frame costs a quarter of the longest."""


class Request(IntEnum):
    """Requests that may be made of a board (tact_request)."""

    STATUS = 0x01
    UPLOAD = 0x02
    COMMIT = 0x03
    ARM = 0x10
    START = 0x11
    STOP = 0x12
    OFF = 0x13
    CLEAR = 0x14
    ACKNOWLEDGE = 0x15
    STREAM = 0x20
    STIMULUS = 0x21
    TRACE = 0x22
    WEIGHTS = 0x23
    TOUCH = 0x30
    BREAK = 0x31


class RequestOutcome(IntEnum):
    """Outcomes of a request that a board reports (tact_outcome)."""

    DONE = 0
    UNKNOWN_REQUEST = 1
    OTHER_VERSION = 2
    BAD_PAYLOAD = 3
    NOT_IN_THIS_MODE = 4
    REFUSED = 5
    OTHER_RUN = 6
    NOT_HERE = 7
    LOCKED = 8
    INCOMPLETE = 9


class Missing(IntFlag):
    """Parts that a board lacks (TACT_MISSING_...)."""

    CRYSTAL = 1
    AD = 2
    DA = 4
    SUPPLY = 8
    WATCHDOG = 16

    @property
    def words(self) -> str:
        """Return the parts for a person: "A/D converter, supply of 2.9 V"."""
        return ", ".join(_PARTS[part] for part in self)


_PARTS = {
    Missing.CRYSTAL: "crystal",
    Missing.AD: "A/D converter",
    Missing.DA: "D/A converter",
    Missing.SUPPLY: "supply of 2.9 V",
    Missing.WATCHDOG: "watchdog",
}


@dataclass(frozen=True)
class Frame:
    """One frame: type, sequence number, payload."""

    type: int
    sequence: int
    payload: bytes


def cobs_encode(content: bytes) -> bytes:
    """Return the content without zero bytes, and a zero behind it."""
    encoded = bytearray()
    for piece in content.split(b"\0"):
        while len(piece) >= _COBS_BLOCK_BYTES:
            encoded += b"\xff" + piece[:_COBS_BLOCK_BYTES]
            piece = piece[_COBS_BLOCK_BYTES:]
        encoded.append(len(piece) + 1)
        encoded += piece
    return bytes(encoded) + b"\0"


def cobs_decode(encoded: bytes) -> bytes | None:
    """Return the content of a frame (its closing zero taken off), or None where it is spoilt."""
    content = bytearray()
    at = 0
    while at < len(encoded):
        code = encoded[at]
        block = encoded[at + 1 : at + code]
        if code == 0 or len(block) != code - 1 or 0 in block:
            return None
        content += block
        at += code
        if code != _COBS_BLOCK_BYTES + 1 and at < len(encoded):
            content.append(0)
    return bytes(content)


def frame_bytes(frame: Frame) -> bytes:
    """Return the frame as it goes over the wire."""
    content = struct.pack("<BBH", VERSION, frame.type, frame.sequence) + frame.payload
    return cobs_encode(content + struct.pack("<I", zlib.crc32(content)))


def parse_frame(content: bytes) -> Frame | None:
    """Return the frame in decoded content, or None where its checksum, version or length is off."""
    if not 8 <= len(content) <= PAYLOAD_MAX + 8:
        return None
    (crc,) = struct.unpack_from("<I", content, len(content) - 4)
    version, kind, sequence = struct.unpack_from("<BBH", content)
    if crc != zlib.crc32(content[:-4]) or version != VERSION:
        return None
    return Frame(kind, sequence, content[4:-4])


class FrameReader:
    """Bytes as they come; frames as they are whole. What is spoilt is dropped, and counted; memory is bounded.

    begun: empty frames so far. A board sends one when it begins: what it was asked before, it has forgotten.
    """

    def __init__(self) -> None:
        self._pending = bytearray()
        self.dropped = self.begun = 0

    def feed(self, content: bytes) -> list[Frame]:
        """Return the frames that end within these bytes."""
        self._pending += content
        *ended, rest = self._pending.split(b"\0")
        self._pending = rest if len(rest) <= 2 * PAYLOAD_MAX else bytearray(b"\x01")
        frames = []
        for piece in ended:
            if not piece:
                self.begun += 1
                continue
            decoded = cobs_decode(bytes(piece))
            frame = None if decoded is None else parse_frame(decoded)
            if frame is None:
                self.dropped += 1
            else:
                frames.append(frame)
        return frames


class Mode(IntEnum):
    """States of a board (tact_board_mode)."""

    OFF = 0
    ARMED = 1
    RUNNING = 2
    FAULT = 3


class RigFault(DeviceFault):
    """The guard of a board has ended a run; the command is at zero, or on its way there."""

    def __init__(self, fault: Fault, channel: int) -> None:
        where = f", channel {channel}" if channel != 255 else ""
        super().__init__(f"the board's guard ended the run: {fault.words}{where}; its output is at rest")
        self.fault, self.channel = fault, channel


class RigLocked(DeviceFault):
    """Too many sensor or travel faults in a row: the board stays in OFF until they are acknowledged."""

    def __init__(self, faults: int) -> None:
        super().__init__(
            f"the board is locked after {faults} sensor or travel faults",
            "look at the sensor, then acknowledge them (`tactuator firmware acknowledge`)",
        )


class RigIncomplete(DeviceFault):
    """Something of the board is missing: its outputs stay safe."""

    def __init__(self, missing: Missing) -> None:
        super().__init__(
            f"the board lacks: {missing.words}", "the wiring of docs/porting.md; reset the board after a repair"
        )
        self.missing = missing


class LinkGarbled(DeviceFault):
    """A reply of a board has a valid checksum, but does not answer the request."""

    def __init__(self, request: Request) -> None:
        what = request.name.lower().replace("_", " ")
        super().__init__(f"unexpected reply to {what}", "a board that runs this firmware")


@contextmanager
def understood(request: Request) -> Iterator[None]:
    """Raise LinkGarbled where an answer to the request cannot be taken apart within."""
    try:
        yield
    except TactuatorError:
        raise
    except (ValueError, LookupError, struct.error):
        raise LinkGarbled(request) from None


@dataclass(frozen=True)
class Status:
    """Status that a board reports (core/link/report.h). cycles: the most that a step of this run took; 0 where nothing
    counts them.
    """

    name: str
    channels: int
    mode: Mode
    fault: Fault
    fault_channel: int
    at_rest: bool
    allows_hold: bool
    delay_samples: int
    rate_hz: float
    safety_crc: int
    image_crc: int
    wired_crc: int
    stream_capacity: int
    trace_capacity: int
    run: int
    tick: int
    ticks: int
    late: int
    stream_end: int
    heard: int
    dropped: int
    fault_tick: int
    sensor_faults: int
    acknowledged: int
    locked_ticks: int
    cycles: int
    missing: Missing

    LAYOUT = struct.Struct("<16s7Bf18I")

    def require_no_fault(self) -> None:
        """Raise RigFault where the guard has ended the run."""
        if self.mode is Mode.FAULT:
            raise RigFault(self.fault, self.fault_channel)

    @classmethod
    def parse(cls, payload: bytes) -> Status:
        """Return the status that an answer to STATUS holds."""
        name, channels, mode, fault, where, rest, hold, *rest_of = cls.LAYOUT.unpack(payload)
        text = name.rstrip(b"\0").decode("ascii", "replace")
        values: list[Any] = [bool(rest), bool(hold), *rest_of[:-1], Missing(rest_of[-1])]
        return cls(text, channels, Mode(mode), Fault(fault), where, *values)


@dataclass(frozen=True)
class TraceRows:
    """Rows of a board's trace: codes and flags (n, channels); felt_mm where it was asked for."""

    command_code: NDArray[np.int32]
    flags: NDArray[np.uint8]
    position_code: NDArray[np.int32]
    felt_mm: NDArray[np.float32] | None


class LinkClient:
    """Requests over a transport. Each is sent again until its answer comes, and at once where the board begins anew;
    all may be carried out twice.
    """

    def __init__(
        self,
        transport: Transport,
        answer_s: float = _ANSWER_S,
        tries: int = _TRIES,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._transport = transport
        self._reader = FrameReader()
        self._sequence = 0
        self._answer_s, self._tries, self._clock = answer_s, tries, clock

    @property
    def dropped(self) -> int:
        """Return the number of spoilt frames that came from the board."""
        return self._reader.dropped

    def close(self) -> None:
        """Close the transport of the link."""
        self._transport.close()

    def ask(self, request: Request, payload: bytes = b"") -> tuple[RequestOutcome, bytes]:
        """Send a request; return its outcome, and what the answer holds besides. Raises LinkDown if no answer comes."""
        self._sequence = (self._sequence + 1) & 0xFFFF
        frame = frame_bytes(Frame(request, self._sequence, payload))
        begun: int | None = self._reader.begun
        for _ in range(self._tries):
            self._transport.send(frame)
            answer = self._answer(request, self._answer_s, begun)
            begun = None  # once: a port that chatters is no board that begins
            if answer is not None:
                with understood(request):
                    return RequestOutcome(answer.payload[0]), answer.payload[1:]
        words = f"the board does not answer ({request.name.lower()})"
        raise LinkDown(words, "a board that runs the firmware, at its baud rate (PORT@BAUD)")

    def _answer(self, request: Request, timeout_s: float, begun: int | None) -> Frame | None:
        """Return the answer; None where none comes in time, or where the board has begun after `begun` times."""
        end_s = self._clock() + timeout_s  # a port that chatters is no answer
        while True:
            content = self._transport.receive(max(end_s - self._clock(), 0.0))
            if not content:
                return None
            for frame in self._reader.feed(content):
                if (frame.type, frame.sequence) == (request | ANSWER, self._sequence) and frame.payload:
                    return frame
            if self._clock() > end_s or (begun is not None and self._reader.begun > begun):
                return None

    def must(self, request: Request, payload: bytes = b"") -> bytes:
        """Send a request as `ask` does; raises RigFault or BadInput unless it was done."""
        outcome, rest = self.ask(request, payload)
        if outcome is RequestOutcome.DONE:
            return rest
        status = self.status()
        status.require_no_fault()
        if outcome is RequestOutcome.LOCKED:
            raise RigLocked(status.sensor_faults - status.acknowledged)
        if outcome is RequestOutcome.INCOMPLETE:
            raise RigIncomplete(status.missing)
        what, how = request.name.lower(), outcome.name.lower().replace("_", " ")
        raise BadInput(f"the board refused to {what}: {how}; it is {status.mode.name}")

    def status(self) -> Status:
        """Return the status that the board reports."""
        outcome, payload = self.ask(Request.STATUS)
        if outcome is not RequestOutcome.DONE or len(payload) != Status.LAYOUT.size:
            raise BadInput(f"the board's link is of another version ({outcome.name.lower()})", "version 1")
        with understood(Request.STATUS):
            return Status.parse(payload)

    def acknowledge(self) -> int:
        """Acknowledge the board's sensor and travel faults; return how many there were since its start."""
        count = self.status().sensor_faults
        self.must(Request.ACKNOWLEDGE, struct.pack("<I", count))
        return count

    def upload(self, kind: int, content: bytes) -> None:
        """Bring an image, a table or a simulated display onto the board. BadInput, with the reason, if refused."""
        for at in range(0, len(content), _CHUNK_BYTES):
            self.must(Request.UPLOAD, struct.pack("<BI", kind, at) + content[at : at + _CHUNK_BYTES])
        crc = zlib.crc32(content[:-4])
        outcome, answer = self.ask(Request.COMMIT, struct.pack("<BII", kind, len(content), crc))
        if outcome is RequestOutcome.DONE:
            return
        if outcome is RequestOutcome.REFUSED:
            with understood(Request.COMMIT):
                raise _refusal(kind, answer[0])
        if outcome is RequestOutcome.BAD_PAYLOAD:
            raise ImageRefusal.CHECKSUM.error("image")
        raise BadInput("the board takes no image or table now", "in OFF, and an image after its safety table")

    def start(self, run: int, source: int, drives: bool, holds: bool) -> None:
        """Bring the board from ARMED to RUNNING."""
        self.must(Request.START, struct.pack("<IBBB", run, source, drives, holds))

    def stream(
        self, run: int, first: int, rows: NDArray[np.float32], forces: NDArray[np.float32] | None
    ) -> tuple[int, int]:
        """Send rows (n, channels) for the ticks from `first` on; the tick to which the board has them, and its own."""
        both = rows if forces is None else np.concatenate([rows, forces], axis=1)
        most = (PAYLOAD_MAX - 11) // (4 * both.shape[1])
        part = both[:most].astype("<f4")
        with understood(Request.STREAM):  # `first` follows from what the board said of itself
            head = struct.pack("<IIHB", run, first, part.shape[0], forces is not None)
            end, tick = struct.unpack("<II", self.must(Request.STREAM, head + part.tobytes()))
        return end, tick

    def trace(self, run: int, first: int, count: int, channels: int, felt: bool) -> TraceRows:
        """Return the rows that the board has from `first` on, at most `count`."""
        with understood(Request.TRACE):
            answer = self.must(Request.TRACE, struct.pack("<IIHB", run, first, min(count, 0xFFFF), felt))
            begun, rows = struct.unpack_from("<IH", answer)
            table = np.frombuffer(answer, dtype="<i4", offset=6).reshape(rows, channels * (3 if felt else 2))
        if begun != first or rows > count:
            raise LinkGarbled(Request.TRACE)
        command = table[:, :channels]
        felt_mm = table[:, 2 * channels :].copy().view(np.float32) if felt else None
        flags = ((command >> 24) & 0xFF).astype(np.uint8)
        return TraceRows((command << 8) >> 8, flags, table[:, channels : 2 * channels].copy(), felt_mm)


def _refusal(kind: int, code: int) -> BadInput:
    if kind == IMAGE:
        return ImageRefusal(code).error("image")
    if kind == SAFETY:
        return SafetyRefusal(code).error()
    return BadInput(
        "the board cannot hold it", "as many channels as the safety table has", where=("simulated display",)
    )
