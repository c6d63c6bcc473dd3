"""Tables in memory, checked in turn: any bit that turns over is found; what changes by right is taken for none."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactuator.runtime._core import ffi, lib
from tests.rig.guard.guarded import Guarded, designed

ROUND = 4096
"""Words: more than all tables have."""


@pytest.fixture(scope="module")
def guarded() -> Guarded:
    return Guarded(designed())


def learnt(guarded: Guarded):
    tables = ffi.new("tact_tables *")
    lib.tact_tables_learn(tables, guarded.board)
    return tables


def is_whole(tables, guarded: Guarded) -> bool:
    """Whether two rounds, in stretches, find nothing."""
    return all(lib.tact_tables_check(tables, guarded.board, 60) for _ in range(2 * ROUND // 60))


def places(board) -> list[tuple[int, int]]:
    """Where tables lie in a board, from the declarations: offset and size."""
    found = [("safety", "image"), ("image", None)]
    spans = [(ffi.offsetof("tact_board", name), ffi.sizeof(f"tact_{name}")) for name, _ in found]
    for c in range(board.channels):
        at = ffi.offsetof("tact_board", "channel") + c * ffi.sizeof("tact_board_channel")
        for first, after in (("guard_table", "guard"), ("rest_code", "broken")):
            begin, end = (ffi.offsetof("tact_board_channel", name) for name in (first, after))
            spans.append((at + begin, end - begin))
    return spans


@given(data=st.data())
def test_tables__any_bit_turned_over__is_found_within_a_round(guarded, data):
    spans = places(guarded.board)
    offset, size = data.draw(st.sampled_from(spans))
    at = offset + data.draw(st.integers(0, size - 1))
    bit = 1 << data.draw(st.integers(0, 7))
    tables, memory = learnt(guarded), ffi.buffer(guarded.board)
    assert is_whole(tables, guarded)
    memory[at] = bytes([memory[at][0] ^ bit])
    try:
        assert not is_whole(tables, guarded)
    finally:
        memory[at] = bytes([memory[at][0] ^ bit])
    tables = learnt(guarded)
    assert is_whole(tables, guarded)


def test_tables__two_words_changed_places__are_found(guarded):
    tables = learnt(guarded)
    section = guarded.board.safety.channel[0]
    assert section.drive != section.damp
    section.drive, section.damp = section.damp, section.drive
    assert not is_whole(tables, guarded)
    section.drive, section.damp = section.damp, section.drive


def test_tables__a_run_with_its_states_and_faults__changes_none():
    guarded = Guarded(designed())
    tables = learnt(guarded)
    before = bytes(ffi.buffer(guarded.board))
    rows = np.full((900, 3), 40.0)
    for row in rows.astype(np.float32):
        lib.tact_board_stream(guarded.board, guarded.board.tick, ffi.from_buffer("float[]", row), 1)
        lib.tact_simulated_board_period(guarded.simulated, guarded.board, 0)
        assert lib.tact_tables_check(tables, guarded.board, 200)
    assert bytes(ffi.buffer(guarded.board)) != before


def test_tables__new_image__is_learnt_anew(guarded):
    tables = learnt(guarded)
    guarded.board.taken += 1
    guarded.board.image.crc ^= 1
    assert is_whole(tables, guarded)
    guarded.board.image.crc ^= 1
    assert not is_whole(tables, guarded)
