"""The verb `experiment thresholds`: results of a store's runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.console import Group

from tactuator.cli.answer import shown, working, written
from tactuator.errors import BadInput
from tactuator.experiment.language.words import shipped_words
from tactuator.experiment.result.confusion import threshold_table
from tactuator.experiment.result.store_results import GroupCurve, store_results
from tactuator.io.curve import write_curve
from tactuator.report.felt import psychometric_plate, thresholds_plate


def results(
    store_path: Path,
    group: str | None,
    reference: str | None,
    curve_out: Path | None,
    figures: Path | None,
    keep_flagged: bool = False,
) -> tuple[dict[str, Any], Group, BadInput | None]:
    """Return thresholds and the curve across subjects, as JSON and as a table; files are written where asked.

    The third is why there is no curve where a file or figures of it were asked for, and None otherwise: the thresholds
    are worth telling all the same.
    """
    with working("refitting the runs"):
        answer = store_results(store_path, group, reference, keep_flagged)
    across, files = answer.group, []
    if across is not None:
        if curve_out is not None:
            write_curve(curve_out, across.curve, answer.circumstances)
        if figures is not None:
            figures.mkdir(parents=True, exist_ok=True)
            thresholds_plate(answer.people, answer.reference, across.curve).save(figures)
            for subject, trials in answer.psychometric.items():
                psychometric_plate(subject, trials).save(figures)
        files = written(curve_out, figures)
    table = Group(shown(threshold_table(answer.thresholds, shipped_words("en"))), *_who(across), *files)
    return answer.document(), table, answer.no_curve if curve_out or figures else None


def _who(group: GroupCurve | None) -> list[str]:
    """Return lines on who stands in the curve across subjects."""
    if group is None:
        return []
    points = [(hertz, count) for hertz, count in zip(group.curve.frequency_hz, group.subjects, strict=True) if count]
    counts = {count for _, count in points}
    if len(counts) == 1:
        people = f"people: {counts.pop()} at each of {len(points)} frequencies"
    else:
        people = "people: " + ", ".join(f"{count} at {hertz:.4g} Hz" for hertz, count in points)
    lines = [f"curve across subjects ({group.curve.provenance}): {people}"]
    lines += [
        f"left out: {each.subject}, {each.finger}, {each.frequency_hz:.4g} Hz, run {each.run}: {', '.join(each.flags)}"
        for each in group.left_out
    ]
    return lines
