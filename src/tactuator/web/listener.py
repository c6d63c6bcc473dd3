"""The socket on which the server listens."""

from __future__ import annotations

import socket

from tactuator.errors import BadInput

_BACKLOG = 128


def listener(host: str, port: int) -> socket.socket:
    """Return a listening TCP socket; port 0: any that is free. Raises BadInput where it cannot listen there.

    Whoever connects before the server has come up waits. The protocol is named because asyncio sends small messages at
    once (TCP_NODELAY) only on sockets that say they are TCP; without it each message waits 40 ms for the one before.
    """
    if not 0 <= port <= 65535:
        raise BadInput(f"port {port}; allowed: 0 to 65535")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    made = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((host, port))
    except OSError as error:
        made.close()
        raise BadInput(f"address {host}, port {port}: {error.strerror or error}; allowed: one that is free") from None
    made.listen(_BACKLOG)
    return made
