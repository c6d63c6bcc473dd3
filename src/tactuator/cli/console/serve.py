"""The verb `console`: the page of the chain, served to this machine."""

from __future__ import annotations

import secrets
import sys
import time
from pathlib import Path

import uvicorn

from tactuator.console.app import build_console
from tactuator.console.workshop import Workshop
from tactuator.web.listener import listener
from tactuator.web.serving import server_config

_TOKEN_BYTES = 16
_LOOPBACK = ("127.0.0.1", "localhost", "::1")


def run(display: Path | None, host: str, port: int) -> None:
    """Serve a page on which a loop is shaped by dragging it, until interrupted; its address goes to standard error."""
    workshop, token = Workshop(display), secrets.token_urlsafe(_TOKEN_BYTES)
    sock = listener(host, port)
    server = uvicorn.Server(server_config(build_console(workshop, token), time.monotonic, host=host, port=port))
    named = f"[{host}]" if ":" in host else host
    lines = [f"console: http://{named}:{sock.getsockname()[1]}/#token={token}"]
    if host not in _LOOPBACK:
        lines.append("anyone who can reach this machine can reach this page; the connection is not encrypted")
    sys.stderr.write("\n".join(lines) + "\n")
    sys.stderr.flush()
    server.run(sockets=[sock])
