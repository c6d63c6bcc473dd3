"""tactuator experiment: thresholds measured with people, or with observers."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from rich.table import Table

from tactuator.cli.answer import answer, plain
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
