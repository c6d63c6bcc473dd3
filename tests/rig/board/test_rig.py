"""What every board does beyond every rig: bits, images, tables, faults; tones that it makes, against streamed ones."""

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.rig.board.link import STIMULUS, Mode, RigFault
from tactuator.rig.board.stream import TONES_MAX, BoardTone
from tactuator.rig.open import in_process_rig, open_rig
from tactuator.rig.rig import join_traces
from tactuator.rig.simulated import SimulatedRig
from tactuator.rig.transport import LinkDown
from tactuator.runtime._core import lib
from tests.firmware.emulator import emulated_rig
from tests.rig.every_rig import BOARDS, begin, tones
from tests.rig.guard.guarded import Guarded, designed


@pytest.fixture(scope="module", params=["in-process", "lossy", "emulated:mps2-an500"])
def rig(request):
    with BOARDS[request.param](designed().display) as made:
        yield made


def test_rig__stream__is_bit_for_bit_what_the_blocks_are(rig):
    with in_process_rig(designed().display, 1) as plain:
        plain.load(designed())
        expected = [plain.play(tones()), plain.play(tones(300))]
    begin(rig)
    blocks = np.array_split(np.concatenate([tones(), tones(300)]), 9)
    found, wanted = (join_traces(each, rig.rate_hz, rig.channels) for each in (rig.stream(iter(blocks)), expected))
    assert found.equals(wanted)


def test_rig__stream_left_early__goes_on_in_the_next(rig):
    begin(rig)
    next(rig.stream(tones(200) for _ in range(20)))
    assert len(rig.play(tones(100))) == 100
    assert rig.status().mode is Mode.RUNNING


def test_rig__sensor_fails__raises_and_is_cleared_by_the_next_load(rig):
    begin(rig)
    rig.play(tones(200))
    rig.break_sensor("thumb", "open")
    with pytest.raises(RigFault, match="sensor open"):
        rig.play(tones(300))
    assert rig.status().mode is Mode.FAULT
    rig.break_sensor("thumb", "sound")
    rig.load(designed())
    assert np.max(np.abs(rig.play(tones(400)).position_v)) > 0.05


def test_rig__another_display_wired_after_a_motion__is_no_fault(rig):
    rig.drive(np.tile(0.4 * np.sin(2.0 * np.pi * np.arange(500) / 4000.0)[:, None], (1, 3)))
    begin(rig)
    assert len(rig.play(np.zeros((300, 3)))) == 300


def test_rig__image_refused__changes_nothing_and_the_safety_table_stays(rig):
    begin(rig)
    before = rig.status()
    with pytest.raises(BadInput, match="image"):
        rig.load_image(b"TACI" + bytes(60))
    assert rig.status().image_crc == before.image_crc
    rig.load(designed())
    assert rig.status().safety_crc == before.safety_crc != 0


def test_open__names__give_rigs_or_say_what_is_allowed():
    assert isinstance(open_rig("simulated", designed().display), SimulatedRig)
    for name, error, words in (
        ("toaster", BadInput, "board, in-process, simulated, sound"),
        ("simulated:x", BadInput, "simulated:x; expected simulated, with nothing behind it"),
        ("in-process:x", BadInput, "in-process:x; expected in-process, with nothing behind it"),
        ("board", BadInput, "board: without a port; expected board:PORT"),
        ("board:no-such-port", LinkDown, "there is no serial port 'no-such-port'; expected .*socket://host:port$"),
        ("board:nothing://known", BadInput, "is none"),
        ("board:socket://127.0.0.1:0", BadInput, "a port from 1 to 65535"),
        ("board:socket://nowhere", BadInput, "socket://host:port"),
        ("board:/dev/null@fast", BadInput, "baud rate 'fast'"),
        ("board:socket://127.0.0.1:1", LinkDown, "one where a board listens"),
    ):
        with pytest.raises(error, match=words):
            open_rig(name, designed().display)


TRIAL = {
    "index": (BoardTone(40.0, 100.0, 0.05, 0.2), BoardTone(40.0, 50.0, 0.35, 0.2, 0.02)),
    "middle": (BoardTone(200.0, 30.0, 0.0, 0.5), BoardTone(7.0, 80.0, 0.0, 0.5, 0.1)),
}
RIGS = {
    "in-process": lambda display: in_process_rig(display, 1),
    "emulated": lambda display: emulated_rig("mps2-an500", display, 1),
}


@pytest.fixture(scope="module", params=RIGS.values(), ids=RIGS)
def toned(request):
    with request.param(designed().display) as made:
        made.load(designed())
        yield made


def test_play_tones__a_trial__moves_as_the_same_tones_streamed(toned):
    felt = []
    toned.finger("index").attach(felt.append)
    made = toned.play_tones(TRIAL, 0.6)
    toned.finger("index").detach(felt.append)
    assert toned.status().mode is Mode.ARMED
    assert made.reference.shape == (2400, 3)
    assert not made.reference[:, 1].any()
    assert np.concatenate(felt).size == 2400
    toned.load(designed())
    streamed = toned.play(made.reference)
    noise = 6e-3  # hum and noise of two runs
    assert np.max(np.abs(made.position_v - streamed.position_v)) < noise
    assert np.max(np.abs(made.position_v[:, 0])) > 10.0 * noise


def test_play_tones__guard_ends_the_run__is_a_fault_and_rests(toned):
    toned.break_sensor("thumb", "open")
    with pytest.raises(RigFault, match=r"sensor open|travel"):
        toned.play_tones(TRIAL, 0.5)
    assert toned.status().at_rest
    toned.break_sensor("thumb", "sound")
    toned.load(designed())


@pytest.mark.parametrize(
    ("tones", "words"),
    [
        ({"toe": ()}, "no channel 'toe'; expected index, thumb, middle"),
        ({"index": (BoardTone(2000.0, 1.0, 0.0, 0.2),)}, "2000 Hz; expected below 2000 Hz on this board"),
        ({"index": (BoardTone(20.0, 1.0, 0.0, 0.2),) * (TONES_MAX + 1)}, "9 tones on channel 'index'"),
    ],
)
def test_play_tones__what_the_board_does_not_take__is_refused_before_anything_moves(toned, tones, words):
    with pytest.raises(BadInput, match=words):
        toned.play_tones(tones, 0.1)
    for seconds in (np.nan, np.inf, -1.0, 1e9):
        with pytest.raises(BadInput, match="tones for"):
            toned.play_tones({}, seconds)
    assert toned.status().mode is not Mode.RUNNING


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
