"""Results as tables of text, for pages and terminals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from tactuator.experiment.language.words import Words
from tactuator.experiment.result.confusion import AbxResult, SubjectResult
from tactuator.experiment.result.information import Information
from tactuator.experiment.result.thresholds import MeasuredThreshold

_BOUNDS = {"": "", ">=": "≥ ", "<=": "≤ "}
_POWER_MIN = 0.5


@dataclass(frozen=True)
class ResultTable:
    """A table of results; notes: lines below the table."""

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()


def threshold_table(found: Sequence[MeasuredThreshold], words: Words) -> ResultTable:
    """Return a table with a row for each threshold."""
    columns = ["subject", "finger", "hertz", "trials", "procedure", "refit", "interval", "level", "flags"]
    heads = tuple(words(f"results.{name}", **({"percent": 95} if name == "interval" else {})) for name in columns)
    rows = tuple(
        (
            one.subject,
            one.finger,
            f"{one.frequency_hz:.4g}",
            str(one.trials),
            "–" if one.own_db_sl is None else f"{one.own_db_sl:.1f}",
            f"{_BOUNDS[one.bound]}{one.refit_db_sl:.1f}",
            _interval(one, words),
            f"{_BOUNDS[one.bound]}{one.level_db_re_1um:.1f}",
            ", ".join(words(f"results.flag_{name.replace('-', '_')}") for name in one.flags),
        )
        for one in found
    )
    points = ", ".join(sorted({f"{100.0 * one.point:.1f}" for one in found}))
    notes = [words("results.point", percent=points)]
    if any(one.simulated for one in found):
        notes.append(words("results.simulated"))
    for name, powers in (
        ("results.lapses_unjudged", [one.lapse_power for one in found]),
        ("results.drift_unjudged", [one.drift_power for one in found]),
    ):
        weak = sum(power is not None and power < _POWER_MIN for power in powers)
        if weak:
            notes.append(words(name, count=weak, all=len(found)))
    return ResultTable(words("results.thresholds"), heads, rows, tuple(notes))


def _interval(one: MeasuredThreshold, words: Words) -> str:
    """Return the 95 % interval; of a threshold beyond what was played, the end that is known."""
    if one.bound:
        return f"{_BOUNDS[one.bound]}{one.refit_low_db_sl if one.bound == '>=' else one.refit_high_db_sl:.1f}"
    return words("results.range", low=f"{one.refit_low_db_sl:.1f}", high=f"{one.refit_high_db_sl:.1f}")


def information_table(title: str, found: Information, words: Words) -> ResultTable:
    """Return a table with a row for each estimator."""
    rates = found.bits_per_second or {}
    rows = tuple(
        (
            words(f"results.estimator_{name}"),
            _number(estimate.bits, 2),
            "–" if estimate.low_bits is None else f"{estimate.low_bits:.2f} – {estimate.high_bits:.2f}",
            _number(estimate.categories, 1),
            _number(rates.get(name, math.nan), 2),
        )
        for name, estimate in found.estimates.items()
    )
    correct = _number(100.0 * found.share_correct, 1)
    told = words("results.answered", trials=found.trials, stimuli=found.stimuli, percent=correct)
    warnings = [words("results.warning", text=one.told(words)) for one in found.reasons]
    heads = (
        words("results.estimator"),
        words("results.bits"),
        words("results.interval", percent=f"{100.0 * found.confidence:g}"),
        words("results.categories"),
        words("results.rate"),
    )
    return ResultTable(title, heads, rows, (told, *warnings))


def _number(value: float, digits: int) -> str:
    """Return the number with so many digits after the point, or a dash for NaN."""
    return "–" if math.isnan(value) else f"{value:.{digits}f}"


def matrix_table(one: SubjectResult, words: Words) -> ResultTable:
    """Return the confusion matrix as a table."""
    rows = tuple((label, *map(str, counts)) for label, counts in zip(one.labels, one.counts.tolist(), strict=True))
    return ResultTable(words("results.matrix"), ("", *one.labels), rows)


def abx_table(one: AbxResult, words: Words) -> ResultTable:
    """Return the share of right answers as a table."""
    row = (str(one.trials), f"{100.0 * one.share_correct:.1f}")
    return ResultTable(words("results.abx"), (words("results.trials"), words("results.correct")), (row,))
