"""Boards behind a serial port, by pyserial (the extra `board`), or behind a socket."""

from __future__ import annotations

import contextlib
import importlib
import time
from typing import Any

from tactuator.errors import BadInput
from tactuator.rig.transport.transport import LinkDown

BAUD = 2_000_000
"""Three channels at 4 kHz need 1.5 million with their trace (docs/porting.md). USB does not care."""
_UART_POLL_S = 0.02


class SerialPort:
    """Bytes over pyserial's `serial_for_url`: the name of a port, with `@BAUD` behind it for another than BAUD."""

    def __init__(self, url: str) -> None:
        try:
            serial: Any = importlib.import_module("serial")
        except ImportError:
            raise BadInput("pyserial is missing", "install it with `pip install tactuator[board]`") from None
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
            raise LinkDown(
                f"port {name!r} cannot be opened ({error})", "one that is there and free, or socket://host:port"
            ) from None

    def send(self, content: bytes) -> None:
        """Send all bytes; raises LinkDown if the port has vanished."""
        try:
            self._port.write(content)
        except (self._error, OSError) as error:
            raise self._down(error) from None

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
            raise self._down(error) from None

    def close(self) -> None:
        """Close the port, whatever its state."""
        with contextlib.suppress(Exception):
            self._port.close()

    def _down(self, error: Exception) -> LinkDown:
        return LinkDown(f"the port has vanished ({error})", "a board that stays connected")
