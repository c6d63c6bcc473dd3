"""QEMU as a transport: a process of our own that runs a board's program, reached over FIFOs or a socket."""

from __future__ import annotations

import contextlib
import os
import select
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

from tactuator.errors import BadInput
from tactuator.rig.firmware import build_firmware
from tactuator.rig.transport import LinkDown

EMULATOR = "qemu-system-arm"
_OPEN_S = 20.0
_PIPE_BYTES = 1 << 16


def emulator_command(board: str, program: Path, counting: str | None, serial: str = "none") -> list[str]:
    """QEMU for a board. counting: the shift of -icount (virtual time from instructions), or None for none."""
    if shutil.which(EMULATOR) is None:
        raise BadInput(f"{EMULATOR} is missing; allowed: install it with `make install-boards`")
    clock = [] if counting is None else ["-icount", counting]
    return [
        EMULATOR, "-M", board, "-display", "none", "-monitor", "none", "-serial", serial,
        "-semihosting-config", "enable=on,target=native", *clock, "-kernel", str(program),
    ]  # fmt: skip


class Emulator:
    """A board in QEMU. Its time is its own: `counting` makes it follow the instructions that it has executed."""

    def __init__(self, board: str, counting: str | None = "shift=3,sleep=off") -> None:
        command = emulator_command(board, build_firmware(board), counting)
        self._folder = Path(tempfile.mkdtemp(prefix="tactuator-"))
        for name in ("to-board", "from-board"):
            os.mkfifo(self._folder / name)
        self._process: subprocess.Popen[bytes] | None = subprocess.Popen(
            command, cwd=self._folder, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        self._to = self._from = -1
        try:
            self._from = os.open(self._folder / "from-board", os.O_RDONLY | os.O_NONBLOCK)
            self._to = self._open_to()
        except BaseException:
            self.close()
            raise

    def send(self, content: bytes) -> None:
        """All of the content; raises LinkDown if the emulator has ended."""
        at = 0
        while at < len(content):
            self._require_alive()
            _, writable, _ = select.select([], [self._to], [], 1.0)
            if not writable:
                continue
            try:
                at += os.write(self._to, content[at : at + _PIPE_BYTES])
            except BlockingIOError:
                continue
            except OSError:
                raise LinkDown("the emulator has ended; allowed: one that runs") from None

    def receive(self, timeout_s: float) -> bytes:
        """What has come; waits for at most timeout_s."""
        end = time.monotonic() + timeout_s
        while True:
            left = end - time.monotonic()
            readable, _, _ = select.select([self._from], [], [], max(0.0, min(left, 0.5)))
            if readable:
                content = os.read(self._from, _PIPE_BYTES)
                if content:
                    return content
            self._require_alive()
            if left <= 0.0:
                return b""

    def close(self) -> None:
        """End the emulator and remove what it needed."""
        for handle in (self._to, self._from):
            if handle >= 0:
                os.close(handle)
        self._to = self._from = -1
        if self._process is not None:
            self._process.kill()  # asked kindly it would not end: it waits in a read of ours, and has nothing to save
            self._process.wait()
            self._process = None
        shutil.rmtree(self._folder, ignore_errors=True)

    def __del__(self) -> None:
        with contextlib.suppress(Exception):
            self.close()

    def _require_alive(self) -> None:
        if self._process is None or self._process.poll() is not None:
            raise LinkDown("the emulator has ended; allowed: one that runs")

    def _open_to(self) -> int:
        """The FIFO to the board, once the board has opened its end."""
        end = time.monotonic() + _OPEN_S
        while time.monotonic() < end:
            self._require_alive()
            try:
                return os.open(self._folder / "to-board", os.O_WRONLY | os.O_NONBLOCK)
            except OSError:
                time.sleep(0.005)
        raise LinkDown(f"the emulator does not open its link within {_OPEN_S:g} s; allowed: a board that starts")
