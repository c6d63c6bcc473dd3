"""tactuator experiment: thresholds measured with people, or with observers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from tactuator.cli.answer import answer, plain
from tactuator.cli.experiment_serve import serve
from tactuator.cli.experiment_station import station
from tactuator.cli.options import AsJson, Seed
from tactuator.errors import BadInput
from tactuator.experiment.quest_plus import QuestPlusRule
from tactuator.experiment.simulate import PROCEDURES, Setting, simulate
from tactuator.experiment.simulate_curve import simulate_curve
from tactuator.experiment.whole_curve import WholeCurveRule

experiment = typer.Typer(
    name="experiment", help="Thresholds: run, simulate, analyse, export.", no_args_is_help=True, rich_markup_mode=None
)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.add_typer(experiment)


@experiment.command("simulate")
def simulate_command(
    procedure: Annotated[str, typer.Option(help="imece2004, quest-plus or curve.")] = "imece2004",
    runs: Annotated[int, typer.Option(help="Simulated runs.")] = 1000,
    slope: Annotated[str, typer.Option(help="Weibull slope, or LOW:HIGH to draw each run's from.")] = "2.5",
    lapse: Annotated[float, typer.Option(help="Lapse rate.")] = 0.0,
    start_db: Annotated[float, typer.Option(help="Start, dB above the true threshold.")] = 20.0,
    trials: Annotated[int | None, typer.Option(help="Trials of a run (quest-plus 48, curve 150).")] = None,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Run a procedure many times against a Weibull observer and say how good its estimates are."""
    setting = Setting(runs, _slope_range(slope), lapse, start_db, seed)
    if procedure in PROCEDURES:
        if trials is not None:
            raise BadInput(f"--trials {trials} with {procedure}; allowed: with quest-plus and curve")
        result: Any = simulate(PROCEDURES[procedure], setting)
    elif procedure == "quest-plus":
        result = simulate(QuestPlusRule(trials=48 if trials is None else trials), setting)
    elif procedure == "curve":
        result = simulate_curve(WholeCurveRule(trials=150 if trials is None else trials), setting)
    else:
        raise BadInput(f"procedure {procedure!r}; allowed: {', '.join([*PROCEDURES, 'quest-plus', 'curve'])}")
    figures = plain(result)
    assert isinstance(figures, dict)
    answer(figures, as_json, _table(f"{procedure}, {runs} runs", figures))


ProtocolFile = Annotated[Path, typer.Argument(help="Protocol file (TOML).", metavar="PROTOCOL")]
StoreFile = Annotated[Path, typer.Option("--store", help="Database of the experiment (SQLite).")]
ControllerFile = Annotated[Path | None, typer.Option(help="controller.json; default: the paper's display and C.")]
RigName = Annotated[str, typer.Option("--rig", help="simulated.")]


@experiment.command("serve")
def serve_command(
    protocol: ProtocolFile,
    store: StoreFile,
    rig: RigName = "simulated",
    controller: ControllerFile = None,
    host: Annotated[
        str, typer.Option(help="Address to listen at; another than loopback lets others in.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port; 0: any that is free.")] = 8765,
    operator_token: Annotated[str | None, typer.Option(help="The operator's token; default: a fresh one.")] = None,
    speed: Annotated[
        float, typer.Option(help="Speed of presentation on the simulated rig; 0: as fast as it can.")
    ] = 1.0,
    auto_start: Annotated[bool, typer.Option("--auto-start", help="Subjects may begin without the operator.")] = False,
    seed: Seed = 0,
) -> None:
    """Serve the study to browsers: one page for every subject, one for the operator."""
    serve(protocol, store, station(rig, controller, seed, speed or None), host, port, operator_token, auto_start)


def _slope_range(text: str) -> tuple[float, float]:
    low, _, high = text.partition(":")
    try:
        return float(low), float(high or low)
    except ValueError:
        raise BadInput(f"slope {text!r}; allowed: a number, or LOW:HIGH") from None


def _table(title: str, figures: dict[str, Any]) -> Table:
    table = Table("figure", "value", title=title)
    for key, value in figures.items():
        if isinstance(value, dict):
            for inner, number in value.items():
                table.add_row(f"{key} {inner}", f"{number:.3f}")
        else:
            table.add_row(key, f"{value:.3f}" if isinstance(value, float) else str(value))
    return table
