"""The link's frames: Python's codec and the core's are two, written apart; each undoes the other."""

import zlib

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tactuator.rig.board.link import Frame, FrameReader, cobs_decode, cobs_encode, frame_bytes, parse_frame
from tactuator.runtime._core import ffi, lib

contents = st.binary(max_size=1200) | st.integers(0, 1100).map(lambda size: b"\x01" * size)


def core_encode(content: bytes) -> bytes:
    out = ffi.new("uint8_t[]", len(content) + len(content) // 254 + 2)
    size = lib.tact_cobs_encode(ffi.from_buffer(content), len(content), out, len(out))
    return bytes(ffi.buffer(out, size))


def core_decode(wire: bytes, capacity: int = 4096) -> list[bytes]:
    buffer, cobs, frames = ffi.new("uint8_t[]", capacity), ffi.new("tact_cobs *"), []
    cobs.buffer, cobs.capacity, cobs.done = buffer, capacity, 1
    for byte in wire:
        if lib.tact_cobs_receive(cobs, byte) > 0:
            frames.append(bytes(ffi.buffer(buffer, cobs.length)))
    return frames


def test_cobs__published_example__is_encoded_so():
    assert cobs_encode(b"\x11\x22\x00\x33") == bytes([3, 0x11, 0x22, 2, 0x33, 0])


@given(contents)
def test_cobs__any_content__survives_both_ways(content):
    assert cobs_decode(cobs_encode(content)[:-1]) == content
    assert cobs_decode(core_encode(content)[:-1]) == content
    assert core_decode(cobs_encode(content)) == [content] or content == b""
    assert 0 not in cobs_encode(content)[:-1]


@given(st.binary(max_size=300))
def test_crc32__any_bytes__is_zlibs(content):
    assert lib.tact_crc32(0, ffi.from_buffer(content), len(content)) == zlib.crc32(content)


@given(st.binary(max_size=200), st.lists(st.binary(max_size=60), max_size=4))
@settings(max_examples=60)
def test_reader__garbage_before_frames__finds_its_place_again(garbage, payloads):
    reader = FrameReader()
    reader.feed(garbage + b"\0")
    wire = b"".join(frame_bytes(Frame(1, index, payload)) for index, payload in enumerate(payloads))
    found = [frame for at in range(0, len(wire), 7) for frame in reader.feed(wire[at : at + 7])]
    assert [frame.payload for frame in found] == payloads


@given(st.binary(min_size=1, max_size=64), st.integers(0, 10_000), st.integers(0, 7))
def test_frame__one_bit_flipped__is_dropped(payload, place, bit):
    content = bytearray(cobs_decode(frame_bytes(Frame(5, 77, payload))[:-1]))
    content[place % len(content)] ^= 1 << bit
    assert parse_frame(bytes(content)) is None


def test_reader__no_zero_ever__keeps_its_memory_bounded():
    reader = FrameReader()
    for _ in range(100):
        reader.feed(bytes(np.full(1000, 7, dtype=np.uint8)))
    assert len(reader._pending) <= 2 * 4096 + 1000
