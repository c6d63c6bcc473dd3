"""The socket on which the server listens, and how many connections it takes."""

from __future__ import annotations

import socket
from typing import Any
from weakref import WeakKeyDictionary

from tactuator.errors import BadInput

CONNECTIONS_MAX, CONNECTIONS_PER_ADDRESS_MAX = 256, 64
"""Open connections in all and from one address: descriptors are left for the store and the rig."""
_BACKLOG = 128


class Listener(socket.socket):
    """A listening socket that ends every connection beyond the limits at once.

    They count from the moment they are taken: before an encrypted one has done its handshake, which costs the server
    more than anything that a connection may ask for, and may never be finished.
    """

    def __init__(self, family: int) -> None:
        super().__init__(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        self._taken: WeakKeyDictionary[socket.socket, str] = WeakKeyDictionary()

    def accept(self) -> tuple[socket.socket, Any]:
        """Take the next connection. Raises ConnectionAbortedError where it is beyond the limits, so that the event loop
        turns to what else there is before the next one.
        """
        made, address = super().accept()
        theirs = [where for one, where in self._taken.items() if one.fileno() >= 0]
        if len(theirs) >= CONNECTIONS_MAX or theirs.count(address[0]) >= CONNECTIONS_PER_ADDRESS_MAX:
            made.close()
            raise ConnectionAbortedError
        self._taken[made] = address[0]
        return made, address


def listener(host: str, port: int) -> Listener:
    """Return a listening TCP socket; port 0: any that is free. Raises BadInput where it cannot listen there.

    Whoever connects before the server has come up waits. The protocol is named because asyncio sends small messages at
    once (TCP_NODELAY) only on sockets that say they are TCP; without it each message waits 40 ms for the one before.
    """
    if not 0 <= port <= 65535:
        raise BadInput(f"port {port}", "0 to 65535")
    made = Listener(socket.AF_INET6 if ":" in host else socket.AF_INET)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((host, port))
    except OSError as error:
        made.close()
        raise BadInput(f"address {host}, port {port}: {error.strerror or error}", "one that is free") from None
    made.listen(_BACKLOG)
    return made
