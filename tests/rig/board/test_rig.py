"""What every board does beyond every rig: the same bits, images, tables, faults."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.rig.board.link import Mode, RigFault
from tactuator.rig.open import emulated_rig, in_process_rig, open_rig, simulated_board_rig
from tactuator.rig.rig import join_traces
from tactuator.rig.simulated import SimulatedRig
from tactuator.rig.transport import LinkDown
from tests.rig.every_rig import BOARDS, begin, tones
from tests.rig.guard.guarded import designed


@pytest.fixture(scope="module", params=list(BOARDS))
def rig(request):
    with BOARDS[request.param](designed().display) as made:
        yield made


@pytest.fixture(scope="module")
def expected():
    with in_process_rig(designed().display, 1) as rig:
        rig.load(designed())
        return [rig.play(tones()), rig.play(tones(300))]


def test_rig__stream__is_bit_for_bit_what_the_blocks_are(rig, expected):
    begin(rig)
    blocks = np.array_split(np.concatenate([tones(), tones(300)]), 9)
    found = join_traces(rig.stream(iter(blocks)), rig.rate_hz, rig.channels)
    wanted = join_traces(expected, rig.rate_hz, rig.channels)
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


def test_rig__image_flipped__is_refused_and_the_loaded_one_stays(rig):
    begin(rig)
    before = rig.status().image_crc
    with pytest.raises(BadInput, match="image"):
        rig.load_image(b"TACI" + bytes(60))
    assert rig.status().image_crc == before


def test_rig__safety_table__outlives_other_images(rig):
    before = rig.status().safety_crc
    rig.load(designed())
    assert rig.status().safety_crc == before != 0


def test_open__names__give_rigs_or_say_what_is_allowed():
    display = designed().display
    assert isinstance(open_rig("simulated", display), SimulatedRig)
    with pytest.raises(BadInput, match="allowed: board, emulated, in-process, simulated, sound"):
        open_rig("toaster", display)
    for name in ("simulated", "in-process"):
        with pytest.raises(BadInput, match=f"{name}:x; allowed: {name}, with nothing behind it"):
            open_rig(f"{name}:x", display)
    with pytest.raises(BadInput, match="board: without a port; allowed: board:PORT"):
        open_rig("board", display)
    with pytest.raises(LinkDown, match="cannot be opened"):
        open_rig("board:no-such-port", display)
    with pytest.raises(BadInput, match="is none"):
        open_rig("board:nothing://known", display)
    with pytest.raises(BadInput, match="board 'x' is not known"):
        open_rig("emulated:x", display)


def test_emulator__missing__is_told_with_what_to_install(monkeypatch):
    monkeypatch.setattr("shutil.which", lambda name: None)
    with pytest.raises(BadInput, match="make install-boards"):
        emulated_rig("mps2-an500", designed().display)


def test_emulator__ends_on_its_own__is_told():
    from tactuator.rig.emulator import Emulator

    transport = Emulator("mps2-an500")
    rig = simulated_board_rig(transport, designed().display, 1, "float32")
    os.killpg(transport._process.pid, signal.SIGKILL)
    transport._process.wait()
    with pytest.raises(LinkDown, match="has ended"):
        rig.status()
    rig.close()


OPENED = """
import os, sys, time
from tactuator.rig.emulator import emulator
board = emulator(sys.argv[1])
print(os.getpid(), flush=True)
time.sleep(60)
"""


def emulators() -> set[int]:
    """Return the processes of this machine that emulate a board."""
    found = set()
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and b"qemu-system" in (entry / "cmdline").read_bytes().split(b"\0", 1)[0]:
                found.add(int(entry.name))
        except OSError:
            continue
    return found


def parent_of(process: int) -> int:
    return int(Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[1])


@pytest.mark.parametrize("board", ["mps2-an500", "stm32f405"])
def test_emulator__whoever_started_it_is_killed__ends_too(board: str) -> None:
    child = subprocess.Popen([sys.executable, "-c", OPENED, board], stdout=subprocess.PIPE)
    assert child.stdout is not None
    assert int(child.stdout.readline()) == child.pid
    (mine,) = [one for one in emulators() if parent_of(parent_of(one)) == child.pid]
    child.send_signal(signal.SIGKILL)
    child.wait()
    child.stdout.close()
    until = time.monotonic() + 20.0
    while mine in emulators() and time.monotonic() < until:
        time.sleep(0.05)
    assert mine not in emulators()
