"""Boards in the emulator that are reached as real ones are: at a port of this machine.

Their time goes on while this machine is busy. What comes too late then is not judged: the test is skipped, if by the
system's own count the host or the emulator had no processor.
"""

import re
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from unittest.mock import patch

import pytest

from tactuator.rig.board.link import RigFault
from tactuator.rig.board.stream import StreamDry
from tactuator.rig.transport import LinkDown
from tests.firmware.emulator import MACHINES, emulator_command

BOARD = "mps2-an500"
ANSWER_S = 10.0
"""Of an emulator that shares this machine; a real board answers within one."""
STARVED_SHARE = 0.05


@contextmanager
def judged(*processes: int) -> Iterator[None]:
    """Skip the test where its board was too late and this thread, or a process, had waited for a processor."""
    begun_s, waited_s = time.monotonic(), _waited_s(processes)
    try:
        yield
    except (StreamDry, LinkDown, RigFault) as error:
        share = (_waited_s(processes) - waited_s) / (time.monotonic() - begun_s)
        if share < STARVED_SHARE:
            raise
        pytest.skip(f"not judged: {error}; host and emulator had waited {100.0 * share:.0f} %")


def _waited_s(processes: tuple[int, ...]) -> float:
    """Seconds in which the threads were ready and had no processor, as far as the system tells."""
    waited_ns = 0
    for thread in (Path("/proc/thread-self"), *(each for p in processes for each in Path(f"/proc/{p}/task").glob("*"))):
        with suppress(OSError):  # it may have ended meanwhile
            waited_ns += int((thread / "schedstat").read_text().split()[1])
    return waited_ns / 1e9


@contextmanager
def _emulator(serial: str) -> Iterator[subprocess.Popen[str]]:
    machine = MACHINES[BOARD]
    with tempfile.TemporaryDirectory() as folder:
        process = subprocess.Popen(
            emulator_command(machine, machine.program(), serial=serial), cwd=Path(folder), stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        try:
            with patch("tactuator.rig.open._SERIAL_ANSWER_S", ANSWER_S), judged(process.pid):
                yield process
        finally:
            process.kill()
            process.communicate()


@contextmanager
def socket_board() -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """URL of a board that listens on a socket of this machine, and its process."""
    with socket.create_server(("127.0.0.1", 0)) as asked:
        port = asked.getsockname()[1]
    with _emulator(f"tcp:127.0.0.1:{port},server=on,wait=off,nodelay=on") as process:
        while f":{port:04X} " not in Path("/proc/net/tcp").read_text():
            assert process.poll() is None
            time.sleep(0.01)
        yield f"socket://127.0.0.1:{port}", process


@contextmanager
def serial_board() -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Name of a (pseudo) serial port with a board behind it, and its process."""
    with _emulator("pty") as process:
        assert process.stdout
        said = process.stdout.readline()
        found = re.search(r"/dev/\S+", said)
        assert found, said
        yield found[0], process
