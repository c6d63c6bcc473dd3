"""Boards behind a serial port or a socket, by pyserial (the extra `board`)."""

from __future__ import annotations

import contextlib
import importlib
from typing import Any

from tactuator.digital.wired_display import wired_display_bytes
from tactuator.errors import BadInput
from tactuator.plant.display import Display
from tactuator.rig.board import BoardRig
from tactuator.rig.link import LinkClient
from tactuator.rig.transport import LinkDown

BAUD = 921600
_ANSWER_S = 1.0


class SerialPort:
    """Bytes over pyserial's `serial_for_url`: a port's name, or `socket://host:port`."""

    def __init__(self, url: str) -> None:
        try:
            serial: Any = importlib.import_module("serial")
        except ImportError:
            raise BadInput("pyserial is missing; allowed: install it with `pip install tactuator[board]`") from None
        self._error: type[Exception] = serial.SerialException
        try:
            self._port: Any = serial.serial_for_url(url, baudrate=BAUD, timeout=0.0, write_timeout=2.0)
        except (serial.SerialException, ValueError, OSError) as error:
            raise BadInput(
                f"port {url!r} cannot be opened ({error}); allowed: a serial port or socket://host:port"
            ) from None

    def send(self, content: bytes) -> None:
        """All of the content; raises LinkDown if the port has vanished."""
        try:
            self._port.write(content)
        except (self._error, OSError) as error:
            raise self._down(error) from None

    def receive(self, timeout_s: float) -> bytes:
        """What has come; waits for at most timeout_s for the first byte."""
        try:
            self._port.timeout = timeout_s
            first = bytes(self._port.read(1))
            if not first:
                return b""
            self._port.timeout = 0.0
            return first + bytes(self._port.read(max(1, int(self._port.in_waiting))))
        except (self._error, OSError) as error:
            raise self._down(error) from None

    def close(self) -> None:
        """Close the port."""
        with contextlib.suppress(Exception):
            self._port.close()

    def _down(self, error: Exception) -> LinkDown:
        return LinkDown(f"the port has vanished ({error}); allowed: a board that stays connected")


def serial_rig(url: str, display: Display, seed: int = 0) -> BoardRig:
    """`display` on the board at `url`. A board whose display is simulated gets this one, with `seed`."""
    client = LinkClient(SerialPort(url), _ANSWER_S)
    try:
        rig = BoardRig(client, display)
        if client.status().allows_hold:
            content, loads = wired_display_bytes(display, seed)
            rig.wire(content, loads)
    except BaseException:
        client.close()
        raise
    return rig
