"""Tones that a board makes itself, against the same tones streamed to it."""

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.rig.board.link import STIMULUS, Mode, RigFault
from tactuator.rig.board.stream import TONES_MAX, BoardTone
from tactuator.rig.open import emulated_rig, in_process_rig
from tactuator.runtime._core import lib
from tests.rig.guard.guarded import Guarded, designed

TRIAL = {
    "index": (BoardTone(40.0, 100.0, 0.05, 0.2), BoardTone(40.0, 50.0, 0.35, 0.2, 0.02)),
    "middle": (BoardTone(200.0, 30.0, 0.0, 0.5), BoardTone(7.0, 80.0, 0.0, 0.5, 0.1)),
}
RIGS = {
    "in-process": lambda display: in_process_rig(display, 1),
    "emulated": lambda display: emulated_rig("mps2-an500", display, 1),
}


@pytest.fixture(scope="module", params=RIGS.values(), ids=RIGS)
def rig(request):
    with request.param(designed().display) as made:
        made.load(designed())
        yield made


def test_play_tones__a_trial__moves_as_the_same_tones_streamed(rig):
    felt = []
    rig.finger("index").attach(felt.append)
    made = rig.play_tones(TRIAL, 0.6)
    rig.finger("index").detach(felt.append)
    assert rig.status().mode is Mode.ARMED
    assert made.reference.shape == (2400, 3)
    assert not made.reference[:, 1].any()
    assert np.concatenate(felt).size == 2400
    rig.load(designed())
    streamed = rig.play(made.reference)
    noise = 6e-3  # hum and noise of two runs
    assert np.max(np.abs(made.position_v - streamed.position_v)) < noise
    assert np.max(np.abs(made.position_v[:, 0])) > 10.0 * noise


def test_play_tones__then_others_then_again__each_run_is_whole_and_silence_is_silent(rig):
    first = rig.play_tones(TRIAL, 0.3)
    assert not rig.play_tones({}, 0.05).reference.any()
    again = rig.play_tones(TRIAL, 0.3)
    assert np.array_equal(first.reference, again.reference)
    assert np.max(np.abs(first.position_v - again.position_v)) < 6e-3


def test_play_tones__guard_ends_the_run__is_a_fault_and_rests(rig):
    rig.break_sensor("thumb", "open")
    with pytest.raises(RigFault, match=r"sensor open|travel"):
        rig.play_tones(TRIAL, 0.5)
    assert rig.status().at_rest
    rig.break_sensor("thumb", "sound")
    rig.load(designed())


@pytest.mark.parametrize(
    ("tones", "words"),
    [
        ({"toe": ()}, "channel 'toe' is not there; allowed: index, thumb, middle"),
        ({"index": (BoardTone(2000.0, 1.0, 0.0, 0.2),)}, "2000 Hz; allowed: below 2000 Hz on this board"),
        ({"index": (BoardTone(20.0, 1.0, 0.0, 0.2),) * (TONES_MAX + 1)}, "9 tones on channel 'index'"),
    ],
)
def test_play_tones__what_the_board_does_not_take__is_refused_before_anything_moves(rig, tones, words):
    with pytest.raises(BadInput, match=words):
        rig.play_tones(tones, 0.1)
    for seconds in (np.nan, np.inf, -1.0, 1e9):
        with pytest.raises(BadInput, match="tones for"):
            rig.play_tones({}, seconds)
    assert rig.status().mode is not Mode.RUNNING


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ((0.0, 1.0, 0.0, 1.0), "above 0 Hz"),
        ((10.0, np.nan, 0.0, 1.0), "at most 1000"),
        ((10.0, 1001.0, 0.0, 1.0), "at most 1000"),
        ((10.0, 1.0, -1.0, 1.0), "tone from .* from 0 s on"),
        ((10.0, 1.0, np.nan, 1.0), "tone from"),
        ((10.0, 1.0, 1e9, 1.0), "tone from"),
        ((10.0, 1.0, 0.0, 0.05), "at most half of it"),
    ],
)
def test_board_tone__amiss__is_refused(numbers, words):
    with pytest.raises(BadInput, match=words):
        BoardTone(*numbers)


def test_play_tones__main_loop_late__tones_stay_at_their_ticks() -> None:
    """Samples that are made too late are left out, those after them are where they belong."""
    made = []
    for pause in (0, 50):
        guarded = Guarded(designed())
        board = guarded.board
        lib.tact_board_stop(board)
        guarded.run(np.zeros((800, 3)))
        for channel in range(3):
            stimulus = board.stimulus[channel]
            stimulus.count, tone = 1, stimulus.tone[0]
            tone.start, tone.length, tone.ramp, tone.amplitude = 0, 4000, 0, 50.0
            tone.cosine, tone.sine, tone.ramp_cosine, tone.ramp_sine = np.cos(0.1), np.sin(0.1), 1.0, 0.0
        assert lib.tact_board_start(board, board.run + 1, STIMULUS, 0, 0)
        board.tick = pause  # as many ticks have passed without the main loop
        lib.tact_board_give_tones(board)
        made.append([board.stream[(tick & (board.stream_capacity - 1)) * 3] for tick in range(50, 60)])
        if not pause:
            for tick in range(60):
                board.tick = tick
                lib.tact_board_give_tones(board)
            made[0] = [board.stream[(tick & (board.stream_capacity - 1)) * 3] for tick in range(50, 60)]
    assert made[0] == made[1]
    assert np.allclose(made[1], 50.0 * np.sin(0.1 * np.arange(50, 60)), atol=1e-3)
