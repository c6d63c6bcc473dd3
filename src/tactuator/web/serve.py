"""The command `experiment serve`: the study in a browser."""

import os
import secrets
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Annotated

from tactuator.api.experiment import ProtocolFile, StoreFile, opened_apparatus
from tactuator.api.option import Option
from tactuator.api.parameters import (
    AllowedHosts,
    ControllerOption,
    DisplayOption,
    Host,
    Lsl,
    Place,
    RigOption,
    Seed,
    TlsCertificate,
    TlsKey,
)
from tactuator.errors import BadInput, within
from tactuator.experiment.protocol.file import read_protocol
from tactuator.experiment.protocol.study import StudyProtocol
from tactuator.experiment.session.studies import fresh_token, open_study, task_of
from tactuator.experiment.session.task import SystemClock
from tactuator.experiment.store.store import opened_store, sessions_of
from tactuator.io.text import read_text
from tactuator.web.lab import Lab
from tactuator.web.server import Address, run_server
from tactuator.web.study_pages import build_app

TOKEN_VARIABLE = "TACTUATOR_OPERATOR_TOKEN"
_SHORTEST_TOKEN = 16


def serve(
    protocol: ProtocolFile,
    store: StoreFile,
    rig: RigOption = "simulated",
    display: DisplayOption = None,
    controller: ControllerOption = None,
    host: Host = "127.0.0.1",
    port: Annotated[int, Option("Port; 0: any that is free.")] = 8765,
    allowed_host: AllowedHosts = None,
    tls_certificate: TlsCertificate = None,
    tls_key: TlsKey = None,
    operator_token_file: Annotated[
        Place | None,
        Option("A line with a token for each operator; default: TACTUATOR_OPERATOR_TOKEN, or fresh.", type=Path | None),
    ] = None,
    speed: Annotated[float, Option("Speed of presentation; 0: as fast as possible.")] = 1.0,
    operator: Annotated[list[str] | None, Option("Name of an operator, for the log.", metavar="NAME")] = None,
    auto_start: Annotated[bool, Option("Subjects may begin without the operator.")] = False,
    amend: Annotated[str | None, Option("Why the protocol changed; stored as a new version.")] = None,
    show: Annotated[
        bool, Option("Show stimuli on the page where the display is simulated.", ("--show/--no-show",))
    ] = True,
    lsl: Lsl = False,
    seed: Seed = 0,
) -> None:
    """Serve the study to browsers. Runs until interrupted; the addresses of subjects and operator go to standard error.
    Without a display or controller file: the paper's display and C. A changed protocol needs `amend`, unless it only
    adds subjects.

    Raises BadInput where another process runs the sessions of the store.
    """
    folder = Path(protocol).parent
    certificate, key = (None if place is None else Path(place) for place in (tls_certificate, tls_key))
    address = Address(host, port, tuple(allowed_host or ()), certificate, key)
    opened = opened_apparatus(rig, display, controller, seed, speed or None, lsl)
    with opened as apparatus, sessions_of(store):
        study_protocol, text = read_protocol(Path(protocol), StudyProtocol)
        tokens = None if operator_token_file is None else Path(operator_token_file)
        names = operator or [study_protocol.study.experimenter or "operator"]
        operators = {_operator_token(tokens, line): name for line, name in enumerate(names)}
        task = task_of(study_protocol, folder, apparatus)
        with address.listen() as listening, opened_store(store) as database:
            study = open_study(database, task, text, SystemClock(), fresh_token, amend, folder, names[0])
            with closing(Lab(study, auto_start, "seen or heard" if show and apparatus.simulated else "")) as lab:
                run_server(build_app(lab, operators), address, listening, lambda base: _links(lab, base, operators))


def _links(lab: Lab, base: str, operators: Mapping[str, str]) -> list[str]:
    """Return each operator's and subject's address, and what the protocol warns of."""
    named = [f"operator {name}" for name in operators.values()] if len(operators) > 1 else ["operator"]
    lines = [f"{who}: {base}/operator#{token}" for who, token in zip(named, operators, strict=True)]
    for row in lab.sessions:
        visit = "" if row.visit == 1 else f", visit {row.visit}"
        lines.append(f"subject {row.subject_code}{visit}: {base}/s/{row.link_token}")
    warning = lab.study.task.protocol.warning
    return [*lines, warning] if warning else lines


def _operator_token(path: Path | None, line: int = 0) -> str:
    """Return the token of a line of the file, of the environment (the first), or a fresh one; never of the command
    line, which every user of the machine can read. Raises BadInput for one that may be guessed.
    """
    with within(f"token file {path}"):
        tokens = [os.environ.get(TOKEN_VARIABLE)] if path is None else [*read_text(path).splitlines(), ""]
    given = tokens[line] if line < len(tokens) else "" if path else None
    if given is None:
        return secrets.token_urlsafe(_SHORTEST_TOKEN)
    given = given.strip()
    if len(given) < _SHORTEST_TOKEN or not given.isascii() or not given.isprintable() or " " in given:
        raise BadInput(
            f"the operator's token has {len(given)} characters", f"{_SHORTEST_TOKEN} or more, ASCII, no space"
        )
    return given
