"""Options that every verb spells the same way."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

AsJson = Annotated[bool, typer.Option("--json", help="Print exactly one JSON object on standard output.")]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Seed of all randomness; the same seed, the same result.")]
Out = Annotated[Path, typer.Option("--out", help="File or folder to write.")]
DisplayOption = Annotated[
    Path | None, typer.Option("--display", help="Display file; a controller is designed for it if none is given.")
]
ControllerOption = Annotated[Path | None, typer.Option("--controller", help="Controller file that `design` wrote.")]
FiguresOption = Annotated[
    Path | None, typer.Option("--figures", help="Folder for the figures (SVG, and their numbers as CSV).")
]
RigOption = Annotated[
    str, typer.Option("--rig", help="simulated, in-process, emulated:BOARD, board:URL, sound:DEVICE.")
]
Host = Annotated[str, typer.Option(help="Address to listen at; another than loopback lets others in.")]
AllowedHosts = Annotated[
    list[str] | None,
    typer.Option(
        "--allowed-host", metavar="NAME", help="Host name to answer to beside the own ones (of a proxy); repeatable."
    ),
]
TlsCertificate = Annotated[
    Path | None, typer.Option(help="Certificate file (PEM) for an encrypted connection; with --tls-key.")
]
TlsKey = Annotated[Path | None, typer.Option(help="Key file (PEM) of the certificate, without a password.")]
