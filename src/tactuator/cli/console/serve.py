"""The verb `console`: the page of the chain, served to this machine."""

from __future__ import annotations

import os
import secrets
import signal
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path

import uvicorn

from tactuator.console.app import build_console
from tactuator.console.workshop import Workshop
from tactuator.web.listener import listener
from tactuator.web.serving import server_config

_TOKEN_BYTES = 16
_LOOPBACK = ("127.0.0.1", "localhost", "::1")
_NICER = 5


def run(display: Path | None, host: str, port: int) -> None:
    """Serve a page on which a loop is shaped by dragging it, until interrupted; its address goes to standard error."""
    workshop, token = Workshop(display), secrets.token_urlsafe(_TOKEN_BYTES)
    sock = listener(host, port)
    with _figures_apart() as apart:
        app = build_console(workshop, token, apart)
        server = uvicorn.Server(server_config(app, time.monotonic, host=host, port=port))
        named = f"[{host}]" if ":" in host else host
        lines = [f"console: http://{named}:{sock.getsockname()[1]}/#token={token}"]
        if host not in _LOOPBACK:
            lines.append("anyone who can reach this machine can reach this page; the connection is not encrypted")
        sys.stderr.write("\n".join(lines) + "\n")
        sys.stderr.flush()
        server.run(sockets=[sock])


@contextmanager
def _figures_apart() -> Iterator[ProcessPoolExecutor]:
    """Yield a process in which figures are computed, so that a drag's frames have the interpreter to themselves."""
    apart = ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=_begin)
    try:
        apart.submit(int)  # it imports while the reader opens the page
        yield apart
    finally:
        apart.shutdown(wait=False, cancel_futures=True)


def _begin() -> None:
    """Leave interrupts to the server, and the processor to whoever draws."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(_NICER)
