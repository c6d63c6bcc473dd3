"""Boards in the emulator that are reached as real ones are: at a port of this machine."""

from __future__ import annotations

import re
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tactuator.rig.program import build_firmware
from tactuator.rig.transport.emulator import emulator_command

BOARD = "mps2-an500"
COUNTING = "shift=3,sleep=off"


@contextmanager
def _emulator(serial: str) -> Iterator[subprocess.Popen[str]]:
    with tempfile.TemporaryDirectory() as folder:
        command = emulator_command(BOARD, build_firmware(BOARD), COUNTING, serial)
        process = subprocess.Popen(
            command, cwd=Path(folder), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True,
        )  # fmt: skip
        assert process.stdout
        try:
            yield process
        finally:
            process.kill()
            process.wait()
            process.stdout.close()


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
