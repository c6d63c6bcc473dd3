"""Results as tables of text, for pages and terminals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tactuator.experiment.result.confusion import AbxResult, SubjectResult
from tactuator.experiment.result.information import Information
from tactuator.experiment.result.thresholds import Threshold


@dataclass(frozen=True)
class ResultTable:
    """notes: a line each, below."""

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()


def threshold_table(found: Sequence[Threshold]) -> ResultTable:
    """A row a threshold."""
    columns = ("subject", "finger", "Hz", "trials", "procedure", "refit", "95 %", "dB re 1 µm", "flags")
    rows = tuple(
        (
            one.subject,
            one.finger,
            f"{one.frequency_hz:.4g}",
            str(one.trials),
            "–" if one.own_db_sl is None else f"{one.own_db_sl:.2f}",
            f"{one.refit_db_sl:.2f}",
            f"{one.refit_low_db_sl:.1f} to {one.refit_high_db_sl:.1f}",
            f"{one.level_db_re_1um:.2f}",
            ", ".join(one.flags),
        )
        for one in found
    )
    return ResultTable("Thresholds (dB SL commanded; dB re 1 µm delivered)", columns, rows)


def information_table(title: str, found: Information) -> ResultTable:
    """A row an estimator."""
    rates = found.bits_per_second or {}
    rows = tuple(
        (
            name.replace("_", " "),
            f"{estimate.bits:.2f}",
            f"{estimate.low_bits:.2f} – {estimate.high_bits:.2f}",
            f"{estimate.categories:.1f}",
            f"{rates[name]:.2f}" if name in rates else "–",
        )
        for name, estimate in found.estimates.items()
    )
    told = f"{found.trials} trials, {found.stimuli} stimuli, {100.0 * found.share_correct:.1f} % correct"
    notes = (told, *([] if found.warning is None else [f"warning: {found.warning}"]))
    return ResultTable(title, ("estimator", "bits", f"{100.0 * found.confidence:g} %", "2^bits", "bits/s"), rows, notes)


def matrix_table(one: SubjectResult) -> ResultTable:
    """The confusion matrix."""
    rows = tuple((label, *map(str, counts)) for label, counts in zip(one.labels, one.counts.tolist(), strict=True))
    return ResultTable("Confusion matrix (a row a stimulus, a column a response)", ("", *one.labels), rows)


def abx_table(one: AbxResult) -> ResultTable:
    """The share of right answers."""
    return ResultTable("ABX", ("trials", "% correct"), ((str(one.trials), f"{100.0 * one.share_correct:.1f}"),))
