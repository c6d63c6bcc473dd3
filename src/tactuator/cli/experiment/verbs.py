"""The parts of the verb `experiment`, as the command line spells them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactuator.cli.deferred import Verbs, does
from tactuator.cli.options import (
    AllowedHosts,
    AsJson,
    ControllerOption,
    DisplayOption,
    FiguresOption,
    Host,
    Out,
    RigOption,
    Seed,
    TlsCertificate,
    TlsKey,
)

ProtocolFile = Annotated[Path, typer.Argument(help="Protocol file (TOML).", metavar="PROTOCOL")]
StoreFile = Annotated[Path, typer.Option("--store", help="Database of the experiment (SQLite).")]
TruthOption = Annotated[
    list[str] | None,
    typer.Option("--truth", metavar="SUBJECT=CSV", help="A subject's threshold (frequency_hz,level_db_sl)."),
]
LapseOption = Annotated[
    list[str] | None, typer.Option("--lapse", metavar="SUBJECT=RATE", help="A subject's lapse rate; repeatable.")
]


@does("experiment.study:serve_study", reads=["protocol", "display", "controller"])
def serve(
    protocol: ProtocolFile,
    store: StoreFile,
    rig: RigOption = "simulated",
    display: DisplayOption = None,
    controller: ControllerOption = None,
    host: Host = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port; 0: any that is free.")] = 8765,
    allowed_host: AllowedHosts = None,
    tls_certificate: TlsCertificate = None,
    tls_key: TlsKey = None,
    operator_token_file: Annotated[
        Path | None,
        typer.Option(help="File with the operator's token; default: TACTUATOR_OPERATOR_TOKEN, or a fresh one."),
    ] = None,
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


@does("experiment.enrol:run", reads=["store"])
def enrol(
    code: Annotated[str, typer.Argument(help="Code of the subject: letters and digits.", metavar="CODE")],
    store: StoreFile,
    study: Annotated[
        str | None, typer.Option("--study", help="Name of the study; default: the store's only one.")
    ] = None,
    group: Annotated[
        str | None, typer.Option(help="hearing, hearing-impaired, simulated or unknown (the default).")
    ] = None,
    participant_id: Annotated[str | None, typer.Option(help="The subject's name elsewhere.")] = None,
    skin_temperature_c: Annotated[float | None, typer.Option(help="Skin temperature of the day, °C.")] = None,
    fact: Annotated[
        list[str] | None, typer.Option("--fact", metavar="NAME=VALUE", help="An item of [[demographic]]; repeatable.")
    ] = None,
    visit: Annotated[bool, typer.Option("--visit", help="A further visit of a subject who is enrolled.")] = False,
    as_json: AsJson = False,
) -> None:
    """Add a subject to a study of the store, or a further visit of one, and show the links of all visits."""


@does("experiment.enrol:correct", reads=["store"])
def correct(
    code: Annotated[str, typer.Argument(help="Code of the subject.", metavar="CODE")],
    store: StoreFile,
    reason: Annotated[str, typer.Option("--reason", help="Why: it is kept with what stood there before.")],
    study: Annotated[
        str | None, typer.Option("--study", help="Name of the study; default: the store's only one.")
    ] = None,
    group: Annotated[str | None, typer.Option(help="hearing, hearing-impaired, simulated or unknown.")] = None,
    participant_id: Annotated[str | None, typer.Option(help="The subject's name elsewhere.")] = None,
    visit: Annotated[int | None, typer.Option(help="Visit of the data of the day; default: the only one.")] = None,
    skin_temperature_c: Annotated[float | None, typer.Option(help="Skin temperature of the day, °C.")] = None,
    preload_n: Annotated[float | None, typer.Option(help="Contact force of the day, N.")] = None,
    fact: Annotated[
        list[str] | None,
        typer.Option("--fact", metavar="NAME=VALUE", help="An item of [[demographic]]; NAME= takes it away."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write correct data of a subject or a visit; what stood there stays in the store and in exports."""


@does("experiment.study:observe", reads=["protocol", "display", "controller"])
def observe(
    protocol: ProtocolFile,
    store: StoreFile,
    rig: RigOption = "simulated",
    display: DisplayOption = None,
    controller: ControllerOption = None,
    load: Annotated[
        str | None,
        typer.Option(help="Load while a finger is there, or none (default: finger, or the first)."),
    ] = None,
    truth: TruthOption = None,
    lapse: LapseOption = None,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Let simulated subjects go through the study at the simulated display; they feel what the loop makes of it."""


@does("experiment.study:show_thresholds", reads=["store"])
def thresholds(
    store: StoreFile,
    group: Annotated[str | None, typer.Option(help="Only subjects of this group.")] = None,
    reference: Annotated[str | None, typer.Option(help="Curve (name or CSV) that 0 dB SL stood for.")] = None,
    curve_out: Annotated[Path | None, typer.Option(help="Write the curve across subjects (CSV) for `design`.")] = None,
    figures: FiguresOption = None,
    keep_flagged: Annotated[
        bool, typer.Option("--keep-flagged", help="Take flagged runs into the curve across subjects as well.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Refit thresholds of every finished run, with flags, and the curve across subjects."""


@does("experiment.study:write_export", reads=["store"])
def export(
    store: StoreFile,
    out: Out,
    form: Annotated[str, typer.Option("--format", help="tidy, psych-ds or bids.")] = "tidy",
    as_json: AsJson = False,
) -> None:
    """Write every answered trial in an open format, with its data dictionary."""


@does("experiment.recognition:recognise_items", reads=["protocol", "display", "controller"])
def recognise(
    protocol: Annotated[Path, typer.Argument(help="Recognition protocol (TOML).", metavar="PROTOCOL")],
    store: Annotated[Path, typer.Option("--store", help="Database of the experiment (SQLite).")],
    subject: Annotated[
        str | None, typer.Option("--subject", help="Code of the subject; default: the only one.")
    ] = None,
    display: DisplayOption = None,
    controller: ControllerOption = None,
    rig: RigOption = "simulated",
    scripted_error: Annotated[
        float | None, typer.Option("--scripted-error", help="A script answers for the subject, wrong at this rate.")
    ] = None,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Take a subject through a recognition experiment at the terminal; it goes on where it stopped."""


@does("experiment.recognition:transfer", reads=["store", "matrix"])
def information(
    store: Annotated[Path | None, typer.Option("--store", help="Database of recognition experiments.")] = None,
    matrix: Annotated[
        Path | None, typer.Option("--matrix", help="A confusion matrix of your own (CSV): a row a stimulus.")
    ] = None,
    study: Annotated[str | None, typer.Option("--study", help="Only the study of this name.")] = None,
    seconds: Annotated[
        float | None, typer.Option("--seconds", help="With --matrix: seconds a stimulus, for bits per second.")
    ] = None,
    draws: Annotated[int, typer.Option("--draws", min=100, help="Of the posterior, for the interval.")] = 1000,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Estimate information transfer in five ways, one with an interval, from a store's studies or any matrix."""


@does("experiment.simulate:run", reads=["truth"])
def simulate(
    procedure: Annotated[str, typer.Option(help="imece2004, quest-plus or curve.")] = "imece2004",
    runs: Annotated[int, typer.Option(help="Simulated runs.")] = 1000,
    slope: Annotated[str, typer.Option(help="Weibull slope, or LOW:HIGH to draw each run's from.")] = "2.5",
    lapse: Annotated[float, typer.Option(help="Lapse rate.")] = 0.0,
    start_db: Annotated[float, typer.Option(help="Start, dB above the true threshold.")] = 20.0,
    trials: Annotated[int | None, typer.Option(help="Trials of a run (quest-plus 48, curve 150).")] = None,
    truth: Annotated[
        Path | None,
        typer.Option(help="curve: everybody's threshold, a CSV with frequency_hz,level_db_sl (default: drawn)."),
    ] = None,
    guess: Annotated[float, typer.Option(help="Share of trials that are guessed outright; 1: all.")] = 0.0,
    drift_db: Annotated[float, typer.Option(help="Rise of thresholds over the run, dB.")] = 0.0,
    loud_share: Annotated[float, typer.Option(help="Share of loud catch trials, as in [catch].")] = 0.0,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Run a procedure many times against a Weibull observer and say how good its estimates are."""


VERBS: Verbs = {
    "experiment serve": serve,
    "experiment enrol": enrol,
    "experiment correct": correct,
    "experiment observe": observe,
    "experiment thresholds": thresholds,
    "experiment export": export,
    "experiment recognise": recognise,
    "experiment information": information,
    "experiment simulate": simulate,
}
