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
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

import pytest

from tactuator.rig.board.stream import StreamDry
from tactuator.rig.boards import build_firmware
from tactuator.rig.emulator import emulator_command
from tactuator.rig.streaming_check import HostWatch, waited_s
from tactuator.rig.transport import LinkDown

BOARD = "mps2-an500"
COUNTING = "shift=3,sleep=off"
ANSWER_S = 10.0
"""Of an emulator that shares this machine; a real board answers within one."""


@contextmanager
def _emulator(serial: str) -> Iterator[subprocess.Popen[str]]:
    with tempfile.TemporaryDirectory() as folder:
        command = emulator_command(BOARD, build_firmware(BOARD), COUNTING, serial)
        process = subprocess.Popen(
            command, cwd=Path(folder), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True,
        )  # fmt: skip
        assert process.stdout
        watch = HostWatch(1, waited=lambda: waited_s() + _emulator_waited_s(process))
        try:
            with patch("tactuator.rig.open._SERIAL_ANSWER_S", ANSWER_S):
                yield process
        except (StreamDry, LinkDown) as error:
            if process.poll() is not None or not watch.is_starved():
                raise
            pytest.skip(f"not judged: {error}; host and emulator had waited {100.0 * watch.waited_share():.0f} %")
        finally:
            process.kill()
            process.wait()
            process.stdout.close()


def _emulator_waited_s(process: subprocess.Popen[str]) -> float:
    return sum(waited_s(thread / "schedstat") for thread in Path(f"/proc/{process.pid}/task").glob("*"))


@contextmanager
def socket_board() -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """URL of a board that listens on a socket of this machine, and its process."""
    with socket.create_server(("127.0.0.1", 0)) as asked:
        port = asked.getsockname()[1]
    with _emulator(f"tcp:127.0.0.1:{port},server=on,wait=off,nodelay=on") as process:
        end = time.monotonic() + 20.0
        while f":{port:04X} " not in Path("/proc/net/tcp").read_text():
            assert process.poll() is None
            assert time.monotonic() < end, "the emulator does not listen"
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
