"""The emulator as a process: it ends with whoever started it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tactuator.rig.emulator import Emulator
from tactuator.rig.transport import LinkDown

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


def test_emulator__ends_by_itself__is_told() -> None:
    board = Emulator("mps2-an500")
    try:
        (mine,) = [one for one in emulators() if parent_of(parent_of(one)) == os.getpid()]
        os.kill(mine, signal.SIGKILL)
        with pytest.raises(LinkDown):
            for _ in range(1000):
                board.send(b"\0" * 64)
                board.receive(0.1)
    finally:
        board.close()
