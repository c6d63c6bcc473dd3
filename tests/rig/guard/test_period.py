"""A board's period against the controller itself: pieces made for one form of controller answer as any other would."""

import numpy as np
import pytest

from tactuator.runtime._core import ffi, lib
from tests.rig.guard.guarded import Guarded, adaptive, designed, spoilt, uncommon

SOFT = 410
CLIPPED_V = 0.02
LEFT = 1e-29
"""What an hour of silence leaves of a prefilter's states, a little before it comes to rest."""


def answers(guarded, rows, left=0.0):
    """What the board put into its queue at every tick, and what the controllers say; until it is in a fault. left: in
    all states of the prefilters to begin with."""
    board, simulated = guarded.board, guarded.simulated
    states = [ffi.new("tact_controller_state *") for _ in range(3)]
    for c, state in enumerate(states):
        lib.tact_controller_reset(state)
        for one in (state, board.channel[c].controller.single):
            for section in one.prefilter[0:2]:
                section.s1 = section.s2 = left
    found, wanted = [], []
    for row in np.asarray(rows, dtype=np.float32):
        fade, command_fade, slot = np.float32(board.fade), np.float32(board.command_fade), board.delay_at
        lib.tact_board_stream(board, board.tick, ffi.from_buffer("float[]", np.ascontiguousarray(row)), 1)
        board.silence = 0
        lib.tact_simulated_board_period(simulated, board, 0)
        for c, state in enumerate(states):
            safety, channel = board.safety.channel[c], board.channel[c]
            most = np.float32(safety.reference_max)
            reference = fade * np.clip(row[c], -most, most)
            position_v = lib.tact_converter_position_v(ffi.addressof(safety.converter), simulated.code[c])
            command_v = lib.tact_controller_step(channel.single, state, reference, position_v)
            found.append(channel.delayed_v[slot])
            wanted.append(float(command_fade * np.float32(command_v)))
        if board.mode != lib.TACT_RUNNING:
            break
    return np.array(found), np.array(wanted)


@pytest.mark.parametrize("made", [designed, lambda: uncommon(designed())], ids=["designed", "uncommon"])
def test_period__tones_and_silence__commands_are_the_controllers_to_the_bit(made):
    controller = made()
    guarded = Guarded(controller)
    assert guarded.board.is_designed == (controller is designed())
    time_s = np.arange(SOFT + 1500) / 4000.0
    rows = np.stack([150.0 * np.sin(2.0 * np.pi * f * time_s) for f in (3.0, 31.0, 187.0)], axis=1)
    rows[SOFT + 700 : SOFT + 900] = 0.0
    found, wanted = answers(guarded, rows)
    assert guarded.board.mode == lib.TACT_RUNNING
    assert np.array_equal(found, wanted)


def test_period__commands_beyond_their_limits__are_limited_as_the_controllers_are():
    guarded = Guarded(spoilt(designed(), 3.0))
    found, wanted = answers(guarded, np.full((SOFT, 3), 1e9) * np.sign(np.sin(np.arange(SOFT) * 2.5))[:, None])
    assert any(guarded.board.channel[c].controller.single.clamped for c in range(3))
    before = slice(0, found.size - 3)  # a fault's own tick empties the queue
    assert np.array_equal(found[before], wanted[before])


def test_period__long_silence__brings_prefilters_to_rest_as_the_controllers_are():
    guarded = Guarded(designed())
    found, wanted = answers(guarded, np.zeros((30_000, 3)), LEFT)  # a prefilter's slowest pole may lie at 0.3 Hz
    assert np.array_equal(found, wanted)
    for c in range(3):
        for section in guarded.board.channel[c].controller.single.prefilter[0:2]:
            assert (section.s1, section.s2) == (0.0, 0.0)


def whole(board):
    """Everything that a board holds but the marks themselves, and the row of its trace that was written last."""
    marked, board.steady, board.steady_adaptive = (board.steady, board.steady_adaptive), 0, 0
    row = ((board.tick - 1) & (board.trace_capacity - 1)) * 6
    held = bytes(ffi.buffer(board)), [board.trace[row + i] for i in range(6)]
    board.steady, board.steady_adaptive = marked
    return held


def step_both_ways(board, codes, lateness):
    """A step of the period, taken as it comes and then again without the short way: 1 if it was short."""
    before, was_steady = bytes(ffi.buffer(board)), board.steady + board.steady_adaptive
    board.steady = board.steady_adaptive = 0
    lib.tact_period_step(board, codes, lateness)
    wanted = whole(board)
    ffi.buffer(board)[:] = before
    lib.tact_period_step(board, codes, lateness)
    assert whole(board) == wanted
    return was_steady


HAPPENS = {
    "nothing": lambda guarded: None,
    "stop": lambda guarded: guarded.leave(),
    "sensor opens": lambda guarded: guarded.break_sensor("open", 1),
    "sensor reversed": lambda guarded: guarded.break_sensor("reversed", 2),
    "finger": lambda guarded: guarded.touch(True),
}


@pytest.mark.parametrize("made", [designed, adaptive])
@pytest.mark.parametrize("happens", [*HAPPENS, "late", "silent", "dry", "clipped"])
def test_period__short_way_of_a_steady_run__is_the_long_way_to_the_bit(happens, made):
    """The long way is held to the controllers above, and to the boards; the short way to the long one."""
    guarded = Guarded(made())
    assert guarded.board.is_adaptive == (made is adaptive)
    board, simulated, codes = guarded.board, guarded.simulated, ffi.new("int32_t[4]")
    if happens == "clipped":
        for channel in (board.channel[c] for c in range(3)):
            channel.command_max_v = channel.single.command_max_v = CLIPPED_V
            channel.single.command_min_v = -CLIPPED_V
    time_s = np.arange(SOFT + 900) / 4000.0
    rows = np.stack([150.0 * np.sin(2.0 * np.pi * f * time_s) for f in (3.0, 31.0, 187.0)], axis=1).astype(np.float32)
    short = 0
    for k, row in enumerate(rows):
        if k == SOFT + 200:
            HAPPENS.get(happens, HAPPENS["nothing"])(guarded)
        now = k > SOFT + 200
        if not (now and happens == "dry"):
            lib.tact_board_stream(board, board.tick, ffi.from_buffer("float[]", np.ascontiguousarray(row)), 1)
        if not (now and happens == "silent"):
            board.silence = 0
        lib.tact_period_latch(board, codes)
        lib.tact_simulated_board_latch(simulated, codes)
        lib.tact_simulated_board_read(simulated, codes)
        short += step_both_ways(board, codes, 200 if now and happens == "late" else 0)
        lib.tact_simulated_board_advance(simulated)
    assert short > 150
    assert happens != "clipped" or all(board.channel[c].controller.single.clamped for c in range(1, 3))
