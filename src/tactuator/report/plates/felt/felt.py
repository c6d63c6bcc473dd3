"""Figure 12: what was asked of the fingers and what they felt, in third-octave bands."""

from __future__ import annotations

import numpy as np

from tactuator.measure.felt import HEARD_DB_SL, FeltReport
from tactuator.report.plate import Plate
from tactuator.report.style import BLUE, INK, RED, figure, frequency_axis


def felt_plate(report: FeltReport, what: str, name: str = "fig12") -> Plate:
    """Draw a panel for each finger: band levels asked and felt above, their difference below where 10 dB SL or more."""
    fingers = report.fingers
    made, grid = figure(
        2, len(fingers), 4.2, sharex=True, sharey="row", squeeze=False, gridspec_kw={"height_ratios": (2.2, 1.0)}
    )
    table: dict[str, list[object]] = {key: [] for key in ("finger", "centre_hz", "asked_db_sl", "felt_db_sl")}
    for column, finger in enumerate(fingers):
        upper, lower = grid[:, column]
        upper.step(finger.centre_hz, finger.asked_db_sl, where="mid", color=BLUE, linewidth=1.4, label="asked")
        upper.plot(finger.centre_hz, finger.felt_db_sl, "o", color=RED, markersize=3, fillstyle="none", label="felt")
        upper.axhline(0.0, color=INK, linewidth=0.8, linestyle="--")
        upper.set_title(finger.finger, fontsize=9)
        lower.plot(finger.centre_hz, finger.difference_db, "o", color=RED, markersize=3)
        lower.axhline(0.0, color=INK, linewidth=0.6)
        for axes, label in ((upper, False), (lower, True)):
            frequency_axis(axes, float(finger.centre_hz[0]) / 1.2, float(finger.centre_hz[-1]) * 1.2, label)
            axes.set_xticks([2.0, 10.0, 50.0, 200.0], ["2", "10", "50", "200"])
        rows = zip(finger.centre_hz.tolist(), finger.asked_db_sl.tolist(), finger.felt_db_sl.tolist(), strict=True)
        for row in rows:
            for cells, cell in zip(table.values(), (finger.finger, *row), strict=True):
                cells.append(cell)
    loudest = max(float(np.max(finger.asked_db_sl)) for finger in fingers)
    grid[0, 0].set_ylim(-20.0, loudest + 8.0)
    reach = max(1.0, 1.15 * max(float(np.nanmax(np.abs(finger.difference_db))) for finger in fingers))
    grid[1, 0].set_ylim(-reach, reach)
    grid[0, 0].set_ylabel("band level (dB SL)", fontsize=9)
    grid[1, 0].set_ylabel("felt − asked (dB)", fontsize=9)
    grid[0, -1].legend(fontsize=7, frameon=False, loc="upper left")
    caption = (
        f"{what}: levels asked for and felt in third-octave bands over the whole utterance, and their difference where "
        f"{HEARD_DB_SL:g} dB SL or more was asked for; rms {report.worst_rms_db:.2f} dB on the worst finger."
    )
    return Plate(name, "Speech, asked and felt", caption, made, table)
