"""The verb `experiment`: detection and identification, with people or with observers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from tactuator.cli.answer import answer, progress
from tactuator.cli.experiment import identification, simulate
from tactuator.cli.experiment.apparatus import opened_apparatus
from tactuator.cli.experiment.observers import LapseOption, TruthOption, lapses_of, truths_of
from tactuator.cli.experiment.results import results
from tactuator.cli.experiment.serve import serve
from tactuator.cli.options import AsJson, ControllerOption, DisplayOption, Out, RigOption, Seed
from tactuator.experiment.export.export import export
from tactuator.experiment.protocol.file import read_protocol
from tactuator.experiment.session.clock import SystemClock
from tactuator.experiment.simulated.sitting import run_study, simulated_observers, with_truths
from tactuator.experiment.store.lock import sessions_of
from tactuator.experiment.store.store import Store
from tactuator.rig.touchable import touchable

experiment = typer.Typer(
    name="experiment",
    help="Detection and identification: run, simulate, analyse, export.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


def register(app: typer.Typer) -> None:
    """Add the verb to the application."""
    identification.register(experiment)
    simulate.register(experiment)
    app.add_typer(experiment)


ProtocolFile = Annotated[Path, typer.Argument(help="Protocol file (TOML).", metavar="PROTOCOL")]
StoreFile = Annotated[Path, typer.Option("--store", help="Database of the experiment (SQLite).")]


@experiment.command("serve")
def serve_command(
    protocol: ProtocolFile,
    store: StoreFile,
    rig: RigOption = "simulated",
    display: DisplayOption = None,
    controller: ControllerOption = None,
    host: Annotated[
        str, typer.Option(help="Address to listen at; another than loopback lets others in.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port; 0: any that is free.")] = 8765,
    operator_token: Annotated[str | None, typer.Option(help="The operator's token; default: a fresh one.")] = None,
    speed: Annotated[
        float, typer.Option(help="Speed of presentation on a rig that could go faster; 0: as fast as it can.")
    ] = 1.0,
    auto_start: Annotated[bool, typer.Option("--auto-start", help="Subjects may begin without the operator.")] = False,
    amend: Annotated[
        str | None, typer.Option("--amend", help="Why the protocol says something else than before: a new version.")
    ] = None,
    show: Annotated[
        bool, typer.Option("--show/--no-show", help="Show stimuli on the page where the display is simulated.")
    ] = True,
    seed: Seed = 0,
) -> None:
    """Serve the study to browsers: one page for every subject, one for the operator.

    Without a display or controller file: the paper's display and C. A study is known by its name; further subjects in
    its protocol are enrolled, anything else that changed takes --amend.
    """
    with opened_apparatus(rig, display, controller, seed, speed or None) as place:
        serve(protocol, store, place, host, port, operator_token, auto_start, amend, show)


@experiment.command("observe")
def observe_command(
    protocol: ProtocolFile,
    store: StoreFile,
    rig: RigOption = "simulated",
    display: DisplayOption = None,
    controller: ControllerOption = None,
    load: Annotated[str | None, typer.Option(help="Load on the display's port while a finger is there.")] = "finger",
    truth: TruthOption = None,
    lapse: LapseOption = None,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Let simulated subjects go through the study at the simulated display; they feel what the loop makes of it."""
    read, text = read_protocol(protocol)
    truths, lapses = truths_of(truth or []), lapses_of(lapse or [])
    with sessions_of(store), opened_apparatus(rig, display, controller, seed, None) as place, progress() as bars:
        touchable(place.rig, place.name)
        curve = place.controller.display.channels[0].threshold.curve
        drawn = simulated_observers(curve, len(read.subject), seed, place.band_hz)
        observers = with_truths(drawn, [subject.code for subject in read.subject], curve, truths, lapses)
        database = Store(store)
        task = bars.add_task("observers", total=1000 * len(observers))
        at = {one.name: index for index, one in enumerate(observers)}
        run_study(
            database,
            read,
            text,
            place,
            observers,
            SystemClock(),
            load,
            lambda name, share: bars.update(task, completed=round(1000 * (at[name] + share))),
        )
        database.close()
    true = [
        {"subject": subject.code, "frequency_hz": hertz, "true_db_re_1um": float(one.curve.level_db_re_1um_at(hertz))}
        for subject, one in zip(read.subject, observers, strict=True)
        for hertz in read.conditions.frequencies_hz or np.geomspace(*place.band_hz, 12).round(3).tolist()
    ]
    table = Table("subject", "Hz", "truth, dB re 1 µm")
    for row in true:
        table.add_row(str(row["subject"]), f"{row['frequency_hz']:g}", f"{row['true_db_re_1um']:.2f}")
    answer({"store": str(store), "truth": true}, as_json, table)


@experiment.command("thresholds")
def thresholds_command(
    store: StoreFile,
    group: Annotated[str | None, typer.Option(help="Only subjects of this group.")] = None,
    reference: Annotated[str | None, typer.Option(help="Curve (name or CSV) that 0 dB SL stood for.")] = None,
    curve_out: Annotated[Path | None, typer.Option(help="Write the curve across subjects (CSV) for `design`.")] = None,
    figure_out: Annotated[
        Path | None, typer.Option(help="Folder for fig11 and a plate of psychometric functions for every subject.")
    ] = None,
    keep_flagged: Annotated[
        bool, typer.Option("--keep-flagged", help="Take flagged runs into the curve across subjects as well.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Refit thresholds of every finished run, with flags, and the curve across subjects."""
    found, table = results(store, group, reference, curve_out, figure_out, keep_flagged)
    answer(found, as_json, table)


@experiment.command("export")
def export_command(
    store: StoreFile,
    out: Out,
    form: Annotated[str, typer.Option("--format", help="tidy, psych-ds or bids.")] = "tidy",
    as_json: AsJson = False,
) -> None:
    """Write every answered trial in an open format, with its data dictionary."""
    database = Store(store, must_exist=True)
    try:
        count = export(database, out, form)
    finally:
        database.close()
    table = Table("folder", "trials")
    table.add_row(str(out), str(count))
    answer({"folder": str(out), "format": form, "trials": count}, as_json, table)
