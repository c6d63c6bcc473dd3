"""The verbs from records to models, as the command line spells them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactuator.cli.deferred import Verbs, does
from tactuator.cli.model import identify_options as o
from tactuator.cli.options import AsJson, FiguresOption, RigOption, Seed


@does("model.calibrate:run", reads=["pairs"])
def calibrate(
    pairs: Annotated[Path, typer.Argument(help="CSV with columns displacement_mm, voltage_v and, if any, name.")],
    gauge_error_mm: Annotated[float, typer.Option("--gauge-error-mm", help="Standard error of the gauge.")] = 0.0,
    strict: Annotated[bool, typer.Option("--strict", help="Stop where a pair is off the line.")] = False,
    as_json: AsJson = False,
) -> None:
    """Estimate sensor gain, offset and linearity with confidence; pairs off the line are refused, each
    by its name.
    """


@does("model.record:run", reads=["display"])
def record_verb(
    display: Annotated[Path, typer.Argument(help="Display file (TOML).")],
    channel: Annotated[str | None, typer.Option("--channel", help="Channel (default: the first).")] = None,
    out: Annotated[Path, typer.Option("--out", help="Record to write (HDF5).")] = Path("record.h5"),
    duration_s: Annotated[float, typer.Option("--duration-s", help="Seconds.")] = 60.0,
    excitation: Annotated[str, typer.Option("--excitation", help="mix, steps, noise, prbs, chirp, multisine.")] = "mix",
    travel_share: Annotated[float, typer.Option("--travel-share", help="Share of the travel used.")] = 0.5,
    load: Annotated[str, typer.Option("--load", help="Load of the display file, or none.")] = "none",
    rig: RigOption = "simulated",
    seed: Seed = 0,
    periods: Annotated[int, typer.Option("--periods", help="Of each multisine; the first one settles.")] = 3,
    realisations: Annotated[int, typer.Option("--realisations", help="Multisines of new phases.")] = 4,
    as_json: AsJson = False,
) -> None:
    """Drive one channel with an excitation planned within travel and range, and write the record."""


@does("model.identify:run", reads=["records", "validate"])
def identify_verb(
    records: o.RecordPaths,
    input_name: o.Input = None,
    output_name: o.Output = None,
    reference_name: o.Reference = None,
    time_name: o.Time = None,
    rate_hz: o.RateHz = None,
    from_s: o.FromS = None,
    to_s: o.ToS = None,
    order: o.Order = None,
    zeros: o.Zeros = None,
    integrators: o.Integrators = 0,
    delay_s: o.DelayS = None,
    fix: o.Fix = None,
    hold: o.Hold = "auto",
    method: o.Method = "refined",
    quantity: o.Quantity = "displacement",
    forgetting: o.Forgetting = 1.0,
    friction: o.LookForFriction = True,
    validate: o.Validate = None,
    out: o.Out = None,
    figures: FiguresOption = None,
    as_json: AsJson = False,
) -> None:
    """Identify a continuous model of a recorded mechanism, with its confidence band."""


VERBS: Verbs = {"calibrate": calibrate, "record": record_verb, "identify": identify_verb}
