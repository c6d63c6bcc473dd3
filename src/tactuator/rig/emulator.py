"""QEMU as a transport: a process of our own that runs a board's program, reached over FIFOs or its UART."""

from __future__ import annotations

import contextlib
import os
import select
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path

from tactuator.errors import BadInput
from tactuator.rig.boards import build_firmware, find_board
from tactuator.rig.transport import LinkDown

EMULATOR = "qemu-system-arm"
_OPEN_TIMEOUT_S = 20.0
_PIPE_BYTES = 1 << 16
_UART = "uart"
_NO_LINK = f"the emulator does not open its link within {_OPEN_TIMEOUT_S:g} s"


def emulator_command(board: str, program: Path, counting: str | None, serial: str = "none") -> list[str]:
    """Return the command line of QEMU for a board. counting: what -icount is told (virtual time from instructions), or
    None for none; serial: where the serial port of its link goes.
    """
    known = find_board(board)
    if shutil.which(EMULATOR) is None:
        raise BadInput(f"{EMULATOR} is missing", "install it with `make install-boards`")
    clock = [] if counting is None else ["-icount", counting]
    return [
        EMULATOR, "-M", known.machine, "-display", "none", "-monitor", "none",
        *["-serial", "null"] * known.serial, "-serial", serial,
        "-semihosting-config", "enable=on,target=native", *clock, "-kernel", str(program),
    ]  # fmt: skip


def emulator(board: str, counting: str | None = "shift=3,sleep=off") -> Emulator | EmulatorUart:
    """Return a board in QEMU, by the fastest way there is to it."""
    return Emulator(board, counting) if find_board(board).has_fifos else EmulatorUart(board, counting)


class _Emulated:
    """A process of QEMU's with two FIFOs in its folder, that carry bytes to its board and back."""

    def __init__(self, command: list[str], to_board: str, from_board: str) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="tactuator-"))
        for name in (to_board, from_board):
            os.mkfifo(self._folder / name)
        self._process: subprocess.Popen[bytes] | None = _begun(command, self._folder)
        self._to = self._from = -1
        self.sent = self.received = 0
        try:
            self._from = os.open(self._folder / from_board, os.O_RDONLY | os.O_NONBLOCK)
            self._to = self._open_to(self._folder / to_board)
        except BaseException:
            self.close()
            raise

    def send(self, content: bytes) -> None:
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
                raise LinkDown("the emulator has ended", "one that runs") from None
        self.sent += len(content)

    def receive(self, timeout_s: float) -> bytes:
        end = time.monotonic() + timeout_s
        while True:
            remaining_s = end - time.monotonic()
            readable, _, _ = select.select([self._from], [], [], max(0.0, min(remaining_s, 0.5)))
            if readable:
                content = os.read(self._from, _PIPE_BYTES)
                if content:
                    self.received += len(content)
                    return content
            self._require_alive()
            if remaining_s <= 0.0:
                return b""

    def close(self) -> None:
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

    def threads(self) -> list[Path]:
        """Return the folders in which Linux tells of the emulator's threads; none elsewhere."""
        if self._process is None:
            return []
        shell = Path(f"/proc/{self._process.pid}")
        try:
            children = (shell / "task" / shell.name / "children").read_text(encoding="ascii").split()
        except OSError:
            return []
        return [thread for child in children for thread in Path(f"/proc/{child}/task").glob("*")]

    def _require_alive(self) -> None:
        if self._process is None or self._process.poll() is not None:
            raise LinkDown("the emulator has ended", "one that runs")

    def _open_to(self, fifo: Path) -> int:
        """Return the FIFO to the board, once the emulator has opened its end."""
        end = time.monotonic() + _OPEN_TIMEOUT_S
        while time.monotonic() < end:
            self._require_alive()
            try:
                return os.open(fifo, os.O_WRONLY | os.O_NONBLOCK)
            except OSError:
                time.sleep(0.005)
        raise LinkDown(f"{_NO_LINK}", "a board that starts")


class Emulator(_Emulated):
    """A board in QEMU that runs `program`, or the one that is built for it. Its time is its own: `counting` makes it
    follow the instructions that it has executed. The board itself reads and writes the FIFOs.
    """

    def __init__(self, board: str, counting: str | None = "shift=3,sleep=off", program: Path | None = None) -> None:
        super().__init__(emulator_command(board, program or build_firmware(board), counting), "to-board", "from-board")


class EmulatorUart(_Emulated):
    """A board in QEMU behind its UART, whose other end are the FIFOs: its time goes on while it sends and receives."""

    def __init__(self, board: str, counting: str | None = "shift=3,sleep=off", more: tuple[str, ...] = ()) -> None:
        """Start the emulator; `more` are further options of it."""
        command = emulator_command(board, build_firmware(board), counting, f"pipe:{_UART}")
        alone = [] if find_board(board).has_fifos else _on_one_processor()
        super().__init__([*alone, *command, *more], f"{_UART}.in", f"{_UART}.out")
        try:
            if not self.receive(_OPEN_TIMEOUT_S):  # a board says when it is there; before, it hears nothing
                raise LinkDown(_NO_LINK)
        except BaseException:
            self.close()
            raise
        self.received = 0


def _on_one_processor() -> list[str]:
    """Return what keeps a command on one of this process's processors, where this system has it. The emulator's two
    threads wake one another for every byte of a UART, and that takes half as long again on two processors. It is not
    for boards that never sleep in a free run: there the thread of the processor would keep the UART's from running.
    """
    if shutil.which("taskset") is None or not hasattr(os, "sched_getaffinity"):
        return []
    allowed = sorted(os.sched_getaffinity(0))
    return ["taskset", "--cpu-list", str(allowed[os.getpid() % len(allowed)])]


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
