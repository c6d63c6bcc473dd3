"""The end of the console's server: within a bounded time, the rig at rest first, whatever is still being computed."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable

import uvicorn

CONNECTIONS_S = 2.0
"""Time in which the pages have to let go of their connections."""
PATIENCE_S = 3.0
"""Time for what is still computed when all that has to be closed is closed; then the program ends without it."""


class ConsoleServer(uvicorn.Server):
    """A server that closes the rig before it waits for anybody's answer.

    close: closes it; may take its time, and may be called again. forget: called at the very end of a program that is
    cut off. What is computed for a page may take half a minute and can neither be interrupted nor be of use to anybody:
    the program does not wait for it.
    """

    def __init__(self, config: uvicorn.Config, close: Callable[[], None], forget: Callable[[], None]) -> None:
        config.timeout_graceful_shutdown = round(CONNECTIONS_S)
        super().__init__(config)
        self._close, self._forget = close, forget

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End the connections and the application, close the rig, and set the time in which the rest has to end."""
        logging.getLogger("uvicorn.error").addFilter(_is_no_cancelling)
        await super().shutdown(sockets)
        closing = threading.Thread(target=self._close)
        closing.start()  # the threads of the loop may all be at work for pages
        while closing.is_alive():
            await asyncio.sleep(0.02)
        cut_off = threading.Timer(PATIENCE_S, self._cut_off)
        cut_off.daemon = True
        cut_off.start()

    def _cut_off(self) -> None:
        self._forget()
        sys.stderr.flush()
        os._exit(128 + (self._captured_signals or [signal.SIGINT])[0])


def _is_no_cancelling(record: logging.LogRecord) -> bool:
    """Return False for what the log says of connections that are ended on purpose."""
    of_cancelling = record.exc_info is not None and record.exc_info[0] is asyncio.CancelledError
    return not of_cancelling and "graceful shutdown exceeded" not in str(record.msg)
