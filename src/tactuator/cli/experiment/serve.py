"""The verb `experiment serve`: the study in a browser."""

from __future__ import annotations

import os
import secrets
import sys
import time
from contextlib import closing
from pathlib import Path

import uvicorn

from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import read_any_protocol
from tactuator.experiment.session.studies import fresh_token, open_study, task_of
from tactuator.experiment.session.task import Apparatus, SystemClock
from tactuator.experiment.store.records import Found
from tactuator.experiment.store.store import opened_store, sessions_of
from tactuator.io.formats.text import read_text
from tactuator.web.address import Address
from tactuator.web.app import build_app
from tactuator.web.lab import Lab

TOKEN_VARIABLE = "TACTUATOR_OPERATOR_TOKEN"
_SHORTEST_TOKEN = 16


def serve(
    protocol_path: Path,
    store_path: Path,
    apparatus: Apparatus,
    address: Address,
    token_file: Path | None,
    auto_start: bool,
    amend: str | None = None,
    show: bool = True,
) -> None:
    """Serve until interrupted. Addresses go to standard error, a line each: the operator's, then each subject's.

    token_file: its first line is the operator's token. amend: why the protocol is another than before. show: stimuli of
    a simulated display are shown on the page. Raises BadInput where another process runs the sessions of the store.
    """
    with sessions_of(store_path):
        operator_token = _operator_token(token_file)
        protocol, text = read_any_protocol(protocol_path)
        task = task_of(protocol, protocol_path.parent, apparatus)
        with closing(address.listen()) as sock, opened_store(store_path) as store:
            study = open_study(store, task, text, SystemClock(), fresh_token, amend, protocol_path.parent)
            lab = Lab(study, auto_start, "seen or heard" if show and apparatus.simulated else "")
            server = uvicorn.Server(address.config(build_app(lab, operator_token), time.monotonic))
            _tell(lab, address, address.base_url(sock), operator_token)
            try:
                server.run(sockets=[sock])
            finally:
                lab.close()


def _tell(lab: Lab, address: Address, base: str, operator_token: str) -> None:
    """Write the addresses to standard error."""
    lines = [f"operator: {base}/operator#{operator_token}"]
    lines += [f"{_who(row)}: {base}/s/{row.link_token}" for row in lab.sessions]
    if address.warning:
        lines.append(address.warning)
    sys.stderr.write("\n".join(lines) + "\n")
    sys.stderr.flush()


def _operator_token(path: Path | None) -> str:
    """Return the token of the file's first line, of the environment, or a fresh one; never of the command line, which
    every user of the machine can read. Raises BadInput for one that may be guessed.
    """
    try:
        given = os.environ.get(TOKEN_VARIABLE) if path is None else read_text(path).partition("\n")[0].strip()
    except BadInput as error:
        raise BadInput(f"token file {path}: {error}", "a text file") from None
    if given is None:
        return secrets.token_urlsafe(_SHORTEST_TOKEN)
    if len(given) < _SHORTEST_TOKEN or not given.isascii() or not given.isprintable() or " " in given:
        raise BadInput(
            f"the operator's token has {len(given)} characters", f"{_SHORTEST_TOKEN} or more, ASCII, no space"
        )
    return given


def _who(row: Found) -> str:
    return f"subject {row.subject_code}" if row.visit == 1 else f"subject {row.subject_code}, visit {row.visit}"
