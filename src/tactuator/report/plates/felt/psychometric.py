"""Psychometric functions of one subject: a panel a run, the answers as points and the fit as a line."""

from __future__ import annotations

from collections.abc import Sequence

from tactuator.errors import BadInput
from tactuator.experiment.result.psychometric_trials import PsychometricTrials
from tactuator.report.plate import Plate
from tactuator.report.style import BLUE, INK, RED, figure

_COLUMNS = 3
_LARGEST, _SMALLEST = 9.0, 2.0


def psychometric_plate(subject: str, runs: Sequence[PsychometricTrials]) -> Plate:
    """Draw a panel for each run: share correct against level (area: trials), fit, refitted threshold with its interval.

    Raises BadInput where there is no run.
    """
    if not runs:
        raise BadInput(f"no runs of {subject}", "one or more")
    rows = -(-len(runs) // _COLUMNS)
    made, grid = figure(rows, min(_COLUMNS, len(runs)), height_in=0.9 + 1.8 * rows, squeeze=False, sharey=True)
    panels = list(grid.flat)
    for panel, run in zip(panels, runs, strict=False):
        _panel(panel, run)
    for spare in panels[len(runs) :]:
        spare.set_axis_off()
    for row in grid:
        row[0].set_ylabel("share correct", fontsize=8)
    for panel in panels[max(len(runs) - _COLUMNS, 0) : len(runs)]:
        panel.set_xlabel(_level_label(runs[panels.index(panel)]), fontsize=8)
    simulated = any(run.threshold.simulated for run in runs)
    who = f"{subject} (simulated: nobody felt this)" if simulated else subject
    caption = (
        f"Psychometric functions of {who}: share of right answers at each level (larger: more trials) and the Weibull "
        f"function of the refit; the bar is the threshold at {100.0 * runs[0].threshold.point:.1f} % correct with its "
        "95 % interval, the triangle the procedure's own number."
    )
    if any(run.whole_curve for run in runs):
        caption += (
            " Whole-curve runs: levels relative to the run's own curve at each trial's frequency, in classes of 2 dB; "
            "a threshold at 0 dB agrees with the curve."
        )
    return Plate(f"psychometric-{subject}", f"Psychometric functions, {subject}", caption, made, _table(runs))


def _level_label(run: PsychometricTrials) -> str:
    return "level above the curve (dB)" if run.whole_curve else "level (dB SL)"


def _panel(axes, run: PsychometricTrials) -> None:  # type: ignore[no-untyped-def]
    one = run.threshold
    axes.plot(run.grid_db_sl, run.psi, color=BLUE, linewidth=1.2)
    most = run.count.max()
    for level, share, count in zip(run.level_db_sl, run.share, run.count, strict=True):
        size = _SMALLEST + (_LARGEST - _SMALLEST) * (count / most) ** 0.5
        axes.plot([level], [share], "o", color=INK, markersize=size, fillstyle="none", markeredgewidth=0.7)
    axes.plot([one.refit_low_db_sl, one.refit_high_db_sl], [one.point] * 2, color=RED, linewidth=2.0)
    axes.plot([one.refit_db_sl], [one.point], "|", color=RED, markersize=9)
    if one.own_db_sl is not None:
        axes.plot([one.own_db_sl], [one.point - 0.05], "^", color=RED, markersize=4)
    bound = {"": "", ">=": " (≥)", "<=": " (≤)"}[one.bound]
    flags = f"\n{', '.join(one.flags)}" if one.flags else ""
    where = "whole curve" if run.whole_curve else f"{one.frequency_hz:.4g} Hz"
    axes.set_title(f"{one.finger}, {where}{bound}{flags}", fontsize=7)
    axes.set_ylim(-0.03, 1.05)
    axes.tick_params(labelsize=7)


def _table(runs: Sequence[PsychometricTrials]) -> dict[str, list[object]]:
    keys = ("run", "finger", "frequency_hz", "level_db_sl", "share_correct", "trials")
    table: dict[str, list[object]] = {key: [] for key in keys}
    for run in runs:
        one = run.threshold
        for level, share, count in zip(run.level_db_sl, run.share, run.count, strict=True):
            row = (one.run, one.finger, one.frequency_hz, float(level), float(share), int(count))
            for key, cell in zip(keys, row, strict=True):
                table[key].append(cell)
    return table
