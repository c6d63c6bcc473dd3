"""What every board does beyond every rig: the same bits, images, tables, faults."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.rig.board.link import Mode, RigFault
from tactuator.rig.emulator import Emulator
from tactuator.rig.open import in_process_rig, open_rig, simulated_board_rig
from tactuator.rig.rig import join_traces
from tactuator.rig.simulated import SimulatedRig
from tactuator.rig.transport import LinkDown
from tests.rig.every_rig import BOARDS, begin, tones
from tests.rig.guard.guarded import designed


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


def test_rig__another_image_flipped_or_whole__the_safety_table_stays_and_what_is_refused_changes_nothing(rig):
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
        ("toaster", BadInput, "allowed: board, emulated, in-process, simulated, sound"),
        ("simulated:x", BadInput, "simulated:x; allowed: simulated, with nothing behind it"),
        ("in-process:x", BadInput, "in-process:x; allowed: in-process, with nothing behind it"),
        ("board", BadInput, "board: without a port; allowed: board:PORT"),
        ("board:no-such-port", LinkDown, "cannot be opened"),
        ("board:nothing://known", BadInput, "is none"),
        ("board:socket://127.0.0.1:0", BadInput, "a port from 1 to 65535"),
        ("board:socket://nowhere", BadInput, "socket://host:port"),
        ("board:/dev/null@fast", BadInput, "baud rate 'fast'"),
        ("board:socket://127.0.0.1:1", LinkDown, "one where a board listens"),
        ("emulated:x", BadInput, "board 'x' is not known"),
    ):
        with pytest.raises(error, match=words):
            open_rig(name, designed().display)


def test_emulator__ends_on_its_own__is_told():
    transport = Emulator("mps2-an500")
    rig = simulated_board_rig(transport, designed().display, 1, "float32")
    os.killpg(transport._process.pid, signal.SIGKILL)
    transport._process.wait()
    with pytest.raises(LinkDown, match="has ended"):
        rig.status()
    rig.close()


OPENED = """
import time
from tactuator.rig.emulator import emulator
print(emulator("mps2-an500")._process.pid, flush=True)
time.sleep(60)
"""


def test_emulator__whoever_started_it_is_killed__ends_too() -> None:
    with subprocess.Popen([sys.executable, "-c", OPENED], stdout=subprocess.PIPE) as child:
        group = int(child.stdout.readline())
        os.killpg(group, 0)
        child.kill()
    until = time.monotonic() + 20.0
    with pytest.raises(ProcessLookupError):
        while time.monotonic() < until:
            os.killpg(group, 0)
            time.sleep(0.05)
