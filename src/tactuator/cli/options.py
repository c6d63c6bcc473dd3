"""Options that every verb spells the same way."""

from pathlib import Path
from typing import Annotated

import typer

AsJson = Annotated[bool, typer.Option("--json", help="Print exactly one JSON object on standard output.")]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Seed of all randomness; the same seed, the same result.")]
Out = Annotated[Path, typer.Option("--out", help="File or folder to write.")]
