"""Frames of the link to a board: COBS, CRC-32, requests and outcomes (layouts: core/wire/frame.h, core/link/link.h)."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from enum import IntEnum

VERSION = 1
PAYLOAD_MAX = 4096
ANSWER = 0x80
_COBS_BLOCK_BYTES = 254


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
    PERIOD_CHECK = 0x30
    BENCH = 0x31
    TOUCH = 0x32
    BREAK = 0x33


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
