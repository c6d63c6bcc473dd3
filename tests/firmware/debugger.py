"""A debugger on an emulated board: GDB's remote protocol, as far as it takes to spoil a processor and to watch what it
does then. Of the emulator, nothing of ours: registers, memory, breakpoints, its monitor."""

import socket
import subprocess
import time
from pathlib import Path

from tactuator.rig.boards import build_firmware

R0, R1, LR, PC = 0, 1, 14, 15
STR_R1_R0 = 0x6001
CPSID_I = 0xB672
BRANCH_TO_ITSELF = b"\xfe\xe7"


def symbols(board: str) -> dict[str, int]:
    """Addresses of a program's functions and data."""
    said = subprocess.run(
        ["arm-none-eabi-nm", str(build_firmware(board))], check=True, capture_output=True, text=True
    ).stdout
    rows = (line.split() for line in said.splitlines() if line[0] != " ")
    return {name: int(address, 16) for address, _, name in rows}


class Debugger:
    """`path`: the socket that QEMU's -gdb listens on. The board stands still from the beginning, until it goes on."""

    def __init__(self, path: Path, board: str) -> None:
        self.at = symbols(board)
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.settimeout(60.0)
        end = time.monotonic() + 20.0
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

    # -- packets

    def send(self, text: str) -> None:
        """One packet, which the other end acknowledges."""
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
        """A packet and its answer."""
        self.send(text)
        answer = self.packet()
        assert answer is not None
        return answer

    # -- the processor

    def register(self, number: int) -> int:
        """A core register."""
        return int.from_bytes(bytes.fromhex(self.ask(f"p{number:x}")[:8]), "little")

    def set_register(self, number: int, value: int) -> None:
        """A core register, written."""
        assert self.ask(f"P{number:x}={value.to_bytes(4, 'little').hex()}") == "OK"

    def word(self, address: int) -> int:
        """A word of memory, or a device's register."""
        return int.from_bytes(bytes.fromhex(self.ask(f"m{address:x},4")), "little")

    def set_bytes(self, address: int, content: bytes) -> None:
        """Memory, written; no device's register."""
        assert self.ask(f"M{address:x},{len(content):x}:{content.hex()}") == "OK"

    def go(self) -> None:
        """The board goes on."""
        self.send("c")

    def stop(self) -> None:
        """The board stands still."""
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
        """A command of QEMU's monitor."""
        self.send("qRcmd," + command.encode().hex())
        while (answer := self.packet()) != "OK":
            assert answer is not None

    # -- spoiling it

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
        """Let it go."""
        self._socket.close()
