"""Ways for bytes to a board and back: in this process, over a serial port (the extra `board`) or over a socket."""

from __future__ import annotations

import contextlib
import errno
import importlib
import os
import select
import socket
import time
from typing import Any, Protocol

from tactuator.errors import BadInput, DeviceFault
from tactuator.runtime._core import ffi, lib

BAUD = 2_000_000
"""Three channels at 4 kHz need 1.5 million with their trace (docs/porting.md). USB does not care."""
_UART_POLL_S = 0.02
"""Longest wait of one read of a port, so that its end is noticed."""
SCHEME = "socket://"
_TIMEOUT_S = 5.0
"""Seconds for a socket to open, or to take what is sent: a network that is slower carries no stream."""
_MOST_BYTES = 1 << 16
"""Bytes taken at once: sixteen of the longest frames."""
_BUFFER_ROWS = 4096
"""Rows of stream and trace of the board in this process: a second at 4 kHz, a power of two as the core wants it."""


class LinkDown(DeviceFault):
    """The board cannot be reached any more: the port has vanished."""


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

    It goes on with a run until that waits for its stream, or for a short while, before each look at what has been sent.
    """

    def __init__(self, name: str = "in-process", channels: int = 3) -> None:
        self.board: Any = ffi.new("tact_board *")
        self.simulated: Any = ffi.new("tact_simulated_board *")
        self.link: Any = ffi.new("tact_link *")
        self._stream = ffi.new("float[]", _BUFFER_ROWS * channels)
        self._trace = ffi.new("int32_t[]", _BUFFER_ROWS * channels * 2)
        self._force = ffi.new("float[]", _BUFFER_ROWS * channels)
        self._felt = ffi.new("float[]", _BUFFER_ROWS * channels)
        self._answers = ffi.new("uint8_t[]", _MOST_BYTES)
        lib.tact_board_reset(self.board, channels, self._stream, _BUFFER_ROWS, self._trace, _BUFFER_ROWS)
        lib.tact_simulated_board_reset(self.simulated, self._force, self._felt)
        lib.tact_link_reset(self.link, self.board, name.encode())
        lib.tact_simulated_board_join(self.simulated, self.link)
        self.board.allows_hold = 1
        self._waiting = bytearray()

    def send(self, content: bytes) -> None:
        """Hand all bytes to the board, which acts on them at once."""
        self._let_run()
        size = lib.tact_link_serve(self.link, ffi.from_buffer(content), len(content), self._answers, _MOST_BYTES)
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
        lib.tact_simulated_board_go_on(self.simulated, self.board)


def _not_opened(name: str, error: Any) -> tuple[str, str]:
    """Return what is wrong with a serial port that cannot be opened, and what helps."""
    if error.errno == errno.ENOENT:
        ports = [port.device for port in importlib.import_module("serial.tools.list_ports").comports()]
        there = ", ".join(sorted(ports)) or "the port of a board that is plugged in (no serial port is there)"
        return f"there is no serial port {name!r}", f"{there}, or socket://host:port"
    if error.errno is None:
        what = f"it cannot be opened ({error})"
    else:
        what = "in use by another program" if error.errno == errno.EAGAIN else os.strerror(error.errno)
    return f"serial port {name!r}: {what}", "a port that is free and that you may open, or socket://host:port"


class SerialPort:
    """Bytes over pyserial's `serial_for_url`: the name of a port, with `@BAUD` behind it for another than BAUD."""

    def __init__(self, url: str) -> None:
        try:
            serial: Any = importlib.import_module("serial")
        except ImportError:
            raise BadInput("pyserial is missing: install it with `pip install 'tactuator[board]'`") from None
        self._error: type[Exception] = serial.SerialException
        name, _, baud = url.partition("@")
        if baud and not (baud.isdecimal() and int(baud) > 0):
            raise BadInput(f"port {url!r}: baud rate {baud!r}", "a number, 2000000 say")
        try:
            # the lock is the operating system's: two programs on one board would each take the other's answers
            self._port: Any = serial.serial_for_url(
                name, int(baud or BAUD), timeout=_UART_POLL_S, write_timeout=2.0, exclusive=True
            )
        except ValueError as error:
            raise BadInput(f"port {name!r} is none ({error})", "a serial port or socket://host:port") from None
        except (serial.SerialException, OSError) as error:
            raise LinkDown(*_not_opened(name, error)) from None

    def send(self, content: bytes) -> None:
        """Send all bytes; raises LinkDown if the port has vanished."""
        try:
            self._port.write(content)
        except (self._error, OSError) as error:
            raise _down(str(error)) from None

    def receive(self, timeout_s: float) -> bytes:
        """Return the bytes that have come; waits for at most timeout_s for the first one."""
        end = time.monotonic() + timeout_s
        try:
            while not (first := bytes(self._port.read(1))):
                if time.monotonic() >= end:
                    return b""
            waiting = int(self._port.in_waiting)
            return first + bytes(self._port.read(waiting)) if waiting else first
        except (self._error, OSError) as error:
            raise _down(str(error)) from None

    def close(self) -> None:
        """Close the port, whatever its state."""
        with contextlib.suppress(Exception):
            self._port.close()


class SocketLink:
    """Bytes over a connected socket, which it closes in the end."""

    def __init__(self, connected: socket.socket) -> None:
        self._socket = connected
        self._socket.settimeout(_TIMEOUT_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def send(self, content: bytes) -> None:
        """Send all bytes; raises LinkDown if the other end does not take them."""
        try:
            self._socket.sendall(content)
        except OSError as error:
            raise _down(str(error)) from None

    def receive(self, timeout_s: float) -> bytes:
        """Return the bytes that have come; waits for at most timeout_s. Raises LinkDown if the other end is closed."""
        try:
            readable, _, _ = select.select([self._socket], [], [], timeout_s)
            if not readable:
                return b""
            content = self._socket.recv(_MOST_BYTES)
        except (OSError, ValueError) as error:
            raise _down(str(error)) from None
        if not content:
            raise _down("closed at the other end")
        return content

    def close(self) -> None:
        """Close the socket of the link."""
        self._socket.close()


def connect(url: str) -> SocketLink:
    """Return the link to `socket://host:port`.

    Raises BadInput if it is not such an address, and LinkDown if nothing listens there.
    """
    host, _, port = url.removeprefix(SCHEME).rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 1 << 16:
        raise BadInput(f"port {url!r} cannot be opened", "socket://host:port, with a port from 1 to 65535")
    try:
        return SocketLink(socket.create_connection((host.strip("[]"), int(port)), _TIMEOUT_S))
    except OSError as error:
        raise LinkDown(f"port {url!r} cannot be opened ({error})", "one where a board listens") from None


def _down(why: str) -> LinkDown:
    return LinkDown(f"the port has vanished ({why})", "a board that stays connected")
