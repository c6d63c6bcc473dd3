"""Figure 11: thresholds of several people over the library's curve, and the new curve that comes of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactuator.experiment.result.group_curve import PersonThresholds
from tactuator.perception.curve import ThresholdCurve
from tactuator.report.plate import Plate
from tactuator.report.style import BLUE, CYCLE, INK, figure, frequency_axis, legend

_MARKERS = "os^Dv<>"


def thresholds_plate(
    people: Sequence[PersonThresholds], library: ThresholdCurve, new: ThresholdCurve | None, name: str = "fig11"
) -> Plate:
    """Draw points with standard errors for every person, the library's curve (solid) and the new one (dashed, with
    band). Flagged points are crossed out.
    """
    made, axes = figure(height_in=4.2)
    low = min(float(one.frequency_hz.min()) for one in people)
    high = max(float(one.frequency_hz.max()) for one in people)
    fine = np.geomspace(low, high, 300)
    label = f"{library.name} ({library.provenance})"
    axes.plot(fine, library.level_db_re_1um_at(fine), color=INK, linewidth=1.4, label=label)
    if new is not None:
        axes.plot(fine, new.level_db_re_1um_at(fine), color=BLUE, linestyle="--", linewidth=1.6, label="new curve")
        if new.standard_error_db is not None:
            error = np.interp(np.log(fine), np.log(new.frequency_hz), new.standard_error_db)
            level = new.level_db_re_1um_at(fine)
            axes.fill_between(fine, level - error, level + error, color=BLUE, alpha=0.15, linewidth=0)
    spread = np.linspace(-0.03, 0.03, len(people)) if len(people) > 1 else np.zeros(1)
    for one, shift, colour, marker in zip(people, spread, _cycle(len(people)), _MARKERS * len(people), strict=False):
        at = one.frequency_hz * np.exp(shift)
        axes.errorbar(
            at, one.level_db_re_1um, one.standard_error_db, fmt=marker, color=colour, markersize=4, fillstyle="none",
            elinewidth=0.8, label=one.name,
        )  # fmt: skip
        if one.flagged is not None and one.flagged.any():
            axes.plot(at[one.flagged], one.level_db_re_1um[one.flagged], "x", color=INK, markersize=9, zorder=5)
    frequency_axis(axes, low / 1.15, high * 1.15)
    axes.set_ylabel("threshold (dB re 1 µm peak)", fontsize=9)
    legend(axes, loc="lower left")
    caption = (
        f"Detection thresholds of {', '.join(one.name for one in people)} with their standard errors, over the curve "
        f"of the design ({library.name}, {library.provenance})"
    )
    caption += "; dashed: the new curve, with its standard error." if new is not None else "."
    crossed = sum(0 if one.flagged is None else int(one.flagged.sum()) for one in people)
    caption += f" Crossed out: {crossed} thresholds of runs with a disqualifying flag." if crossed else ""
    table: dict[str, list[object]] = {
        key: [] for key in ("person", "frequency_hz", "level_db_re_1um", "standard_error_db")
    }
    for one in people:
        columns = (one.frequency_hz, one.level_db_re_1um, one.standard_error_db)
        for row in zip(*(column.tolist() for column in columns), strict=True):
            for cells, cell in zip(table.values(), (one.name, *row), strict=True):
                cells.append(cell)
    if any(one.flagged is not None for one in people):
        marks = [np.zeros(one.frequency_hz.size, bool) if one.flagged is None else one.flagged for one in people]
        table["flagged"] = [int(mark) for marked in marks for mark in marked]
    return Plate(name, "Detection thresholds and the new curve", caption, made, table)


def _cycle(count: int) -> list[str]:
    return [CYCLE[1 + index % (len(CYCLE) - 1)] for index in range(count)]
