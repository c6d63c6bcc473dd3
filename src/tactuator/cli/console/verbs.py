"""The verb that opens the console, as the command line spells it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactuator.cli.deferred import Verbs, does
from tactuator.cli.options import AllowedHosts, Host, Seed, TlsCertificate, TlsKey


@does("console.serve:run", reads=["display"])
def console(
    display: Annotated[Path | None, typer.Argument(help="Display file (TOML); without one: the examples.")] = None,
    rig: Annotated[
        str | None,
        typer.Option("--rig", help="Rig of the scope: simulated, in-process, emulated:BOARD, board:URL, sound:DEVICE."),
    ] = None,
    seed: Seed = 0,
    host: Host = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port; 0: any that is free.")] = 8770,
    allowed_host: AllowedHosts = None,
    tls_certificate: TlsCertificate = None,
    tls_key: TlsKey = None,
) -> None:
    """Serve a page on which a loop is shaped by dragging it, and a rig is watched and driven, until interrupted; its
    address goes to standard error.
    """


VERBS: Verbs = {"console": console}
