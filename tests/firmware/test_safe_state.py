"""Faults of the processor, emulated: whatever happens to it in the middle of a run, the outputs are safe within 20 ms.

Witnesses: QEMU's processor, its timer, and on the MPS2 boards its model of ARM's watchdog. The STM32's is not in
this emulator: what its program does is watched, and its time is the data sheet's.
"""

import re
import socket
import struct
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tactuator.rig.board.link import SILENT, LinkClient, Mode, Request, RequestOutcome
from tactuator.rig.board.rig import BoardRig
from tests.firmware.emulator import MACHINES, Emulator
from tests.rig.guard.guarded import designed

R0, R1, LR, PC = 0, 1, 14, 15
STR_R1_R0 = 0x6001
CPSID_I = 0xB672
BRANCH_TO_ITSELF = b"\xfe\xe7"


def symbols(board: str) -> dict[str, int]:
    """Addresses of a program's functions and data."""
    said = subprocess.run(
        ["arm-none-eabi-nm", str(MACHINES[board].program())], check=True, capture_output=True, text=True
    ).stdout
    rows = (line.split() for line in said.splitlines() if line[0] != " ")
    return {name: int(address, 16) for address, _, name in rows}


class Debugger:
    """On an emulated board, by GDB's remote protocol as far as it takes to spoil a processor and watch it. `path`: the
    socket that QEMU's -gdb listens on. The board stands still from the beginning, until it goes on."""

    def __init__(self, path: Path, board: str) -> None:
        self.at = symbols(board)
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.settimeout(60.0)
        end = time.monotonic() + 120.0
        while True:
            try:
                self._socket.connect(str(path))
                break
            except OSError:
                assert time.monotonic() < end
                time.sleep(0.02)
        self._pending = b""
        self.ask("?")
        while self.packet(0.3) is not None:  # that it stands still now, it says by itself as well
            pass
        self.ask("qXfer:features:read:target.xml:0,ffb")  # otherwise it has no single registers

    def send(self, text: str) -> None:
        self._socket.sendall(f"${text}#{sum(text.encode()) % 256:02x}".encode())

    def packet(self, timeout_s: float = 60.0) -> str | None:
        """The next packet, or None where none comes."""
        self._socket.settimeout(timeout_s)
        try:
            while self._pending.count(b"#") == 0 or len(self._pending) < self._pending.index(b"#") + 3:
                self._pending += self._socket.recv(4096)
        except TimeoutError:
            return None
        begin, end = self._pending.index(b"$"), self._pending.index(b"#")
        text, self._pending = self._pending[begin + 1 : end].decode(), self._pending[end + 3 :]
        self._socket.sendall(b"+")
        return text

    def ask(self, text: str) -> str:
        self.send(text)
        answer = self.packet()
        assert answer is not None
        return answer

    def register(self, number: int) -> int:
        return int.from_bytes(bytes.fromhex(self.ask(f"p{number:x}")[:8]), "little")

    def set_register(self, number: int, value: int) -> None:
        assert self.ask(f"P{number:x}={value.to_bytes(4, 'little').hex()}") == "OK"

    def word(self, address: int) -> int:
        """A word of memory, or a device's register."""
        return int.from_bytes(bytes.fromhex(self.ask(f"m{address:x},4")), "little")

    def set_bytes(self, address: int, content: bytes) -> None:
        """Memory, written; no device's register."""
        assert self.ask(f"M{address:x},{len(content):x}:{content.hex()}") == "OK"

    def go(self) -> None:
        self.send("c")

    def stop(self) -> None:
        self._socket.sendall(b"\x03")
        assert self.packet() is not None

    def until(self, name: str, timeout_s: float = 60.0) -> bool:
        """Goes on to a function's first instruction: whether it comes there. Stands still then."""
        return self.until_at(self.at[name] & ~1, timeout_s)

    def until_at(self, where: int, timeout_s: float = 60.0) -> bool:
        """The same for an address. Single steps would put interrupts off."""
        assert self.ask(f"Z1,{where:x},2") == "OK"
        self.go()
        came = self.packet(timeout_s) is not None
        if not came:
            self.stop()
        assert self.ask(f"z1,{where:x},2") == "OK"
        assert not came or self.register(PC) == where
        return came

    def monitor(self, command: str) -> None:
        self.send("qRcmd," + command.encode().hex())
        while (answer := self.packet()) != "OK":
            assert answer is not None

    def execute(self, instruction: int, r0: int = 0, r1: int = 0) -> None:
        """One 16-bit instruction between two of the program's, from the bottom of the stack's memory."""
        before = {number: self.register(number) for number in (R0, R1, PC)}
        scratch = 0x20000000
        kept = self.word(scratch)
        self.set_bytes(scratch, instruction.to_bytes(2, "little") + b"\x00\xbf")
        for number, value in ((R0, r0), (R1, r1), (PC, scratch)):
            self.set_register(number, value)
        assert self.until_at(scratch + 2)
        for number, value in before.items():
            self.set_register(number, value)
        self.set_bytes(scratch, kept.to_bytes(4, "little"))

    def write_device(self, address: int, value: int) -> None:
        """A device's register, written by the processor."""
        self.execute(STR_R1_R0, address, value)

    def close(self) -> None:
        self._socket.close()


pytestmark = pytest.mark.soak  # on a machine that is much busier than it has cores, an emulated board's time leaps

COUNTING = "shift=3,sleep=on"
"""Not sleep=off: where nothing is to be done, a debugger's stop too, time would leap to the next event."""
LONGEST_MS = 20.0
SYSTICK_CONTROL = 0xE000E010
TIM5 = 0x40000C00
FIRST_ON_MPS2 = 0x40028000
NVIC_PEND = 0xE000E200
SUPPLY_FALLS = 1 << 1
SETS_AMPLIFIER, CLEARS_AMPLIFIER = 1 << 4, 1 << 20
RATE = struct.pack("<f", 4000.0)
IWDG_SLOWEST_HZ, IWDG_COUNTS, IWDG_PRESCALER = 17e3, 76, 4
"""The oscillator's least frequency by the data sheet (DS8626, LSI), and what the program sets."""


@dataclass
class Board:
    """A board in a run, with a debugger on it."""

    name: str
    uart: Emulator
    client: LinkClient
    debugger: Debugger
    log: Path

    @property
    def is_stm32(self) -> bool:
        return self.name == "stm32f405"

    def reset(self) -> None:
        self.debugger.monitor("system_reset")
        self.debugger.go()
        assert self.uart.receive(20.0)

    def ms(self) -> float:
        """The emulator's time."""
        if self.is_stm32:
            return self.debugger.word(TIM5 + 0x24) / 1e6
        return self.debugger.word(FIRST_ON_MPS2 + 0x18) / 25e3

    def outputs_are_safe(self) -> bool:
        """The amplifier's enable (of the STM32: the last that was written to the pins)."""
        if not self.is_stm32:
            return self.debugger.word(FIRST_ON_MPS2) & 1 == 0
        is_on = False
        for value in re.findall(r"GPIOA: unimplemented device write .*offset 0x018, value (\w+)", self.log.read_text()):
            is_on = (is_on or bool(int(value, 16) & SETS_AMPLIFIER)) and not int(value, 16) & CLEARS_AMPLIFIER
        return not is_on

    def into_the_main_loop(self) -> None:
        """Stands still there, the timer going on and the outputs on."""
        self.debugger.go()
        self.client.status()
        self.debugger.stop()
        assert self.debugger.until("tact_port_outputs_on")
        assert self.debugger.until("tact_supervisor_heard")
        assert not self.outputs_are_safe()
        if self.is_stm32:
            self.debugger.write_device(TIM5, 1)

    def ms_until_safe(self, begun_ms: float) -> float:
        """Until the outputs are safe from now on; looks at them, too."""
        assert self.debugger.until("tact_port_outputs_safe")
        taken = self.ms() - begun_ms
        assert self.debugger.until_at(self.debugger.register(LR) & ~1)
        assert self.outputs_are_safe()
        return taken


@pytest.fixture(scope="module", params=["mps2-an386", "stm32f405"])
def running(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Board]:
    """One emulator for all that can be done to a board: each begins anew from its reset."""
    folder = tmp_path_factory.mktemp("emulator")
    more = ("-chardev", f"socket,path={folder}/gdb,server=on,wait=off,id=gdb", "-gdb", "chardev:gdb")
    more += ("-d", "unimp", "-D", str(folder / "log"))
    uart = Emulator(MACHINES[request.param], COUNTING, uart=True, more=more)
    client = LinkClient(uart, 20.0)
    debugger = Debugger(folder / "gdb", request.param)
    yield Board(request.param, uart, client, debugger, folder / "log")
    debugger.close()
    client.close()


def start(client: LinkClient, rig: BoardRig) -> None:
    """A run whose time goes on. While a board is idle its time follows this machine's: where the emulator is kept from
    running for 20 ms, the board's watchdog is right to bark."""
    for _ in range(10):
        if client.status().image_crc == 0:
            rig.commission()
            rig.simulate(1)
            rig.load(designed())
        client.ask(Request.ARM)
        if client.ask(Request.START, struct.pack("<IBBB", 1, SILENT, False, False))[0] is RequestOutcome.DONE:
            return
    raise AssertionError("no run begins")


@pytest.fixture
def board(running: Board) -> Board:
    """From a reset, which is how a board comes back when its supply does, into a run."""
    debugger = running.debugger
    running.reset()
    status = running.client.status()
    assert (status.mode, status.safety_crc, status.image_crc) == (Mode.OFF, 0, 0)
    rig = BoardRig(running.client, designed().display, waits=False)
    debugger.stop()
    assert running.outputs_are_safe()
    debugger.go()
    rig.simulate(1)
    rig.load(designed())
    start(running.client, rig)
    debugger.stop()
    running.into_the_main_loop()
    return running


def halt_in_an_endless_loop(board: Board) -> None:
    """The main loop goes on in a loop that the program has somewhere, and that calls nobody."""
    content = MACHINES[board.name].program().read_bytes()
    lowest = board.debugger.at["tact_halt_here"] & ~1
    code = bytes.fromhex(board.debugger.ask(f"m{lowest:x},40"))
    at = code.index(BRANCH_TO_ITSELF)
    assert BRANCH_TO_ITSELF in content
    board.debugger.set_register(PC, lowest + at)


def test_processor__faults__outputs_safe_at_once(board: Board) -> None:
    begun = board.ms()
    board.debugger.set_register(PC, 0xF0000000)
    assert board.ms_until_safe(begun) < 1.0


def test_main_loop__stuck__outputs_safe_in_time(board: Board) -> None:
    begun = board.ms()
    halt_in_an_endless_loop(board)
    assert 5.0 < board.ms_until_safe(begun) < LONGEST_MS


@pytest.mark.parametrize("how", ["timer stopped", "interrupts masked"])
def test_interrupt__comes_no_more__watchdog_ends_it_in_time(board: Board, how: str) -> None:
    begun = board.ms()
    if how == "timer stopped":
        board.debugger.write_device(SYSTICK_CONTROL, 0)
    else:
        board.debugger.execute(CPSID_I)
        halt_in_an_endless_loop(board)
    if board.is_stm32:
        assert not board.debugger.until("tact_watchdog_feed", 1.0)
        assert 1e3 * IWDG_COUNTS * IWDG_PRESCALER / IWDG_SLOWEST_HZ + 0.25 < LONGEST_MS
        return
    assert 1.0 < board.ms_until_safe(begun) < LONGEST_MS
    assert board.debugger.until("tact_reset")
    board.debugger.go()
    assert board.client.status().mode is Mode.OFF
    board.debugger.stop()
    assert board.outputs_are_safe()


def test_supply__falls__outputs_safe_at_once(board: Board) -> None:
    if not board.is_stm32:
        pytest.skip("these boards have no watch over their supply")
    begun = board.ms()
    board.debugger.write_device(NVIC_PEND, SUPPLY_FALLS)
    assert board.ms_until_safe(begun) < 1.0


def test_table__a_bit_turned_over_in_memory__outputs_safe(board: Board) -> None:
    at = board.debugger.at["board"]
    while board.debugger.word(at) != int.from_bytes(RATE, "little"):  # in the safety table
        at += 4
    begun = board.ms()
    board.debugger.set_bytes(at, (board.debugger.word(at) ^ 0x400).to_bytes(4, "little"))
    assert board.ms_until_safe(begun) > 0.0  # within how many ticks: tests/core/test_tables.py
