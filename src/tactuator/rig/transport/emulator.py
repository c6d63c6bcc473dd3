"""QEMU as a transport: a process of our own that runs a board's program, reached over FIFOs or its UART."""

from __future__ import annotations

import contextlib
import os
import select
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from pathlib import Path

from tactuator.errors import BadInput
from tactuator.rig.boards import find_board
from tactuator.rig.program import build_firmware
from tactuator.rig.transport.socket import SocketLink
from tactuator.rig.transport.transport import LinkDown

EMULATOR = "qemu-system-arm"
_OPEN_TIMEOUT_S = 20.0
_PIPE_BYTES = 1 << 16


def emulator_command(board: str, program: Path, counting: str | None, serial: str = "none") -> list[str]:
    """Return the command line of QEMU for a board. counting: what -icount is told (virtual time from instructions), or
    None for none; serial: where the serial port of its link goes.
    """
    found = find_board(board)
    if shutil.which(EMULATOR) is None:
        raise BadInput(f"{EMULATOR} is missing; allowed: install it with `make install-boards`")
    clock = [] if counting is None else ["-icount", counting]
    return [
        EMULATOR, "-M", found.machine, "-display", "none", "-monitor", "none",
        *["-serial", "null"] * found.serial, "-serial", serial,
        "-semihosting-config", "enable=on,target=native", *clock, "-kernel", str(program),
    ]  # fmt: skip


def emulator(board: str, counting: str | None = "shift=3,sleep=off") -> Emulator | EmulatorUart:
    """Return a board in QEMU, by the fastest way there is to it."""
    return Emulator(board, counting) if find_board(board).has_fifos else EmulatorUart(board, counting)


class Emulator:
    """A board in QEMU that runs `program`, or the one that is built for it. Its time is its own: `counting` makes it
    follow the instructions that it has executed."""

    def __init__(self, board: str, counting: str | None = "shift=3,sleep=off", program: Path | None = None) -> None:
        command = emulator_command(board, program or build_firmware(board), counting)
        self._folder = Path(tempfile.mkdtemp(prefix="tactuator-"))
        for name in ("to-board", "from-board"):
            os.mkfifo(self._folder / name)
        self._process: subprocess.Popen[bytes] | None = _begun(command, self._folder)
        self._to = self._from = -1
        try:
            self._from = os.open(self._folder / "from-board", os.O_RDONLY | os.O_NONBLOCK)
            self._to = self._open_to()
        except BaseException:
            self.close()
            raise

    def send(self, content: bytes) -> None:
        """Queue all bytes; raises LinkDown if the emulator has ended."""
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
        """Return the bytes that have come; waits for at most timeout_s."""
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
            _end(self._process)
            self._process = None
        shutil.rmtree(self._folder, ignore_errors=True)

    def __del__(self) -> None:
        with contextlib.suppress(Exception):
            self.close()

    def _require_alive(self) -> None:
        if self._process is None or self._process.poll() is not None:
            raise LinkDown("the emulator has ended; allowed: one that runs")

    def _open_to(self) -> int:
        """Return the FIFO to the board, once the board has opened its end."""
        end = time.monotonic() + _OPEN_TIMEOUT_S
        while time.monotonic() < end:
            self._require_alive()
            try:
                return os.open(self._folder / "to-board", os.O_WRONLY | os.O_NONBLOCK)
            except OSError:
                time.sleep(0.005)
        raise LinkDown(
            f"the emulator does not open its link within {_OPEN_TIMEOUT_S:g} s; allowed: a board that starts"
        )


class EmulatorUart:
    """A board in QEMU behind its UART, on a socket of this machine: its time goes on while it sends and receives."""

    def __init__(self, board: str, counting: str | None = "shift=3,sleep=off", more: tuple[str, ...] = ()) -> None:
        """Start the emulator; `more` are further options of it."""
        program = build_firmware(board)
        self._folder = tempfile.TemporaryDirectory(prefix="tactuator-")  # no FIFOs in it: the board takes its UART
        self._process: subprocess.Popen[bytes] | None = None
        with socket.create_server(("127.0.0.1", 0)) as listener:
            listener.settimeout(_OPEN_TIMEOUT_S)
            serial = f"tcp:127.0.0.1:{listener.getsockname()[1]},nodelay=on"
            try:
                command = [*emulator_command(board, program, counting, serial), *more]
                self._process = _begun(command, Path(self._folder.name))
                self._link = SocketLink(listener.accept()[0])
                if not self._link.receive(_OPEN_TIMEOUT_S):  # a board says when it is there; before, it hears nothing
                    raise TimeoutError
            except BaseException as error:
                self.close()
                if isinstance(error, TimeoutError):
                    raise LinkDown(f"the emulator does not open its link within {_OPEN_TIMEOUT_S:g} s") from None
                raise
        self.sent = self.received = 0

    def send(self, content: bytes) -> None:
        """Send all bytes; raises LinkDown if the emulator has ended."""
        self._link.send(content)
        self.sent += len(content)

    def receive(self, timeout_s: float) -> bytes:
        """Return the bytes that have come; waits for at most timeout_s."""
        content = self._link.receive(timeout_s)
        self.received += len(content)
        return content

    def close(self) -> None:
        """End the emulator and close its socket."""
        if hasattr(self, "_link"):
            self._link.close()
        if self._process is not None:
            _end(self._process)
            self._process = None
        self._folder.cleanup()

    def __del__(self) -> None:
        with contextlib.suppress(Exception):
            self.close()


_WATCHED = 'exec 3<&0; "$@" </dev/null & emulator=$!; (cat >/dev/null; kill -9 $emulator) <&3 & wait $emulator'


def _begun(command: list[str], folder: Path) -> subprocess.Popen[bytes]:
    """Start the process in a group of its own: Ctrl-C at the terminal is for us, who still have to bring the board to
    rest. It ends with us, however we end: a shell holds the other end of our pipe, and kills it when that closes.
    """
    silent = subprocess.DEVNULL
    watched = ["/bin/sh", "-c", _WATCHED, "emulator", *command]
    return subprocess.Popen(watched, cwd=folder, stdin=subprocess.PIPE, stdout=silent, stderr=silent, process_group=0)


def _end(process: subprocess.Popen[bytes]) -> None:
    assert process.stdin is not None
    with contextlib.suppress(ProcessLookupError):
        # the whole group at once: asked kindly it would not end, it may wait in a read of ours, and has nothing to save
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    process.stdin.close()
