"""The verb `experiment serve`: the study in a browser."""

from __future__ import annotations

import secrets
import sys
from pathlib import Path

import uvicorn

from tactuator.cli.experiment.terminal import fresh_token
from tactuator.experiment.protocol.file import read_any_protocol
from tactuator.experiment.session.apparatus import Apparatus
from tactuator.experiment.session.clock import SystemClock
from tactuator.experiment.session.studies import open_study, task_of
from tactuator.experiment.store.cells import Found
from tactuator.experiment.store.lock import sessions_of
from tactuator.experiment.store.store import Store
from tactuator.web.app import build_app
from tactuator.web.lab import Lab
from tactuator.web.listener import listener


def serve(
    protocol_path: Path,
    store_path: Path,
    apparatus: Apparatus,
    host: str,
    port: int,
    token: str | None,
    auto_start: bool,
    amend: str | None = None,
    show: bool = True,
) -> None:
    """Serve until interrupted. Addresses go to standard error, a line each: the operator's, then each subject's.

    amend: why the protocol is another than before; show: stimuli of a simulated display are shown on the page. Raises
    BadInput where another process runs the sessions of the store.
    """
    with sessions_of(store_path):
        _serve(protocol_path, store_path, apparatus, host, port, token, auto_start, amend, show)


def _serve(
    protocol_path: Path,
    store_path: Path,
    apparatus: Apparatus,
    host: str,
    port: int,
    token: str | None,
    auto_start: bool,
    amend: str | None,
    show: bool,
) -> None:
    protocol, text = read_any_protocol(protocol_path)
    task = task_of(protocol, protocol_path.parent, apparatus)
    sock = listener(host, port)
    store, clock = Store(store_path), SystemClock()
    study = open_study(store, task, text, clock, fresh_token, amend, protocol_path.parent)
    operator_token = secrets.token_urlsafe(16) if token is None else token
    lab = Lab(study, auto_start, "seen or heard" if show and apparatus.simulated else "")
    config = uvicorn.Config(
        build_app(lab, operator_token), host=host, port=port, log_level="warning", ws_max_size=65536
    )
    server = uvicorn.Server(config)
    base = f"http://{host}:{sock.getsockname()[1]}"
    lines = [f"operator: {base}/operator#{operator_token}"]
    lines += [f"{_who(row)}: {base}/s/{row.link_token}" for row in lab.sessions]
    if host not in ("127.0.0.1", "localhost", "::1"):
        lines.append("anyone who can reach this machine can reach these pages; the connection is not encrypted")
    sys.stderr.write("\n".join(lines) + "\n")
    sys.stderr.flush()
    try:
        server.run(sockets=[sock])
    finally:
        lab.close()
        store.close()


def _who(row: Found) -> str:
    return f"subject {row.subject_code}" if row.visit == 1 else f"subject {row.subject_code}, visit {row.visit}"
