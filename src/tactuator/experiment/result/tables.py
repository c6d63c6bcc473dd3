"""Results as tables of text, for pages and terminals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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


def threshold_table(found: Sequence[MeasuredThreshold]) -> ResultTable:
    """Return a table with a row for each threshold."""
    columns = ("subject", "finger", "Hz", "trials", "procedure", "refit", "95 %", "dB re 1 µm", "flags")
    rows = tuple(
        (
            one.subject,
            one.finger,
            f"{one.frequency_hz:.4g}",
            str(one.trials),
            "–" if one.own_db_sl is None else f"{one.own_db_sl:.2f}",
            f"{_BOUNDS[one.bound]}{one.refit_db_sl:.2f}",
            f"{one.refit_low_db_sl:.1f} to {one.refit_high_db_sl:.1f}",
            f"{one.level_db_re_1um:.2f}",
            ", ".join(one.flags),
        )
        for one in found
    )
    points = " and ".join(sorted({f"{100.0 * one.point:.1f} %" for one in found}))
    notes = [f"at {points} correct, lapses included, by procedure and refit alike"]
    if any(one.simulated for one in found):
        notes.append("simulated: nobody felt this")
    blind = [one for one in found if one.lapse_power is not None and one.lapse_power < _POWER_MIN]
    if blind:
        notes.append(
            f"lapses: not judged in {len(blind)} of {len(found)} (a rate of 15 % would show in under half); "
            "loud catch trials would help"
        )
    still = [one for one in found if one.drift_power is not None and one.drift_power < _POWER_MIN]
    if still:
        notes.append(
            f"drift: not judged in {len(still)} of {len(found)} (6 dB would show in under half); longer runs would help"
        )
    return ResultTable("Thresholds (dB SL commanded; dB re 1 µm delivered)", columns, rows, tuple(notes))


def information_table(title: str, found: Information) -> ResultTable:
    """Return a table with a row for each estimator."""
    rates = found.bits_per_second or {}
    rows = tuple(
        (
            name.replace("_", " "),
            f"{estimate.bits:.2f}",
            "–" if estimate.low_bits is None else f"{estimate.low_bits:.2f} – {estimate.high_bits:.2f}",
            f"{estimate.categories:.1f}",
            f"{rates[name]:.2f}" if name in rates else "–",
        )
        for name, estimate in found.estimates.items()
    )
    told = f"{found.trials} trials, {found.stimuli} stimuli, {100.0 * found.share_correct:.1f} % correct"
    warnings = [f"warning: {text}" for text in (found.warning, found.no_interval) if text is not None]
    return ResultTable(
        title, ("estimator", "bits", f"{100.0 * found.confidence:g} %", "2^bits", "bits/s"), rows, (told, *warnings)
    )


def matrix_table(one: SubjectResult) -> ResultTable:
    """Return the confusion matrix as a table."""
    rows = tuple((label, *map(str, counts)) for label, counts in zip(one.labels, one.counts.tolist(), strict=True))
    return ResultTable("Confusion matrix (a row a stimulus, a column a response)", ("", *one.labels), rows)


def abx_table(one: AbxResult) -> ResultTable:
    """Return the share of right answers as a table."""
    return ResultTable("ABX", ("trials", "% correct"), ((str(one.trials), f"{100.0 * one.share_correct:.1f}"),))
