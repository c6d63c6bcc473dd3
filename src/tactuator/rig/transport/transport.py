"""Ways for bytes to a board and back: in this process, through an emulator's FIFOs, over a serial port or a socket."""

from __future__ import annotations

from typing import Any, Protocol

from tactuator.errors import DeviceFault
from tactuator.runtime._core import ffi, lib

_SHORT_RUN_PERIODS = 32
_LONG_RUN_PERIODS = 1 << 13
_BUFFER_ROWS = 4096
_ANSWER_BYTES = 1 << 16


class LinkDown(DeviceFault):
    """The board cannot be reached any more: the port has vanished, or the emulator has ended."""


class Transport(Protocol):
    """Bytes there and back. Both raise LinkDown when the other end is gone."""

    def send(self, content: bytes) -> None:
        """Queue all bytes; returns without waiting."""
        ...

    def receive(self, timeout_s: float) -> bytes:
        """Return the bytes that have come; waits for at most timeout_s, then gives nothing."""
        ...

    def close(self) -> None:
        """Close the transport; may be called again."""
        ...


class InProcess:
    """A board with a simulated display, run by the core in this very process: no time passes but its own.

    As an emulated one does, it goes on with a run until that waits for its stream, or for a short while, before each
    look at what has been sent.
    """

    def __init__(self, name: str = "in-process", channels: int = 3) -> None:
        self.board: Any = ffi.new("tact_board *")
        self.simulated: Any = ffi.new("tact_simulated_board *")
        self.link: Any = ffi.new("tact_link *")
        self._stream = ffi.new("float[]", _BUFFER_ROWS * channels)
        self._trace = ffi.new("int32_t[]", _BUFFER_ROWS * channels * 2)
        self._force = ffi.new("float[]", _BUFFER_ROWS * channels)
        self._felt = ffi.new("float[]", _BUFFER_ROWS * channels)
        self._answers = ffi.new("uint8_t[]", _ANSWER_BYTES)
        lib.tact_board_reset(self.board, channels, self._stream, _BUFFER_ROWS, self._trace, _BUFFER_ROWS)
        lib.tact_simulated_board_reset(self.simulated, self._force, self._felt)
        lib.tact_link_reset(self.link, self.board, name.encode())
        lib.tact_simulated_board_join(self.simulated, self.link)
        self.board.allows_hold = 1
        self._waiting = bytearray()

    def send(self, content: bytes) -> None:
        """Hand all bytes to the board, which acts on them at once."""
        self._let_run()
        size = lib.tact_link_serve(self.link, ffi.from_buffer(content), len(content), self._answers, _ANSWER_BYTES)
        self._waiting += bytes(ffi.buffer(self._answers, size))

    def receive(self, timeout_s: float) -> bytes:
        """Return the answers of the board so far."""
        del timeout_s
        content, self._waiting = bytes(self._waiting), bytearray()
        return content

    def close(self) -> None:
        """Do nothing, since nothing is held open."""

    def run(self, ticks: int) -> int:
        """Run periods of the board until it waits; return how many."""
        return int(lib.tact_simulated_board_run(self.simulated, self.board, ticks))

    def _let_run(self) -> None:
        running = self.board.mode == lib.TACT_RUNNING or self.board.ending != lib.TACT_STAYS
        if running and self.simulated.channels and not lib.tact_board_waits(self.board):
            ending = self.board.ending != lib.TACT_STAYS
            self.run(_LONG_RUN_PERIODS if self.board.holds and not ending else _SHORT_RUN_PERIODS)
