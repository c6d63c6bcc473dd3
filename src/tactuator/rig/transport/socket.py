"""A socket as a transport: a board behind a terminal server, or an emulator's serial port."""

from __future__ import annotations

import select
import socket

from tactuator.errors import BadInput
from tactuator.rig.transport.transport import LinkDown

SCHEME = "socket://"
_OPEN_TIMEOUT_S, _SEND_TIMEOUT_S = 5.0, 5.0
_RECEIVE_BYTES = 1 << 16


class SocketLink:
    """Bytes over a connected socket, which it closes in the end."""

    def __init__(self, connected: socket.socket) -> None:
        self._socket = connected
        self._socket.settimeout(_SEND_TIMEOUT_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def send(self, content: bytes) -> None:
        """Send all bytes; raises LinkDown if nobody takes them."""
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
            content = self._socket.recv(_RECEIVE_BYTES)
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

    Raises BadInput if it is not such an address, and LinkDown if nobody listens there.
    """
    host, _, port = url.removeprefix(SCHEME).rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 1 << 16:
        raise BadInput(f"port {url!r} cannot be opened", "socket://host:port, with a port from 1 to 65535")
    try:
        return SocketLink(socket.create_connection((host.strip("[]"), int(port)), _OPEN_TIMEOUT_S))
    except OSError as error:
        raise LinkDown(f"port {url!r} cannot be opened ({error})", "one where a board listens") from None


def _down(why: str) -> LinkDown:
    return LinkDown(f"the port has vanished ({why})", "a board that stays connected")
