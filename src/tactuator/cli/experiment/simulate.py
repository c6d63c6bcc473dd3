"""Verb `experiment simulate`: how good a procedure is, against observers whose truth is known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.table import Table

from tactuator.api.plain import plain
from tactuator.cli.answer import answer, progress, working
from tactuator.errors import BadInput
from tactuator.experiment.procedure.quest_plus import QuestPlusRule
from tactuator.experiment.procedure.whole_curve import WholeCurveRule
from tactuator.experiment.simulated.curve_quality import CurveQuality, simulate_curve
from tactuator.experiment.simulated.procedure_quality import PROCEDURES, Setting, simulate
from tactuator.io.curve import read_relative_curve
from tactuator.perception.curve import RelativeCurve


def run(
    procedure: str,
    runs: int,
    slope: str,
    lapse: float,
    start_db: float,
    trials: int | None,
    truth: Path | None,
    guess: float,
    drift_db: float,
    loud_share: float,
    seed: int,
    as_json: bool,
) -> None:
    """Run a procedure many times against a Weibull observer and say how good its estimates are."""
    setting = Setting(runs, _slope_range(slope), lapse, start_db, seed, guess, drift_db, loud_share)
    if procedure != "curve" and truth is not None:
        raise BadInput(f"--truth with {procedure}", "with curve")
    if procedure in PROCEDURES:
        if trials is not None:
            raise BadInput(f"--trials {trials} with {procedure}", "with quest-plus and curve")
        with working(f"{runs} runs"):
            result: Any = simulate(PROCEDURES[procedure], setting)
    elif procedure == "quest-plus":
        with working(f"{runs} runs"):
            result = simulate(QuestPlusRule(trials=48 if trials is None else trials), setting)
    elif procedure == "curve":
        people = None if truth is None else read_relative_curve(truth)
        result = _curve(WholeCurveRule(trials=150 if trials is None else trials), setting, people)
    else:
        raise BadInput(f"procedure {procedure!r}", f"{', '.join([*PROCEDURES, 'quest-plus', 'curve'])}")
    figures = plain(result)
    assert isinstance(figures, dict)
    answer(figures, as_json, _table(f"{procedure}, {runs} runs", figures))


def _curve(rule: WholeCurveRule, setting: Setting, people: RelativeCurve | None) -> CurveQuality:
    with progress() as bars:
        task = bars.add_task("runs", total=1000)
        return simulate_curve(rule, setting, people, lambda share: bars.update(task, completed=round(1000 * share)))


def _slope_range(text: str) -> tuple[float, float]:
    low, _, high = text.partition(":")
    try:
        return float(low), float(high or low)
    except ValueError:
        raise BadInput(f"slope {text!r}", "a number, or LOW:HIGH") from None


def _table(title: str, figures: dict[str, Any]) -> Table:
    table = Table("figure", "value", title=title)
    for key, value in figures.items():
        if isinstance(value, dict):
            for inner, number in value.items():
                table.add_row(*_row(f"{key} {inner}", number))
        else:
            table.add_row(*_row(key, value))
    return table


_WORDS = {
    "sd": "standard deviation", "rmse": "rms error", "rms error median": "rms error of the median person",
    "trials mean": "trials, mean", "trials p05": "trials, 5th percentile", "trials p95": "trials, 95th percentile",
    "coverage95": "share inside the 95 % interval", "unfinished": "runs that did not end",
    "flagged": "share of runs that are flagged",
}  # fmt: skip


def _row(key: str, value: object) -> tuple[str, str]:
    """Return the words and the figure of one result, with its unit and digits."""
    name = key.removesuffix("_db").replace("_", " ")
    last = name.removeprefix("refit ")
    words = f"refit: {_WORDS.get(last, last)}" if last != name else _WORDS.get(name, name)
    if key.endswith("_db"):
        return f"{words} (dB)", f"{value:.2f}"
    digits = 0 if words.startswith("trials") else 2
    return words, f"{value:.{digits}f}" if isinstance(value, float) else str(value)
