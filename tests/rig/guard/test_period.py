"""A board's period against the controller itself: pieces made for one form of controller answer as any other would."""

from dataclasses import replace

import numpy as np
import pytest

from tactuator.runtime._core import ffi, lib
from tests.rig.guard.guarded import Guarded, designed, spoilt

SOFT = 410
LEFT = 1e-29
"""What an hour of silence leaves of a prefilter's states, a little before it comes to rest."""


def uncommon(controller):
    """The same controllers in a form that has no piece of its own: C's last gain is not 1, but its first makes up."""
    channels = []
    for channel in controller.channels:
        sections = np.array(channel.feedback_sos)
        sections[0, :3] *= 2.0
        sections[2, :3] *= 0.5
        channels.append(replace(channel, feedback_sos=sections))
    return replace(controller, channels=tuple(channels))


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


@pytest.mark.parametrize("controller", [designed(), uncommon(designed())], ids=["designed", "uncommon"])
def test_period__tones_and_silence__commands_are_the_controllers_to_the_bit(controller):
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
    found, wanted = answers(guarded, np.zeros((9000, 3)), LEFT)
    assert np.array_equal(found, wanted)
    for c in range(3):
        for section in guarded.board.channel[c].controller.single.prefilter[0:2]:
            assert (section.s1, section.s2) == (0.0, 0.0)
