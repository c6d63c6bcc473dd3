"""A board with a simulated display behind a socket of this machine, which tells afterwards how it was left."""

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from tactuator.rig.transport import InProcess


class BoardAtPort:
    """The board of this process, served to one client after another."""

    def __init__(self) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self.url = f"socket://127.0.0.1:{self._server.getsockname()[1]}"
        self.transport = InProcess()
        self._client: socket.socket | None = None
        self.left = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        while True:
            try:
                self._client, _ = self._server.accept()
            except OSError:
                return
            self.left.clear()
            try:
                while content := self._client.recv(1 << 16):
                    self.transport.send(content)
                    self._client.sendall(self.transport.receive(0.0))
            except OSError:
                pass
            finally:
                self._client.close()
            self.left.set()

    def vanish(self) -> None:
        """Close the port in the middle of whatever goes on; nobody can come back."""
        self._server.close()
        if self._client is not None:
            with suppress(OSError):  # it has gone by itself
                self._client.shutdown(socket.SHUT_RDWR)
        self._thread.join(timeout=10.0)


@contextmanager
def board_at_port() -> Iterator[BoardAtPort]:
    board = BoardAtPort()
    try:
        yield board
    finally:
        board.vanish()
