"""The verb of the paper's study, as the command line spells it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactuator.cli.deferred import Verbs, does
from tactuator.cli.options import AsJson, Seed


@does("paper.reproduce:run", reads=["speech"])
def reproduce(
    out: Annotated[Path, typer.Option("--out", help="Folder to write; replaced if it is a former report.")] = Path(
        "out/paper"
    ),
    speech: Annotated[Path | None, typer.Option("--speech", help="WAV or FLAC to present.")] = None,
    seed: Seed = 1,
    as_json: AsJson = False,
) -> None:
    """Run the paper's study on the simulated display: report.html, figures and summary.json in the folder."""


VERBS: Verbs = {"reproduce": reproduce}
