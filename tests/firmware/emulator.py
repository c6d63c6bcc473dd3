"""Boards in QEMU, with the simulated display in the place of converters, reached over FIFOs or their UART."""

from __future__ import annotations

import contextlib
import os
import select
import shutil
import signal
import subprocess
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

from firmware.build import FIRMWARE, ROOT, Board, build, find_board
from tactuator.model.description import Display
from tactuator.rig.board.link import LinkClient
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.transport import LinkDown, Transport

COUNTING = "shift=3,sleep=off"
"""What QEMU's -icount is told: virtual time follows the instructions, 8 ns each."""
_ANSWER_S, _OPEN_TIMEOUT_S = 10.0, 120.0
_PIPE_BYTES = 1 << 16
_FIFOS, _UART_FIFOS = ("to-board", "from-board"), ("uart.in", "uart.out")
_NO_LINK = f"the emulator does not open its link within {_OPEN_TIMEOUT_S:g} s"
_HERE = Path(__file__).parent / "emulated"
_MPS2 = Board(
    "mps2-an386", "Cortex-M4F", "cortex-m4", "fpv4-sp-d16", 4096, 25e6,
    (ROOT / "core" / "display", FIRMWARE / "cortex_m", _HERE, _HERE / "mps2"), ("-Itests/firmware",),
)  # fmt: skip


@dataclass(frozen=True)
class Machine:
    """A board and QEMU's name of its machine. serial: the number of the serial port that is its link; has_fifos: it can
    be reached over FIFOs as well."""

    board: Board
    name: str
    serial: int = 0
    has_fifos: bool = True

    def program(self) -> Path:
        return build(self.board)


def _stm32f405() -> Machine:
    """The board itself, but for its clock and its converters."""
    real = find_board("stm32f405")
    folders = (ROOT / "core" / "display", *real.folders[:-1], _HERE, _HERE / "stm32f405")
    wrapped = (f"-Wl,--wrap={name}" for name in ("tact_port_begin", "tact_systick_start"))
    board = replace(real, folders=folders, flags=("-Itests/firmware", *wrapped))
    return Machine(board, "netduinoplus2", serial=2, has_fifos=False)


MACHINES = {
    "mps2-an386": Machine(_MPS2, "mps2-an386"),
    "mps2-an500": Machine(
        replace(_MPS2, name="mps2-an500", describes="Cortex-M7", processor="cortex-m7", floating_point="fpv5-d16"),
        "mps2-an500",
    ),
    "stm32f405": _stm32f405(),
}


def emulator_command(machine: Machine, program: Path, counting: str = COUNTING, serial: str = "none") -> list[str]:
    """QEMU's command line. serial: where the serial port of the board's link goes."""
    return [
        "qemu-system-arm", "-M", machine.name, "-display", "none", "-monitor", "none",
        *["-serial", "null"] * machine.serial, "-serial", serial,
        "-semihosting-config", "enable=on,target=native", "-icount", counting, "-kernel", str(program),
    ]  # fmt: skip


def emulated_rig(board: str, display: Display, seed: int = 0, counting: str = COUNTING) -> BoardRig:
    """A rig of a simulated `display` on an emulated board, by the fastest way there is to it."""
    machine = MACHINES[board]
    return rig_of(Emulator(machine, counting, uart=not machine.has_fifos), display, seed)


def rig_of(transport: Transport, display: Display, seed: int = 0, answer_s: float = _ANSWER_S) -> BoardRig:
    """The rig of a board with a simulated display behind a transport; it is closed again if it cannot be set up."""
    client = LinkClient(transport, answer_s)
    try:
        rig = BoardRig(client, display)
        rig.simulate(seed)
    except BaseException:
        client.close()
        raise
    return rig


class Emulator:
    """A process of QEMU's with two FIFOs in its folder, that carry bytes to its board and back.

    The board runs `program`, or its own. It reads and writes the FIFOs itself, and its time stands still while it
    waits; or (`uart`) they are the other end of its serial port, and its time goes on. more: options of QEMU.
    """

    def __init__(
        self,
        machine: Machine,
        counting: str = COUNTING,
        program: Path | None = None,
        uart: bool = False,
        more: tuple[str, ...] = (),
    ) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="tactuator-"))
        to_board, from_board = (self._folder / name for name in (_UART_FIFOS if uart else _FIFOS))
        for fifo in (to_board, from_board):
            os.mkfifo(fifo)
        serial = f"pipe:{_UART_FIFOS[0].removesuffix('.in')}" if uart else "none"
        command = [*emulator_command(machine, program or machine.program(), counting, serial), *more]
        self._process: subprocess.Popen[bytes] | None = _begun(command, self._folder)
        self._to = self._from = -1
        try:
            self._from = os.open(from_board, os.O_RDONLY | os.O_NONBLOCK)
            self._to = self._open_to(to_board)
            if uart and not self.receive(_OPEN_TIMEOUT_S):  # a board says when it is there; before, it hears nothing
                raise LinkDown(_NO_LINK)
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
                raise LinkDown("the emulator has ended") from None

    def receive(self, timeout_s: float) -> bytes:
        end = time.monotonic() + timeout_s
        while True:
            remaining_s = end - time.monotonic()
            readable, _, _ = select.select([self._from], [], [], max(0.0, min(remaining_s, 0.5)))
            if readable and (content := os.read(self._from, _PIPE_BYTES)):
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

    def _require_alive(self) -> None:
        if self._process is None or self._process.poll() is not None:
            raise LinkDown("the emulator has ended")

    def _open_to(self, fifo: Path) -> int:
        """The FIFO to the board, once the emulator has opened its end."""
        end = time.monotonic() + _OPEN_TIMEOUT_S
        while time.monotonic() < end:
            self._require_alive()
            try:
                return os.open(fifo, os.O_WRONLY | os.O_NONBLOCK)
            except OSError:
                time.sleep(0.005)
        raise LinkDown(_NO_LINK)


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
