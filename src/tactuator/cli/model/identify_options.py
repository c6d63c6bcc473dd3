"""The options of `tactuator identify`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

RecordPaths = Annotated[
    list[Path], typer.Argument(help="Record, or several of one mechanism: HDF5, CSV, MATLAB or WAV.")
]
Validate = Annotated[
    list[Path] | None,
    typer.Option("--validate", help="Record that the fit does not see, to hold the model against; may be repeated."),
]
Input = Annotated[str | None, typer.Option("--input", help="Column or variable of the command.")]
Output = Annotated[str | None, typer.Option("--output", help="Column or variable of the position.")]
Reference = Annotated[
    str | None,
    typer.Option("--reference", help="Column or variable of what a loop was asked for: it keeps the loop's noise out."),
]
Time = Annotated[str | None, typer.Option("--time", help="Column or variable of the time stamps.")]
RateHz = Annotated[float | None, typer.Option("--rate-hz", help="Sampling rate, where the file has none.")]
FromS = Annotated[float | None, typer.Option("--from-s", help="Use the record from here on.")]
ToS = Annotated[float | None, typer.Option("--to-s", help="Use the record up to here.")]
Order = Annotated[int | None, typer.Option("--order", help="Number of poles (default: chosen).")]
Zeros = Annotated[int | None, typer.Option("--zeros", help="Number of zeros (default: chosen).")]
Integrators = Annotated[int, typer.Option("--integrators", help="Poles known to lie at s = 0.")]
DelayS = Annotated[float | None, typer.Option("--delay-s", help="Dead time, where it is known (default: estimated).")]
Fix = Annotated[
    list[str] | None,
    typer.Option(
        "--fix",
        help="A value that is known, NAME=VALUE; may be repeated: gain (position over command at 0 Hz), stiffness (its "
        "inverse), mass (command over acceleration), pole=HERTZ, resonance=HERTZ,Q, num_sK and den_sK (coefficients as "
        "in the model file).",
    ),
]
Hold = Annotated[
    str,
    typer.Option(
        "--hold",
        help="The command between its samples: zero-order, first-order (held by a converter), band-limited (recorded "
        "through an anti-aliasing filter), or auto: the record tells.",
    ),
]
Method = Annotated[str, typer.Option("--method", help="refined, prediction (held only), rls (the paper's).")]
Quantity = Annotated[
    str, typer.Option("--quantity", help="What the position is: displacement, velocity, acceleration.")
]
Forgetting = Annotated[float, typer.Option("--forgetting", help="Of the recursion; 1 keeps everything.")]
LookForFriction = Annotated[bool, typer.Option("--friction/--no-friction", help="Estimate friction.")]
Out = Annotated[Path | None, typer.Option("--out", help="Model file to write (JSON).")]
