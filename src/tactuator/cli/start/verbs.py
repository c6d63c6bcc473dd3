"""The verb that writes files to start from, as the command line spells it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactuator.cli.deferred import Verbs, does
from tactuator.cli.options import AsJson
from tactuator.io.start.template import DISPLAY_KINDS, PROTOCOL_KINDS


@does("start.init:run", reads=["model"])
def init(
    like: Annotated[str | None, typer.Option("--like", help=f"Actuator: {', '.join(DISPLAY_KINDS)}.")] = None,
    model: Annotated[Path | None, typer.Option("--from", help="Model file of `identify`: it is the plant.")] = None,
    out: Annotated[Path, typer.Option("--out", help="Display file to write.")] = Path("display.toml"),
    protocol: Annotated[
        str | None, typer.Option("--protocol", help=f"Write a protocol, too: {', '.join(PROTOCOL_KINDS)}.")
    ] = None,
    examples: Annotated[
        Path | None, typer.Option("--examples", help="Copy the examples into this folder, and write nothing else.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write a commented display file (and a protocol) to start from, or copy out the examples."""


VERBS: Verbs = {"init": init}
